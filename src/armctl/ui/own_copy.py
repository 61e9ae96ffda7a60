"""What a copy of an arm takes along: saved programs, drawings and calibrations.

All of them are kept under the name of their robot, and a program says for which one it was made. A copy has
another name. Where it is the same arm in all that is measured or recorded of one, they hold for it as well.
"""

from __future__ import annotations

import asyncio
import shutil
from dataclasses import replace
from pathlib import Path

import msgspec

from armctl.calibration import Calibration, CalibrationStore
from armctl.documents import not_written
from armctl.drawing import DRAWING_SUFFIXES
from armctl.errors import ArmctlError, ProgramError
from armctl.lazy_dataclass import dataclass
from armctl.program import load_program, save_program
from armctl.robot import Robot
from armctl.ui.console import Console

_PROGRAM = ".toml"


def is_same_arm(one: Robot, other: Robot) -> bool:
    """Whether they differ in their names and in inputs and outputs beside the joints at most."""
    one, other = one.flange or one, other.flange or other
    return replace(one, name=other.name, title=other.title, signals=other.signals) == other


@dataclass(frozen=True, slots=True)
class Carried:
    """What came along with a copy, and what did not."""

    programs: int = 0
    drawings: int = 0
    boards: tuple[str, ...] = ()
    """on which it is calibrated now as the other one is"""
    problems: tuple[str, ...] = ()
    stay: bool = False
    """it is another arm, and what there is holds for the other one only"""

    def words(self, title: str) -> str:
        """In sentences; ``title``: of the other arm. Empty: there was nothing to take along."""
        if self.stay:
            return f"Saved programs and calibrations stay with {title}: its copy is built otherwise."
        counts = ((self.programs, "saved program"), (self.drawings, "drawing"))
        said = [f"{count} {noun}{'' if count == 1 else 's'}" for count, noun in counts if count]
        said += [f"the calibration on {board}" for board in self.boards]
        came = f"Copied from {title}, which keeps its own: {', '.join(said)}." if said else ""
        left = f"Not copied: {'; '.join(self.problems)}." if self.problems else ""
        return f"{came} {left}".strip()


async def taken_along(console: Console, copy: Robot) -> str:
    """Give a copy of the present arm what is kept of that, before it is opened; what came along, in words."""
    left, store = console.calibration.file_robot, console.calibration.store
    came = await asyncio.to_thread(carry_over, left, copy, console.files / "programs", store)
    return came.words(left.title)


def carry_over(left: Robot, copy: Robot, programs: Path, store: CalibrationStore) -> Carried:
    """Copy to ``copy`` what is kept of ``left``, if that holds for it; what it has already stays. May block.

    Both are as their robot files say. ``programs``: where each robot has its folder of saved programs.
    """
    files = [path for path in sorted((programs / left.name).glob("*")) if _is_kept(path)]
    boards = [one.board for one in store.boards() if one.robot == left.name and not one.problem]
    if not is_same_arm(left, copy):
        return Carried(stay=bool(files or boards))
    problems: list[str] = []
    came = [path.suffix for path in files if _copied(path, programs / copy.name, copy.name, problems)]
    calibrated: list[str] = []
    for board in boards:
        try:
            calibration = store.load(left.name, board)
            if calibration is not None and not store.versions(copy.name, board):
                store.save(_renamed(calibration, copy.name))
                calibrated.append(board)
        except ArmctlError as cause:
            problems.append(str(cause))
    of_programs = came.count(_PROGRAM)
    return Carried(of_programs, len(came) - of_programs, tuple(calibrated), tuple(problems))


def _is_kept(path: Path) -> bool:
    return path.suffix == _PROGRAM or path.suffix.lower() in DRAWING_SUFFIXES


def _copied(path: Path, folder: Path, robot: str, problems: list[str]) -> bool:
    """Whether a file is in ``folder`` now that was not; a program is for ``robot`` there."""
    goal = folder / path.name
    if goal.exists():
        return False
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if path.suffix == _PROGRAM:
            program = load_program(path)
            steps = tuple(step.seen_from(path.parent) for step in program.steps)  # drawings come along
            save_program(msgspec.structs.replace(program, robot=robot, steps=steps, called=()), goal)
        else:
            shutil.copy2(path, goal)
    except OSError as cause:
        problems.append(not_written(goal, cause))
    except ProgramError as cause:
        problems.append(str(cause))
    return goal.exists()


def _renamed(calibration: Calibration, robot: str) -> Calibration:
    note = f"copied from {calibration.robot}" + (f": {calibration.note}" if calibration.note else "")
    return msgspec.structs.replace(calibration, robot=robot, note=note)
