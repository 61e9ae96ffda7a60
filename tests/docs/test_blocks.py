"""Every command and code block of README and docs is carried out; ``NOT_RUN`` names the exceptions.

A block that needs more than this computer says so in its title, which the site shows above it::

    ```bash title="needs a board"
    armctl doctor --port auto --robot abaas
    ```

What needs a board gets a simulated one on a port, what runs until Ctrl-C is started and interrupted,
what needs a running console gets one, and questions are answered. ``sudo``, ``ssh``, ``mkcert`` and
programs that change the system are small scripts of this test. Packages come without the network: one of
this repository here, the wheel in tests/test_wheel.py. What takes minutes is started in its quick form.
Any other title names the file that a block holds; later blocks of the page may use it.
"""

from __future__ import annotations

import getpass
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
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from functools import cache
from itertools import chain, pairwise
from pathlib import Path
from xml.etree import ElementTree
from zipfile import ZipFile

import matplotlib as mpl
import pytest
from tests.arms import BENCH_URDF, quick_arms
from tests.browser.serving import serving
from tests.cli.simulating import simulated
from tests.docs.pages import ROOT, Block, blocks, reading_pages
from tests.test_wheel import NETWORK

import armctl
from armctl.boards import setup_of
from armctl.cli.main import DONE, run
from armctl.hardware.boards import board_type
from armctl.hardware.simulation import BoardServer
from armctl.program import check_program, decode_program
from armctl.protocol import MonotonicClock
from armctl.robot import robots_folder
from armctl.robot.load import robot_of

BOARD, ENDLESS, CONSOLE = "needs a board", "runs until Ctrl-C", "needs a running console"
QUESTIONS, ADMINISTRATOR = "asks questions", "needs administrator rights"
ELSEWHERE, LONG = "on another computer", "takes minutes"
NOT_RUN = {
    "make test": "CI runs it: .ci/run is this command",
    "make bench-live": "two minutes even with the smallest options; make -n and its module with --help",
}
"""commands that are only checked, and why"""
ANSWERS = {"calibrate": "y\n-80\n-40\n0\n40\n80\nn\n"}
"""to what a command of armctl asks: the arm may move, angles that are read, nothing is saved"""
SYSTEM = {
    "sudo": 'exec "$@"',
    "usermod": '[ "$1" = -aG ] && getent group "$2" && id "$3"',
    "udevadm": '[ "$*" = "control --reload" ] || [ "$*" = trigger ]',
    "ssh": """[ "$1 $2" = "-t -L" ] && [ "${3%%:*}" = "${3##*:}" ] && [ "${4#*@}" != "$4" ] || exit 2
        shift 4; echo "$@" """,
    "mkcert": """[ "$1 $3" = "-cert-file -key-file" ] && [ $# -gt 4 ] || exit 2
        exec openssl req -x509 -newkey rsa:2048 -nodes -subj "/CN=$5" -out "$2" -keyout "$4" 2>/dev/null""",
    "tee": 'mkdir -p "$STAGE${1%/*}" && exec /usr/bin/tee "$STAGE$1"',
}
"""programs that change this computer or need another; here they check their words, or change a copy"""
PORTS = re.compile(r"auto|/dev/ttyACM0")
SHOWN = {"text", "csv", "javascript", "html", "yaml", "ini", "powershell", "mermaid", "cpp", "svg"}
"""languages that are only shown"""
PATHS = re.compile(r"(?:examples|docs|robots|firmware|tests|benchmarks|src)/[\w./*-]+")
SNIPPET = re.compile(r'--8<-- "([^":]+)(?::\w+)*"')
"""what the site takes from a file, which has a test of its own"""


def all_blocks() -> list[Block]:
    return [block for page in reading_pages() for block in blocks(page)]


@cache
def first_places() -> dict[tuple[str, str], str]:
    """Where a command stands first, by its title and words: what takes seconds is carried out there only."""
    places: dict[tuple[str, str], str] = {}
    for block in all_blocks():
        if block.language == "bash":
            for words in commands(block.text):
                places.setdefault((block.title, shlex.join(words)), block.place)
    return places


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
        if included := SNIPPET.fullmatch(block.text.strip()):
            assert (ROOT / included[1]).is_file(), f"{block.place}: there is no {included[1]}"
            continue
        match block.language:
            case "bash" if block.title == ADMINISTRATOR:
                with_programs(block, stage)
                for path in re.findall(r"sudo tee (\S+)", block.text):
                    assert "SUBSYSTEM" in Path(f"{stage}{path}").read_text(), block.place
            case "bash" if block.title == ELSEWHERE:
                called_there = shlex.split(with_programs(block, stage))
                if called_there:  # what ssh would start on the computer with the arm
                    assert called_there[0] == "armctl", block.place
                    with serving(stage, *called_there[1:]):
                        pass
                else:
                    ssl.create_default_context().load_cert_chain("cert.pem", "key.pem")
            case "bash" if block.title == NETWORK:
                assert page == ROOT / "docs" / "install.md"  # whose blocks tests/test_wheel.py carries out
            case "bash":
                for words in commands(block.text):
                    here = [on_stage(word, block, stage) for word in words]
                    try_command(block, here, runs, capsys=capsys)
            case "python" if block.title == CONSOLE:
                with serving(stage, "--port", "sim") as link:
                    text = re.sub(r'"http://[^"]*", token="…"', repr(link), block.text)
                    assert text != block.text, block.place
                    exec(compile(text, block.place, "exec"), names)
            case "python":
                exec(compile(block.text, block.place, "exec"), names)
            case "toml":
                try_toml(block)
            case "json":
                json.loads(block.text)
            case "xml":
                ElementTree.fromstring(block.text)
            case language:
                assert language in SHOWN, f"{block.place}: nobody knows how to check {language!r}"
        if block.title and "." in block.title:
            (stage / block.title).write_text(block.text, encoding="utf-8")


def test_what_only_is_checked_is_still_in_the_pages() -> None:
    code = [block for block in all_blocks() if block.language == "bash"]
    assert len(code) > 10
    found = {shlex.join(words) for block in code for words in commands(block.text)}
    assert found >= NOT_RUN.keys()
    assert (ROOT / ".ci" / "run").read_text().rstrip().endswith("exec make test")


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


def with_programs(block: Block, stage: Path) -> str:
    """Run a block in a shell that cannot change this computer; gives what it prints."""
    known = {"USER": getpass.getuser(), "STAGE": str(stage)}
    return block.run(stage / "programs", SYSTEM, Path.cwd(), **known)


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
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Carry a command out; in its quick form where it takes minutes."""
    line = f"{block.place}: {shlex.join(words)}"
    for word in words[1:]:
        if path := PATHS.fullmatch(word):
            assert list(ROOT.glob(path[0])), f"{line}: there is no {path[0]}"
    elsewhere = first_places().get((block.title, shlex.join(words)), block.place) != block.place
    match words[0], words[1:]:
        case "make" | "pip", ["run" | "install", *_] if elsewhere:
            pass  # the very same command
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
        case "pip", ["install", path]:
            options = ["--no-index", "--no-deps", "--no-build-isolation", "--target", "site"]
            shell = [sys.executable, "-m", "pip", "install", "--quiet", *options, str(ROOT / path)]
            subprocess.run(shell, check=True)
        case (("armctl" | ".venv/bin/armctl"), rest):
            capsys.readouterr()
            with pytest.MonkeyPatch.context() as patch:
                patch.setattr("sys.stdin", io.StringIO(ANSWERS.get(rest[0], "")))
                status = run(rest)
            assert status == DONE, f"{line}\n{capsys.readouterr().err}"
        case "make", ["-C", folder, *rest]:
            said(["make", "-n", "-C", str(ROOT / folder), *rest])
        case "make", [target]:
            planned = said(["make", "-n", "-C", str(ROOT), target])
            assert target == "bench" or shlex.join(words) in NOT_RUN, line
            if target == "bench":
                assert "bin/python -m benchmarks \n" in planned, line
                table = said([sys.executable, "-m", "benchmarks", "--quick", "--only", "forward"], missed=1)
                assert "| uzuner, forward" in table, line
            if target == "bench-live":
                assert "bin/python -m benchmarks.end_to_end \n" in planned, line
                assert "--stops" in said([sys.executable, "-m", "benchmarks.end_to_end", "--help"]), line
        case "python", [script] if Path("site").exists():  # a package was installed for it
            places = os.pathsep.join(["site", *sys.path])
            subprocess.run([sys.executable, script], check=True, env=os.environ | {"PYTHONPATH": places})
        case "python", [script, *_] if script.startswith("examples/"):
            pass  # there, and tried by tests/examples
        case "cd", _:
            pass
        case program, _:
            pytest.fail(f"{line}: nobody knows how to carry out {program}")


def said(words: Sequence[str], *, missed: int = 0) -> str:
    """What a program prints; it ends with 0, or with the status of a speed goal that this machine missed."""
    places = os.pathsep.join([str(ROOT), *sys.path])
    of_make = {"ARGS", "MAKEFLAGS", "MAKELEVEL", "MFLAGS"}  # of the make that runs these tests
    known = {name: text for name, text in os.environ.items() if name not in of_make}
    done = subprocess.run(
        words, capture_output=True, text=True, env=known | {"PYTHONPATH": places}, check=False
    )
    assert done.returncode in (0, missed), f"{shlex.join(words)}: {done.stderr}"
    return done.stdout


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
