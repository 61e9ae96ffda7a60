"""``python -m armctl.process``: the arm process, which ``start_arm`` starts."""

from __future__ import annotations

import asyncio
import ctypes
import logging
import os
import platform
import struct
import sys
import traceback
from contextlib import suppress
from importlib import import_module
from pathlib import Path

import msgspec

from armctl.log_files import begin as begin_log
from armctl.process.server import serve_arm
from armctl.process.start import Start
from armctl.system import outlive_readers

_SLICE_NS = 100_000
_SCHED_SETATTR = {"x86_64": 314, "aarch64": 274}
"""numbers of the system call, of 64-bit programs"""


def _ask_for_short_slices() -> None:
    """Run soon after waking up on a busy computer, for short times; every user may ask Linux for that.

    With four busy programs on two cores a tick comes 0.1 ms late instead of 3.5 (median), 2.7 instead of 8
    (p90). Linux before 6.12 takes no notice.
    """
    number = _SCHED_SETATTR.get(platform.machine())
    if sys.platform == "linux" and sys.maxsize > 2**32 and number is not None:
        size, ordinary, nothing = 48, 0, 0
        wish = struct.pack("=IIQiIQQQ", size, ordinary, 0, os.nice(0), nothing, _SLICE_NS, 0, 0)
        ctypes.CDLL(None).syscall(number, 0, wish, 0)


def main() -> None:
    """The arm process."""
    start = msgspec.msgpack.decode(sys.stdin.buffer.read(), type=Start)
    robot = start.whole_robot()
    outlive_readers()
    _ask_for_short_slices()
    if start.logs:
        logging.basicConfig(level=logging.INFO, format="%(asctime)s %(name)s %(levelname)s %(message)s")
    # What takes a while: here, before a motion waits for it, or a tick.
    _ = robot.inverse_kinematics
    import_module("scipy.optimize")  # and scipy.linalg with it

    def ready(address: str) -> None:
        with suppress(BrokenPipeError):  # who started it is gone: nobody will come
            sys.stdout.write(f"ready {address}\n")
            sys.stdout.close()

    address = None if start.folder is None else Path(start.folder) / f"arm-{os.getpid()}.sock"
    arm = serve_arm(robot, start.board, start.rate_hz, address, start.secret, ready, start.pin)
    status = 1
    try:
        with begin_log("arm"):
            asyncio.Runner().run(arm)
        status = 0
    except BaseException:
        traceback.print_exc()
    finally:
        # The arm stands and its line is closed. Python would wait for threads that plan or decode.
        with suppress(OSError, ValueError):
            sys.stderr.flush()
        os._exit(status)


if __name__ == "__main__":
    main()
