"""Every command and code block of README and docs is carried out, or checked where it cannot be.

A block that cannot be carried out in a test says why in its title, which the site shows above it::

    ```bash title="needs a board"
    armctl doctor --port auto --robot abaas
    ```

Its commands are then only read: commands, options and files must be there. Most are carried out all the
same: what needs a board gets a simulated one on a port, what runs until Ctrl-C is started and interrupted,
what needs a running console gets one, questions are answered, what needs administrator rights gets a
``sudo`` and system programs of this test, and a package of this repository is installed without the network.
Any other title names the file that a block holds; later blocks of the page may use it.
"""

from __future__ import annotations

import ast
import getpass
import inspect
import io
import json
import os
import re
import shlex
import shutil
import ssl
import subprocess
import sys
import tomllib
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from itertools import chain, pairwise
from pathlib import Path
from typing import cast
from xml.etree import ElementTree
from zipfile import ZipFile

import click
import matplotlib as mpl
import pytest
from tests.arms import BENCH_URDF, quick_arms
from tests.browser.serving import serving
from tests.cli.simulating import simulated
from tests.docs.pages import ROOT, Block, blocks, reading_pages

import armctl
from armctl.boards import setup_of
from armctl.cli.main import DONE, cli, run
from armctl.hardware.boards import board_type
from armctl.hardware.simulation import BoardServer
from armctl.program import check_program, decode_program
from armctl.robot import robots_folder
from armctl.robot.load import robot_of
from armctl.runtime import MonotonicClock

BOARD, ENDLESS, CONSOLE = "needs a board", "runs until Ctrl-C", "needs a running console"
QUESTIONS, ADMINISTRATOR = "asks questions", "needs administrator rights"
NOT_RUN = {"on another computer", "needs the network", "takes minutes"}
"""titles of blocks that are only checked"""
AT_MOST = 0.15
"""share of the blocks that may have one"""
ANSWERS = {"calibrate": "y\n-80\n-40\n0\n40\n80\nn\n"}
"""to what a command of armctl asks: the arm may move, angles that are read, nothing is saved"""
SYSTEM = {
    "sudo": 'exec "$@"',
    "usermod": '[ "$1" = -aG ] && getent group "$2" && id "$3"',
    "udevadm": '[ "$*" = "control --reload" ] || [ "$*" = trigger ]',
    "tee": 'mkdir -p "$STAGE${1%/*}" && exec /usr/bin/tee "$STAGE$1"',
}
"""programs that would change this computer; here they look at what they are asked, or change a copy"""
PORTS = re.compile(r"auto|/dev/ttyACM0")
OTHERS = {
    "curl", "git", "mkcert", "pip", "pipx", "scp", "ssh", "uv", "uvx", ".",
    "source", "apt-get", "node", "npm", "avrdude", "arduino-cli", "pytest", "eval", "export",
}  # fmt: skip
"""programs of others, which blocks that are only checked may call"""
SHOWN = {"text", "csv", "javascript", "html", "yaml", "ini", "powershell", "mermaid", "cpp", "svg"}
"""languages that are only shown"""
PATHS = re.compile(r"(?:examples|docs|robots|firmware|tests|benchmarks|src)/[\w./*-]+")
SNIPPET = re.compile(r'--8<-- "([^":]+)(?::\w+)*"')
"""what the site takes from a file, which has a test of its own"""


def all_blocks() -> list[Block]:
    return [block for page in reading_pages() for block in blocks(page)]


@pytest.fixture
def stage(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of armctl as a user sees it, with files of the user's own beside it, and quick arms."""
    (tmp_path / "kept").mkdir()
    quick_arms(tmp_path / "kept", monkeypatch)
    for variable in ("XDG_CONFIG_HOME", "XDG_DATA_HOME", "XDG_STATE_HOME"):
        monkeypatch.setenv(variable, str(tmp_path / "kept" / variable))
    folder = tmp_path / "armctl"
    shutil.copytree(ROOT / "examples", folder / "examples")
    (folder / "robots").symlink_to(robots_folder())
    (folder / "pick.toml").write_bytes((ROOT / "examples" / "pick_and_place.toml").read_bytes())
    (folder / "points.csv").write_bytes((ROOT / "examples" / "square.csv").read_bytes())
    (folder / "my_arm.toml").write_bytes((ROOT / "examples" / "my_arm.toml").read_bytes())
    (folder / "arm.urdf").write_text(BENCH_URDF)
    with ZipFile(folder / "my_arm_description.zip", "w") as archive:
        archive.writestr("my_arm_description/urdf/my_arm.urdf", BENCH_URDF)
    monkeypatch.chdir(folder)
    mpl.use("agg")
    return folder


@pytest.fixture
def runs(stage: Path) -> Iterator[ExitStack]:
    """What goes on beside a page's blocks until its end."""
    with ExitStack() as stack:
        yield stack


@pytest.mark.parametrize("page", reading_pages(), ids=lambda page: str(page.relative_to(ROOT)))
def test_the_blocks_of_a_page(
    page: Path, stage: Path, runs: ExitStack, capsys: pytest.CaptureFixture[str]
) -> None:
    names: dict[str, object] = {"__name__": "__main__"}
    live = "".join(block.text for block in blocks(page) if block.title in (BOARD, ENDLESS, QUESTIONS))
    if PORTS.search(live):
        runs.enter_context(board_on(stage / "board", known="--pose last" in live))
    for block in blocks(page):
        assert block.language, f"{block.place}: a block of code names its language: ```bash, ```text …"
        carried_out = block.title not in NOT_RUN
        if included := SNIPPET.fullmatch(block.text.strip()):
            assert (ROOT / included[1]).is_file(), f"{block.place}: there is no {included[1]}"
            continue
        match block.language:
            case "bash" if block.title == ADMINISTRATOR:
                administer(block, stage)
            case "bash":
                for words in commands(block.text):
                    here = [on_stage(word, block, stage) for word in words]
                    try_command(block, here, runs, carried_out=carried_out, capsys=capsys)
            case "python" if block.title == CONSOLE:
                with serving(stage, "--port", "sim") as link:
                    text = re.sub(r'"http://[^"]*", token="…"', repr(link), block.text)
                    assert text != block.text, block.place
                    exec(compile(text, block.place, "exec"), names)
            case "python" if carried_out:
                exec(compile(block.text, block.place, "exec"), names)
            case "python":
                require_names(block)
            case "toml":
                try_toml(block)
            case "json":
                json.loads(block.text)
            case "xml":
                ElementTree.fromstring(block.text)
            case language:
                assert language in SHOWN, f"{block.place}: nobody knows how to check {language!r}"
        if carried_out and block.title and "." in block.title:
            (stage / block.title).write_text(block.text, encoding="utf-8")


def test_most_blocks_are_carried_out() -> None:
    code = [block for block in all_blocks() if block.language not in SHOWN]
    titled = [block for block in code if block.title in NOT_RUN]
    assert len(code) > 10
    assert len(titled) <= AT_MOST * len(code), [block.place for block in titled]


def commands(text: str) -> Iterator[list[str]]:
    """The commands of a shell script, without comments, redirections and variables before them."""
    for line in text.replace("\\\n", " ").splitlines():
        lexer = shlex.shlex(re.sub(r"(^|\s)#.*", "", line), posix=True, punctuation_chars=";|&<>")
        lexer.commenters = ""  # elsewhere a # is part of a word, as in arm.urdf#tool0
        lexer.whitespace_split = True
        words: list[str] = []
        redirected = False
        for word in lexer:
            if set(word) <= set(";|&"):
                if words:
                    yield words
                words, redirected = [], False
            elif set(word) <= set("<>"):
                redirected = True
            elif not redirected and not (not words and re.fullmatch(r"[A-Z_]+=.*", word)):
                words.append(word)
        if words:
            yield words


@contextmanager
def board_on(link: Path, *, known: bool) -> Iterator[None]:
    """A simulated Maestro at a path; where its pose is ``known``, the arm was left in its rest pose."""
    robot = armctl.load_robot("uzuner")
    board = board_type(robot.board).simulated(setup_of(robot), {})
    with BoardServer(board, MonotonicClock.now, link=link):
        if known:
            with armctl.Arm.open("uzuner", str(link)) as arm:
                arm.enable(pose="rest")
        yield


def administer(block: Block, stage: Path) -> None:
    """Run a block in a shell that cannot change this computer."""
    programs = stage / "programs"
    programs.mkdir(exist_ok=True)
    for name, script in SYSTEM.items():
        (programs / name).write_text(f"#!/bin/sh\n{script}\n")
        (programs / name).chmod(0o755)
    places = os.pathsep.join([str(programs), str(Path(sys.executable).parent), os.environ["PATH"]])
    known = {"PATH": places, "USER": getpass.getuser(), "STAGE": str(stage)}
    shell = ["bash", "-e", "-o", "pipefail", "-c", block.text]
    done = subprocess.run(shell, env=os.environ | known, capture_output=True, text=True, check=False)
    assert done.returncode == 0, f"{block.place}: {done.stderr}"
    for path in re.findall(r"sudo tee (\S+)", block.text):
        assert "SUBSYSTEM" in Path(f"{stage}{path}").read_text(), block.place


def on_stage(word: str, block: Block, stage: Path) -> str:
    """A word of a command, with the names of boards and links of this stage."""
    if block.title not in (BOARD, ENDLESS, QUESTIONS):
        return word
    return PORTS.sub(str(stage / "board"), re.sub(r"^/tmp/", f"{stage}/", word))


def try_command(
    block: Block,
    words: Sequence[str],
    runs: ExitStack,
    *,
    carried_out: bool,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Carry a command out, or look at whether it could be."""
    line = f"{block.place}: {shlex.join(words)}"
    for word in words[1:]:
        if path := PATHS.fullmatch(word):
            assert list(ROOT.glob(path[0])), f"{line}: there is no {path[0]}"
    match words[0], words[1:]:
        case "make", ["run", *rest] if block.title in (BOARD, ENDLESS):
            asked = [shlex.split(one.removeprefix("ARGS=")) for one in rest]
            with serving(Path.cwd(), *chain.from_iterable(asked)):
                pass
        case "armctl", ["serve", *rest] if block.title == ENDLESS:
            with serving(Path.cwd(), *rest):
                pass
        case "armctl", ["simulate", *rest] if block.title == ENDLESS:
            runs.enter_context(simulated(*rest))
        case "node", _ if block.title == CONSOLE:
            pass  # there, and tried by tests/test_api_example.py
        case "openssl", rest:
            subprocess.run(words, check=True, capture_output=True)
            made = dict(pairwise(rest))
            ssl.create_default_context().load_cert_chain(made["-out"], made["-keyout"])
        case "pip", ["install", path] if carried_out:
            options = ["--no-index", "--no-deps", "--no-build-isolation", "--target", "site"]
            shell = [sys.executable, "-m", "pip", "install", "--quiet", *options, str(ROOT / path)]
            subprocess.run(shell, check=True)
        case (("armctl" | ".venv/bin/armctl"), rest) if carried_out:
            capsys.readouterr()
            with pytest.MonkeyPatch.context() as patch:
                patch.setattr("sys.stdin", io.StringIO(ANSWERS.get(rest[0], "")))
                status = run(rest)
            assert status == DONE, f"{line}\n{capsys.readouterr().err}"
        case "armctl", rest:
            require_usage(rest, line)
        case "make", ["-C", folder, *_]:
            assert (ROOT / folder / "Makefile").is_file(), line
        case "make", [target, *rest]:
            assert re.search(rf"^{target}:", (ROOT / "Makefile").read_text(), re.MULTILINE), line
            for option in rest:
                if option.startswith("ARGS=") and target == "run":
                    require_usage(["serve", *shlex.split(option.removeprefix("ARGS="))], line)
        case "python", [script] if Path("site").exists():  # a package was installed for it
            places = os.pathsep.join(["site", *sys.path])
            subprocess.run([sys.executable, script], check=True, env=os.environ | {"PYTHONPATH": places})
        case "python", [script, *_] if script.startswith("examples/"):
            pass  # there, and tried by tests/examples
        case "python", ["-m", module, *_] if not carried_out:
            assert (ROOT / module.replace(".", "/")).exists() or module in ("venv", "pip", "build"), line
        case "cd", _:
            pass
        case program, _:
            assert not carried_out, f"{line}: give the block a title, one of {', '.join(sorted(NOT_RUN))}"
            assert program in OTHERS or program.endswith("/armctl"), f"{line}: nobody knows {program}"


def require_usage(words: Sequence[str], line: str) -> None:
    """Refuse a command line of armctl that its parser refuses; nothing is carried out."""
    command, rest, context = cast("click.Command", cli), list(words), None
    try:
        while isinstance(command, click.Group):
            context = command.make_context(command.name, rest, parent=context)
            rest = [*context._protected_args, *context.args]
            if not rest:
                return
            _, found, rest = command.resolve_command(context, rest)
            assert found is not None, line
            command = found
        command.make_context(command.name, rest, parent=context)
    except click.exceptions.Exit as ended:  # --help, --version
        assert ended.exit_code == 0, line
    except click.ClickException as refusal:
        pytest.fail(f"{line}: {refusal.format_message()}")


def require_names(block: Block) -> None:
    """Refuse a script that is not Python, and calls of ``arm`` and ``armctl`` that are not there."""
    known: dict[str, object] = {"arm": armctl.Arm, "armctl": armctl, "robot": armctl.Robot, "Arm": armctl.Arm}
    for node in ast.walk(ast.parse(block.text, block.place)):
        if not (isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute)):
            continue
        owner = ast.unparse(node.func.value)
        thing: object = armctl.Arm if owner == "armctl.Arm" else known.get(owner)
        if thing is None:
            continue
        function: Callable[..., object] = getattr(thing, node.func.attr)
        allowed = inspect.signature(function).parameters
        for keyword in node.keywords:
            assert keyword.arg in allowed, f"{block.place}: {ast.unparse(node.func)} has no {keyword.arg}"


def try_toml(block: Block) -> None:
    """Read a whole robot file or program as armctl does; a part of one must be TOML with known tables."""
    record = tomllib.loads(block.text)
    if "steps" in record and "robot" in record:
        program = decode_program(block.text)
        findings = check_program(program, armctl.load_robot(program.robot))
        assert [one for one in findings if one.severity == "error"] == [], block.place
    elif "dh" in record and "format" in record:
        robot_of(block.text.encode())
    elif record.keys() <= {"obstacles", "capsules"}:  # what the robot file of uzuner leaves out
        uzuner = (robots_folder() / "uzuner.toml").read_text(encoding="utf-8")
        robot_of(f"{uzuner}\n{block.text}".encode())
