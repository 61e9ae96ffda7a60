"""Arms from URDF files: brought in through the page, and what their files leave open."""

from __future__ import annotations

import asyncio
import os
import shutil
from collections.abc import Callable, Coroutine, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import viser

from armctl.errors import InputError, RobotFileError, UnclearArmError
from armctl.facts import About
from armctl.lazy_dataclass import dataclass
from armctl.motion.clearance import clear_pose, stands_clear
from armctl.protocol import Snapshot
from armctl.robot import Robot, load_robot, urdf_path
from armctl.robot.urdf import (
    ARM_SUFFIXES,
    AXES,
    MESH_FILES,
    Argument,
    SideFile,
    UrdfSource,
    Wanted,
    add_to_package,
    argument_texts,
    changed_side_file,
    install_package,
    read_side_file,
    read_urdf_file,
    side_path,
)
from armctl.robot.urdf.side_file import SIDE_SUFFIX
from armctl.ui.enabling import show_typed
from armctl.ui.events import GivenUpError
from armctl.ui.robot_switch import RobotChoice
from armctl.ui.session import Session
from armctl.ui.tabs.main.beginning import URDF_ARM
from armctl.ui.widgets.angle_fields import angle_fields
from armctl.ui.widgets.html import LiveHtml, muted
from armctl.ui.widgets.number_field import NumberField, in_row

_TAKEN = ",".join((".zip", *ARM_SUFFIXES, *MESH_FILES))
_QUESTIONS = {
    "arm": ("Which arm?", "The file holds several arms. Upload it again for another one."),
    "link": ("Which link is the tool?", "The arm ends there. Joints that lead to other links are left out."),
}
"""title and text for what an uploaded file leaves open"""
_EXACT_HINT = (
    "Angles within 0.1° of right ones are taken as right: noise of CAD programs, or 1.57 for 90°. The values "
    "assumed (under the list of robots) say by how much the tool moves."
)
_MOST_OFFERED = 40
_AS_FOUND = "(as armctl finds it)"
_NO_LINKS: tuple[str, ...] = (_AS_FOUND,)


@dataclass(frozen=True, slots=True)
class _Present:
    name: str
    """what opens it, without a tool link"""
    source: UrdfSource
    side: SideFile
    links: tuple[str, ...]
    arguments: tuple[Argument, ...]
    """that the xacro file declares"""
    exact: bool
    """whether nearly right angles are taken as right"""

    @classmethod
    def of(cls, name: str) -> _Present:
        """May block. Raises ``RobotFileError``."""
        found = urdf_path(name)
        if found is None:
            raise InputError(f"{name} is no URDF arm")
        source = UrdfSource.at(found[0])
        side, _ = read_side_file(source.side_path)
        wish = Wanted.of(found[1])
        tree = read_urdf_file(source, argument_texts({**side.arguments, **wish.arguments}))
        exact = side.exact or wish.exact
        return cls(name.partition("#")[0], source, side, tuple(tree.links), tree.arguments, exact)


class UrdfArm:
    """A tab in *Main*: upload an arm; choose tool, rest pose and floor of the present one."""

    def __init__(self, session: Session) -> None:
        self._session, self._robot = session, session.console.robot
        self._present: _Present | None = None
        gui, is_urdf = session.gui, urdf_path(session.robots.present.name) is not None
        LiveHtml(gui, URDF_ARM)
        with in_row(gui):
            self._upload = gui.add_upload_button("Upload an arm", icon=viser.Icon.UPLOAD, mime_type=_TAKEN)
            self._begin = gui.add_button(
                "Tool, rest pose and floor", icon=viser.Icon.TOOL, visible=is_urdf, color="gray"
            )
        session.needs(None, self._upload)
        self._box = gui.add_folder("Tool, rest pose and floor", visible=False)
        with self._box:
            self._link: viser.GuiDropdownHandle[str] = gui.add_dropdown("Tool link", _NO_LINKS)
            self._axis = gui.add_dropdown("It points along", tuple(AXES), initial_value="z")
            self._offset = [NumberField(gui, f"Tool point {axis} mm", 0.0) for axis in "xyz"]
            self._floor = NumberField(gui, "Floor mm", 0.0, hint="Height of the floor in the base frame.")
            LiveHtml(gui, "<b>Rest pose</b>" + muted("Enable puts the simulated arm there (the ghost)."))
            self._angles = angle_fields(gui, self._robot, self._robot.pose("rest"))
            self._take = gui.add_button_group("Rest pose", ("Use the present pose", "Find a clear one"))
            self._home = gui.add_checkbox("Home pose, too", False, hint="Home is a pose that Main goes to.")
            self._exact = gui.add_checkbox("Right angles are exact", False, hint=_EXACT_HINT)
            self._arguments = gui.add_folder("Arguments of the xacro file", visible=False)
            self._fields: dict[Argument, viser.GuiInputHandle[str]] = {}
            self._problem = LiveHtml(gui)
            save = gui.add_button("Save and open anew", icon=viser.Icon.DEVICE_FLOPPY, color="green")
            cancel = gui.add_button("Cancel", color="gray")
        session.on(self._upload.on_upload, self._on_upload)
        session.on(self._begin.on_click, self._on_begin)
        session.on(self._take.on_click, self._on_take)
        session.on(save.on_click, self._on_save)
        session.on(cancel.on_click, self._end)

    def refresh(self, snapshot: Snapshot) -> None:
        """Show the rest pose that is typed as the ghost; what cannot be is told."""
        if self._box.visible:
            show_typed(self._session, self._angles, self._problem, self)

    async def _on_begin(self) -> None:
        self._present = present = await asyncio.to_thread(_Present.of, self._session.robots.present.name)
        tool = present.side.tool
        self._link.options = (_AS_FOUND, *present.links)
        self._link.value = _AS_FOUND if tool.link is None else tool.link
        self._axis.value = tool.approach
        for field, value in zip(self._offset, tool.offset_mm, strict=True):
            field.fill(value)
        self._floor.fill(1000 * self._robot.floor_z)
        self._angles.fill(self._robot.pose("rest"))
        home = self._robot.pose("home")
        self._home.value = not await asyncio.to_thread(stands_clear, replace(self._robot, poses={}), home)
        self._exact.value = present.exact
        for field in self._fields.values():
            field.remove()
        with self._arguments:
            offered = present.arguments[:_MOST_OFFERED]
            self._fields = {one: self._session.gui.add_text(one.name, one.value) for one in offered}
        self._arguments.visible = bool(self._fields)
        self._box.visible, self._begin.visible = True, False

    def _end(self) -> None:
        self._box.visible, self._begin.visible = False, True
        self._session.ghost.hide(self)

    async def _on_take(self) -> None:
        if self._take.value == "Use the present pose":
            self._angles.fill(self._session.console.last_known.standing(self._session.snapshot))
            return
        q = await asyncio.to_thread(clear_pose, self._with_floor())
        if q is None:
            raise InputError("no pose of quarter turns is clear of the floor and of the arm; type one")
        self._angles.fill(q)

    def _with_floor(self) -> Robot:
        """The arm over the floor that is typed; its poses so far excuse nothing."""
        floor = self._floor.value / 1000
        return replace(self._robot, floor_z=floor, poses={})

    async def _on_save(self) -> None:
        session, present = self._session, self._present
        session.require_operator()
        if present is None:
            return
        session.robots.require_reopenable()
        angles = self._robot.shown(self._robot.check_limits(self._angles.array)).tolist()
        rest = [round(angle, 4) + 0.0 for angle in angles]
        tool: dict[str, object] = {
            "link": None if self._link.value == _AS_FOUND else self._link.value,
            "approach": self._axis.value,
            "offset_mm": [field.value for field in self._offset],
        }
        poses = {"rest": rest, "home": rest} if self._home.value else {"rest": rest}
        changes: dict[str, object] = {"tool": tool, "poses": poses, "floor": {"z_mm": self._floor.value}}
        changes["exact"] = self._exact.value or None
        if self._fields:
            changes["arguments"] = {
                one.name: None if field.value == one.default else field.value
                for one, field in self._fields.items()
            }
        folder = session.console.files / "robots"
        path = await asyncio.to_thread(_saved, present, changes, folder)
        session.notify("Saved", str(path))
        self._end()
        name = present.name if path.parent != folder or present.source.side_path == path else str(path)
        if name == session.robots.present.name:
            await session.reopen_arm()
        else:
            session.robots.offer(RobotChoice(name, self._robot.title))
            await session.change_robot(name)

    async def _on_upload(self) -> None:
        session, file = self._session, self._upload.value
        session.require_operator()
        folder = session.console.files / "robots"
        if Path(file.name).suffix.lower() in (".zip", *ARM_SUFFIXES):
            await self._install(file, folder, {})
            return
        found = urdf_path(session.robots.present.name)
        if found is None or not found[0].is_relative_to(folder):
            raise InputError(f"{file.name}: upload the URDF file first, then its meshes")
        session.robots.require_reopenable()
        await asyncio.to_thread(add_to_package, found[0], file.name, file.content)
        session.notify("Uploaded", f"{file.name} is used now, if the URDF file names it.")
        await session.reopen_arm()

    async def _install(self, file: viser.UploadedFile, folder: Path, chosen: Mapping[str, Any]) -> None:
        session = self._session
        try:
            choice = await session.work_out(_installed, file.name, file.content, folder, chosen, undo=_remove)
        except GivenUpError as given_up:
            raise GivenUpError(f"nothing of {file.name} is kept") from given_up
        except UnclearArmError as unclear:
            if unclear.arguments:
                before: dict[str, str] = chosen.get("arguments", {})

                def filled(values: Mapping[str, str]) -> Coroutine[Any, Any, None]:
                    return self._install(file, folder, {**chosen, "arguments": {**before, **values}})

                self._ask_arguments(unclear.arguments, filled)
                return
            what, options = ("arm", unclear.arms) if unclear.arms else ("link", unclear.links)
            if what in chosen:
                raise

            def go_on(value: str) -> Coroutine[Any, Any, None]:
                return self._install(file, folder, {**chosen, what: value})

            self._ask(what, options, go_on)
            return
        session.robots.offer(choice)
        session.notify("Uploaded", f"{choice.title} is in the list of robots.")
        await session.change_robot(choice.name)

    def _ask(
        self, what: str, options: Sequence[str], go_on: Callable[[str], Coroutine[Any, Any, None]]
    ) -> None:
        """Let the page choose what an uploaded file leaves open."""
        session, gui = self._session, self._session.gui
        title, text = _QUESTIONS[what]
        question = gui.add_modal(title)

        def offer(option: str) -> None:
            async def taken() -> None:
                question.close()
                session.require_operator()
                await go_on(option)

            session.on(gui.add_button(option).on_click, taken)

        with question:
            left_out = len(options) - _MOST_OFFERED
            gui.add_markdown(text + (f" {left_out} more are not shown." if left_out > 0 else ""))
            for option in options[:_MOST_OFFERED]:
                offer(option)
            session.on(gui.add_button("Cancel", color="gray").on_click, question.close)

    def _ask_arguments(
        self, names: Sequence[str], go_on: Callable[[Mapping[str, str]], Coroutine[Any, Any, None]]
    ) -> None:
        """Let the page fill in what an uploaded xacro file needs."""
        session, gui = self._session, self._session.gui
        question = gui.add_modal("Arguments of the xacro file")

        async def taken() -> None:
            question.close()
            session.require_operator()
            await go_on({name: field.value for name, field in fields.items()})

        with question:
            gui.add_markdown("The file needs these values and gives none. Its authors say what they may be.")
            fields = {name: gui.add_text(name, "") for name in names[:_MOST_OFFERED]}
            session.on(gui.add_button("Open the arm", color="green").on_click, taken)
            session.on(gui.add_button("Cancel", color="gray").on_click, question.close)


def _installed(name: str, content: bytes, folder: Path, chosen: Mapping[str, Any]) -> RobotChoice:
    """Keep an arm in the user's folder, if it can be opened.

    ``chosen``: the ``arm`` of several in the file, the tool ``link`` of several and the ``arguments`` of a
    xacro file, as far as they were asked for; a side file keeps them.
    """
    place = install_package(name, content, folder)
    try:
        if chosen:
            _keep_choice(place, **chosen)
        return RobotChoice(str(place), load_robot(place).title)
    except RobotFileError as refusal:
        shutil.rmtree(place, ignore_errors=True)
        if isinstance(refusal, UnclearArmError):
            raise
        match refusal.reason:
            case About(thing, reason) if Path(thing).is_relative_to(place):  # a folder that nobody named
                file = name if Path(thing) == place else os.path.relpath(thing, place)
                raise RobotFileError(About(file, reason)) from refusal
            case _:
                raise


def _remove(choice: RobotChoice) -> None:
    """Take back what ``_installed`` has kept."""
    shutil.rmtree(choice.name, ignore_errors=True)


def _keep_choice(
    place: Path, arm: str = "", link: str = "", arguments: Mapping[str, str] | None = None
) -> None:
    """A folder has one side file then, which names the arm, the tool link and the arguments."""
    source = UrdfSource.at(place / arm)
    side = source.side_path or place / side_path(source.file).name
    for other in [path for path in place.rglob(f"*{SIDE_SUFFIX}") if path != side]:
        other.unlink()
    changes: dict[str, object] = {"urdf": Path(os.path.relpath(source.file, side.parent)).as_posix()}
    if link:
        changes["tool"] = {"link": link}
    if arguments:
        changes["arguments"] = arguments
    changed_side_file(side, changes)


def _saved(present: _Present, changes: Mapping[str, object], folder: Path) -> Path:
    """Write the side file where there is one, else beside the URDF file, else into the user's folder.

    What cannot be opened with it is not kept. Raises ``RobotFileError``.
    """
    source = present.source
    path = source.side_path or side_path(source.file)
    if source.side_path is None and not _writeable(path.parent):
        path = _own_path(folder / path.name, source.file)
        changes = {"urdf": str(source.file.absolute()), **changes}
    before = path.read_bytes() if path.exists() else None
    changed_side_file(path, changes)
    try:
        load_robot(path)
    except RobotFileError:
        if before is None:
            path.unlink()
        else:
            path.write_bytes(before)
        raise
    return path


def _own_path(path: Path, urdf: Path) -> Path:
    """A side file's path with a number where the name is taken by another arm's."""
    stem, k = path.name.removesuffix(SIDE_SUFFIX), 2
    while path.exists() and not _is_about(path, urdf):
        path, k = path.with_name(f"{stem}_{k}{SIDE_SUFFIX}"), k + 1
    return path


def _is_about(side: Path, urdf: Path) -> bool:
    try:
        return UrdfSource.at(side).file.resolve() == urdf.resolve()
    except RobotFileError:
        return False


def _writeable(folder: Path) -> bool:
    return os.access(folder, os.W_OK)
