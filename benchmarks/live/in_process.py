"""``armctl`` with the arm in the page server's own process, what the split is held against."""

from __future__ import annotations

from typing import Any

from armctl.cli import serve
from armctl.cli.main import main
from armctl.process.host import Host
from armctl.robot import Robot


def _host(robot: Robot, board: str, **_: Any) -> Host:
    return Host(robot, board)


if __name__ == "__main__":
    vars(serve)["start_arm"] = _host
    main()
