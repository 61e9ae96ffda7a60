"""A symlink with a name of the user's choice to a pty, which has none of its own."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

from armctl.errors import PortError

_PTY_FOLDER = "/dev/pts/"


class DeviceLink:
    """A symlink to a pty, made on construction and removed on ``remove``.

    Args:
        path: where the link goes.
        device: the pty that it points to.

    Raises:
        PortError: something is there that is not a stale link of an earlier simulator.
    """

    def __init__(self, path: Path, device: str) -> None:
        self._path = path
        self._device = device
        if _is_stale(path, device):
            path.unlink()
        elif path.is_symlink() or path.exists():
            raise PortError(
                f"{path}: already there, and not a left-over of a simulator; "
                "choose another name, or remove it if no simulator is running"
            )
        try:
            path.symlink_to(device)
        except OSError as error:
            raise PortError(
                f"{path}: no link can be made there ({error.strerror}); choose another place"
            ) from error

    def remove(self) -> None:
        """Take the link away, unless somebody has put something else in its place."""
        with suppress(OSError):
            if self._path.is_symlink() and str(self._path.readlink()) == self._device:
                self._path.unlink()


def _is_stale(path: Path, device: str) -> bool:
    """Whether ``path`` is a link to a pty that is gone, or to the one that is ours now.

    The kernel gives pty numbers out again, so the left-over of a crash may well point to our own.
    """
    if not path.is_symlink():
        return False
    target = str(path.readlink())
    return target == device or (target.startswith(_PTY_FOLDER) and not Path(target).exists())
