"""Who may open a device file, and what a user who may not has to do."""

from __future__ import annotations

import grp
import os
from pathlib import Path

_USUAL_GROUP = "dialout"


def may_open(device: str) -> bool:
    """Whether this process may read and write ``device``."""
    return os.access(device, os.R_OK | os.W_OK)


def permission_hint(device: str) -> str:
    """The line that gives this user access to ``device``, with the group that owns it."""
    return (
        f"run `sudo usermod -aG {_group_of(device)} $USER`, then log out and in again "
        "(a new terminal is not enough)"
    )


def _group_of(device: str) -> str:
    """The group of the device file; distributions differ (dialout, uucp)."""
    try:
        group = grp.getgrgid(Path(device).stat().st_gid).gr_name
    except (OSError, KeyError):
        return _USUAL_GROUP
    # A device that belongs to root's own group has no group to join: udev has not set it up.
    return _USUAL_GROUP if group == "root" else group
