"""armctl on a system without Unix's terminals, groups and sockets: ``WITHOUT_UNIX`` takes them away."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from unittest import mock

import numpy as np
import pytest
from tests.browser.serving import serving

import armctl
from armctl.system import group_of, is_pseudo_terminal, joined_since_login, may_open, whose

# Every Python process that is started with this on its path runs it first, so the arm process does, too.
WITHOUT_UNIX = """
import asyncio, asyncio.unix_events, builtins, functools, os, selectors, signal, socket, stat
import platformdirs.unix  # it has another module for Windows

LACKING = {"fcntl", "grp", "pty", "pwd", "resource", "termios", "tty"}
imported = builtins.__import__


def import_without(name, names=None, *rest, **options):
    if name in LACKING and str((names or {}).get("__name__")).startswith("armctl"):
        raise ImportError(f"No module named {name!r}", name=name)  # other packages have versions for Windows
    return imported(name, names, *rest, **options)


class OnlySockets(selectors.SelectSelector):
    def register(self, one, *rest):
        assert stat.S_ISSOCK(os.fstat(one if isinstance(one, int) else one.fileno()).st_mode), one
        return super().register(one, *rest)


def lacking(self, *_):
    raise NotImplementedError


builtins.__import__ = import_without
socket.socketpair = functools.partial(socket.socketpair, socket.AF_UNIX)
for owner, names in (
    (os, "getuid geteuid getgroups killpg openpty set_blocking setsid ttyname"),
    (socket, "AF_UNIX recv_fds send_fds"),
    (signal, "SIGHUP SIGPIPE"),
    (asyncio, "start_unix_server open_unix_connection"),
    (selectors, "PollSelector EpollSelector"),
):
    for name in names.split():
        delattr(owner, name)
selectors.SelectSelector = selectors.DefaultSelector = OnlySockets
asyncio.SelectorEventLoop.add_reader = asyncio.SelectorEventLoop.add_signal_handler = lacking
"""


@pytest.fixture
def without_unix(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Python processes that are started from here lack what Windows lacks."""
    (tmp_path / "sitecustomize.py").write_text(WITHOUT_UNIX)
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(tmp_path), *filter(None, sys.path)]))


@pytest.mark.usefixtures("without_unix")
def test_every_module_can_be_imported() -> None:
    code = """if True:
        import importlib, pkgutil, sys, armctl
        for one in pkgutil.walk_packages(armctl.__path__, "armctl."):
            if not one.name.endswith("__main__"):
                importlib.import_module(one.name)
        import armctl.system
        assert armctl.system.open_pseudo_terminal() is None
        print(sum(name.startswith("armctl.") for name in sys.modules))
    """
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert int(done.stdout) > 200


@pytest.mark.usefixtures("without_unix")
def test_the_console_moves_the_simulated_arm(tmp_path: Path) -> None:
    with serving(tmp_path) as link, armctl.Arm.connect(link) as arm:
        board = arm.snapshot.board
        assert board is not None and board.simulated and board.port.startswith("socket://127.0.0.1:")
        arm.enable()
        arm.go(x_mm=220, y_mm=-60, z_mm=100)
        assert np.allclose(arm.position_mm, (220, -60, 100), atol=0.01)


def test_what_windows_does_not_tell() -> None:
    with mock.patch.object(os, "name", "nt"):
        assert may_open("COM3")  # told when it is opened
        assert whose(os.getpid()) == "unknown"  # to ask would end it
    with mock.patch.dict(sys.modules, {"grp": None, "pwd": None}):
        assert group_of("/dev/null") is None
        assert not joined_since_login("dialout")


@pytest.mark.parametrize(
    ("device", "is_one"),
    [
        ("/dev/pts/7", True),
        ("/dev/ttys004", True),  # macOS
        ("/dev/ttyS0", False),
        ("/dev/tty.usbmodem1", False),
        ("/dev/cu.usbmodem1", False),
        ("COM3", False),
        ("socket://127.0.0.1:5", False),
    ],
)
def test_a_pseudo_terminal_is_told_by_its_name(device: str, is_one: bool) -> None:
    assert is_pseudo_terminal(device) is is_one
