"""Programs that call others: found once, checked as one, refused by name where that cannot be."""

from __future__ import annotations

from pathlib import Path

import pytest
from tests.program.kit import program
from tests.runtime.signal_kit import robot_with

from armctl.errors import ProgramError
from armctl.facts import (
    About,
    CallCircle,
    CalledStep,
    CallMissing,
    CallTooDeep,
    CallTooLong,
    CallUnread,
    InStep,
    OnPath,
    PathTurn,
    UnknownFrame,
)
from armctl.motion import Finding
from armctl.program import (
    CallStep,
    CountStep,
    Cursor,
    ElseStep,
    EndStep,
    FrameStep,
    GridStep,
    IfStep,
    LineStep,
    MoveStep,
    PointStep,
    Program,
    RepeatStep,
    SavedPrograms,
    SpeedStep,
    Step,
    UserFrame,
    WaitForStep,
    WaitStep,
    WhileStep,
    check_program,
    decode_program,
    encode_program,
    load_program,
    open_program,
    read_csv,
    save_program,
    write_csv,
    write_script,
)
from armctl.program.calls import DEEPEST, WholeProgram
from armctl.robot import Robot

HOME = MoveStep(joints_deg=(0, 90, -80, -40, 0))
TURNED = MoveStep(joints_deg=(100, 90, -80, -40, 0))
FAR = PointStep(x_mm=900, y_mm=0, z_mm=0)
SUNK = PointStep(x_mm=200, y_mm=0, z_mm=-40)
NEAR = MoveStep(joints_deg=(10, 90, -80, -40, 0), duration_s=1.0)
"""in time from home, but not from TURNED"""
END, ELSE, ADD = EndStep(), ElseStep(), CountStep(counter="n", add=1)


def call(name: str) -> CallStep:
    return CallStep(program=name)


@pytest.fixture
def robot(tmp_path: Path) -> Robot:
    return robot_with(tmp_path)


def kept(folder: Path, **programs: tuple[Step, ...]) -> Program:
    """``main``, read from a folder in which all are saved; ``_`` in a name is a folder."""
    for name, steps in programs.items():
        path = folder / f"{name.replace('_', '/')}.toml"
        path.parent.mkdir(exist_ok=True)
        save_program(Program(robot="uzuner", name=name, steps=steps), path)
    return load_program(folder / "main.toml")


def found(robot: Robot, main: Program) -> list[Finding]:
    return check_program(main, robot, start=robot.pose("home"))


def errors(robot: Robot, main: Program) -> list[Finding]:
    return [one for one in found(robot, main) if one.severity == "error"]


# Found, once, and kept as a reference.


def test_a_name_is_a_path_from_the_folder_of_who_calls(robot: Robot, tmp_path: Path) -> None:
    main = kept(
        tmp_path,
        main=(call("lib/a"), call("b.toml")),
        b=(HOME,),
        lib_a=(call("c"), call("../b")),
        lib_c=(HOME,),
    )
    assert {one.file for one in main.called} == {"lib/a.toml", "lib/c.toml", "b.toml"}
    whole = WholeProgram.of(main)
    assert [step for step in whole.flat.steps if isinstance(step, MoveStep)] == 3 * [HOME]
    places = [whole.place(k) for k, step in enumerate(whole.flat.steps) if step == HOME]
    assert [place.index for place in places] == [0, 0, 1]
    assert places[0].calls == (CalledStep("lib/a", 0), CalledStep("lib/c", 0))
    assert places[1].words == "in 'lib/a', step 2: in 'b', step 1: "
    assert errors(robot, main) == []
    assert open_program(tmp_path / "main.toml").called == main.called


def test_a_program_holds_references_only(tmp_path: Path) -> None:
    main = kept(tmp_path, main=(HOME, call("b")), b=(TURNED,))
    text = encode_program(main)
    assert "TURNED" not in text and "called" not in text and 'program = "b"' in text
    assert decode_program(text).called == ()
    (tmp_path / "b.toml").unlink()  # it is read already
    assert not WholeProgram.of(main).findings


def test_a_table_may_call(robot: Robot) -> None:
    calls = program(CallStep(program="lib/ =pick up", note="x"), call("b"))
    assert read_csv(write_csv(calls, robot), robot, "pick") == calls


def test_a_table_may_be_called(robot: Robot, tmp_path: Path) -> None:
    (tmp_path / "points.csv").write_text("x_mm,y_mm,z_mm\n200,0,110\n")
    save_program(program(call("points.csv")), tmp_path / "main.toml")
    main = open_program(tmp_path / "main.toml", robot)
    assert errors(robot, main) == [] and main.called[0].steps == (PointStep(x_mm=200, y_mm=0, z_mm=110),)
    (one,) = errors(robot, open_program(tmp_path / "main.toml"))
    assert isinstance(one.reason, CallUnread) and "a CSV names no robot" in one.what


def test_saved_programs_call_saved_programs_only(robot: Robot, tmp_path: Path) -> None:
    kept(tmp_path, lib_secret=(HOME,), main=(HOME,))
    folder = tmp_path / "saved"
    folder.mkdir()
    library = SavedPrograms(folder)
    save_program(program(HOME), library.path("pick up"))
    assert library.names() == ["pick up"]
    assert errors(robot, library.link(program(call("pick up")))) == []
    for name in ("../lib/secret", str(tmp_path / "main.toml"), "grip"):
        (one,) = errors(robot, library.link(program(HOME, call(name))))
        assert one.step == 1 and isinstance(one.reason, CallMissing) and one.reason.place == "saved"
    assert str(one) == (
        "step 2: no saved program is called 'grip'; bring it in Files: Upload its file, then Save it as "
        "'grip'"
    )


# What cannot be called is refused by name, before a motion.


def test_a_missing_file_is_named_with_the_chain_of_calls(robot: Robot, tmp_path: Path) -> None:
    (one,) = errors(robot, kept(tmp_path, main=(HOME, call("a")), a=(HOME, WaitStep(seconds=1), call("b"))))
    assert one.step == 1
    assert one.reason == InStep((CalledStep("a", 2),), "", CallMissing("b", "beside"))
    assert str(one).startswith("step 2: in 'a', step 3: there is no program 'b' beside")
    (one,) = errors(robot, program(call("b")))  # as a client of the API may send it
    assert one.reason == CallMissing("b", "sent")
    assert check_program(program(call("b")), robot, motions=False) == [one]


def test_one_that_cannot_be_read_says_why(robot: Robot, tmp_path: Path) -> None:
    save_program(program(call("b")), tmp_path / "main.toml")
    (tmp_path / "b.toml").write_text('robot = "uzuner"\n[[steps]]\ndo = "wait"\nseconds = -1\n')
    (one,) = errors(robot, load_program(tmp_path / "main.toml"))
    assert isinstance(one.reason, CallUnread) and "line 4" in one.reason.why
    (tmp_path / "b.toml").write_text('robot = "mico"\n[[steps]]\ndo = "wait"\nseconds = 1\n')
    (one,) = errors(robot, load_program(tmp_path / "main.toml"))
    assert isinstance(one.reason, About) and "'mico'" in one.what and one.what.startswith("b: ")


def test_a_circle_is_refused_with_its_chain(robot: Robot, tmp_path: Path) -> None:
    (one,) = errors(robot, kept(tmp_path, main=(call("a"),), a=(HOME, call("b")), b=(call("a"),)))
    assert one.step == 0 and isinstance(one.reason, InStep)
    assert one.reason.calls == (CalledStep("a", 1), CalledStep("b", 0))
    assert one.reason.reason == CallCircle(("main", "a", "b", "a"))
    assert "main → a → b → a" in str(one)
    (one,) = errors(robot, kept(tmp_path, main=(call("main"),)))
    assert "main → main" in str(one)


def test_depth_and_length_are_bounded(robot: Robot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    steps = {f"p{k}": (call(f"p{k + 1}"), HOME) for k in range(DEEPEST - 1)} | {f"p{DEEPEST - 1}": (HOME,)}
    assert errors(robot, kept(tmp_path, main=(call("p0"),), **steps)) == []
    steps = {f"p{k}": (call(f"p{k + 1}"), HOME) for k in range(DEEPEST)} | {f"p{DEEPEST}": (HOME,)}
    (one,) = errors(robot, kept(tmp_path, main=(call("p0"),), **steps))
    assert isinstance(one.reason, InStep) and isinstance(one.reason.reason, CallTooDeep)
    monkeypatch.setattr("armctl.program.calls.MOST_STEPS_IN_ALL", 500)
    wide = {f"w{k}": 10 * (call(f"w{k + 1}"),) for k in range(5)} | {"w5": (HOME,)}
    (one,) = errors(robot, kept(tmp_path, main=(call("w0"),), **wide))
    assert one.reason == CallTooLong(500)


# The check sees through.


@pytest.mark.parametrize("bad", [FAR, SUNK])
def test_a_fault_in_a_called_program_on_one_branch_is_found(robot: Robot, tmp_path: Path, bad: Step) -> None:
    main = kept(
        tmp_path,
        main=(HOME, IfStep(watch="button"), call("a"), END, HOME),
        a=(
            RepeatStep(times=3),
            ADD,
            IfStep(watch="counter", counter="n", value=2),
            bad,
            ELSE,
            TURNED,
            END,
            END,
        ),
    )
    one = errors(robot, main)[0]
    assert one.step == 2 and isinstance(one.reason, InStep) and one.reason.calls == (CalledStep("a", 3),)
    path = one.reason.reason
    assert isinstance(path, OnPath)
    assert path.turns == (PathTurn(1, "then"), PathTurn(0, "pass", 2, "a"), PathTurn(2, "then", 0, "a"))
    assert "(path: step 2: yes; a, step 1: pass 2; a, step 3: yes)" in str(one)


def test_where_it_leaves_the_arm_is_followed(robot: Robot, tmp_path: Path) -> None:
    assert errors(robot, kept(tmp_path, main=(HOME, call("a"), NEAR), a=(HOME,))) == []
    (one,) = errors(robot, kept(tmp_path, main=(HOME, call("a"), NEAR), a=(TURNED,)))
    assert one.step == 2


def test_values_and_blocks_of_a_called_program_are_checked(robot: Robot, tmp_path: Path) -> None:
    high = MoveStep(joints_deg=(0, 400, 0, 0, 0))
    (one,) = errors(robot, kept(tmp_path, main=(HOME, call("a"), call("a")), a=(HOME, high)))
    assert one.step == 1 and isinstance(one.reason, InStep) and one.reason.calls == (CalledStep("a", 1),)
    (tmp_path / "a.toml").write_text('robot = "uzuner"\n[[steps]]\ndo = "end"\n')
    (one,) = errors(robot, load_program(tmp_path / "main.toml"))[:1]
    assert one.step == 1


def test_counters_are_shared(robot: Robot, tmp_path: Path) -> None:
    loop = WhileStep(watch="counter", counter="n", compare="below", value=3)
    assert errors(robot, kept(tmp_path, main=(loop, call("a"), END), a=(ADD, HOME))) == []
    wait = WaitForStep(watch="counter", counter="n", value=2, timeout_s=1)
    assert errors(robot, kept(tmp_path, main=(call("a"), call("a"), wait), a=(ADD,))) == []
    (one,) = errors(robot, kept(tmp_path, main=(call("a"), wait), a=(ADD,)))
    assert one.step == 1


def test_points_of_a_cell_may_be_in_a_called_program(robot: Robot, tmp_path: Path) -> None:
    corner = {"x_mm": 180.0, "y_mm": 0.0, "z_mm": 100.0}
    grid = GridStep(
        **corner, row_x_mm=180, row_y_mm=40, row_z_mm=100, column_x_mm=700, column_y_mm=0, column_z_mm=100,
        rows=2, columns=2,
    )  # fmt: skip
    above = PointStep(x_mm=0, y_mm=0, z_mm=20, frame="cell")
    down = LineStep(x_mm=0, y_mm=0, z_mm=0, frame="cell")
    main = kept(tmp_path, main=(HOME, grid, call("a"), END), a=(above, down))
    one = errors(robot, main)[0]
    assert one.step == 2 and "step 2: cell 3" in str(one)
    for one in errors(robot, kept(tmp_path, main=(call("a"),))):
        assert one.step == 0 and "needs a 'grid' around it" in str(one)


# Scripts.


def test_a_script_calls_functions(tmp_path: Path) -> None:
    main = kept(
        tmp_path,
        main=(WaitStep(seconds=1), RepeatStep(times=2), CallStep(program="lib/a b", note="twice"), END),
        **{"lib_a b": (SpeedStep(percent=50), ADD, call("../c")), "c": (WaitStep(seconds=2),)},
    )
    script = write_script(main)
    compile(script, "script", "exec")
    assert "def run_lib_a_b(arm):\n    'lib/a b'\n    global n_count\n" in script
    assert "    run_c(arm)\n    arm.set_speed(speed_percent)\n" in script
    assert script.index("def run_c(") < script.index("def run_lib_a_b(") < script.index("with armctl")
    assert "        run_lib_a_b(arm)  # twice\n" in script and "    n_count = 0\n" in script
    with pytest.raises(ProgramError, match="step 1: the program 'b' that it calls was not sent along"):
        write_script(program(call("b")))


def test_a_called_program_has_frames_of_its_own_and_those_around_it_do_not_count_in_it(
    tmp_path: Path,
) -> None:
    point = PointStep(x_mm=10, y_mm=20, z_mm=30)
    mine, other = (UserFrame(x_mm=x, y_mm=0, z_mm=0, rz_deg=90) for x in (100, 200))
    inner = Program(robot="uzuner", frames={"table": other}, steps=(point, FrameStep(frame="table"), point))
    save_program(inner, tmp_path / "inner.toml")
    steps = (FrameStep(frame="table"), point, call("inner"), point)
    save_program(Program(robot="uzuner", frames={"table": mine}, steps=steps), tmp_path / "outer.toml")
    whole = WholeProgram.of(load_program(tmp_path / "outer.toml"))
    cursor, places = Cursor(whole.flat), list[tuple[float, ...]]()
    while (found := cursor.next()) is not None:
        if isinstance(found[1], PointStep):
            places.append(tuple(round(value, 6) for value in (found[1].x_mm, found[1].y_mm, found[1].z_mm)))
    assert places == [(80, 10, 30), (10, 20, 30), (180, 10, 30), (80, 10, 30)]


def test_a_frame_that_a_called_program_has_not_is_found_there(tmp_path: Path, robot: Robot) -> None:
    inner = Program(robot=robot.name, steps=(FrameStep(frame="table"), HOME))
    save_program(inner, tmp_path / "inner.toml")
    table = UserFrame(x_mm=0, y_mm=0, z_mm=0)
    outer = Program(robot=robot.name, frames={"table": table}, steps=(call("inner"),))
    save_program(outer, tmp_path / "outer.toml")
    (one,) = check_program(load_program(tmp_path / "outer.toml"), robot, start=robot.pose("home"))
    assert one.step == 0 and isinstance(one.reason, InStep)
    assert one.reason.calls == (CalledStep("inner", 0),) and isinstance(one.reason.reason, UnknownFrame)
