"""Who may open a device file, and what a user who may not has to do."""

from __future__ import annotations

import grp
import os
import pwd
from importlib import resources
from pathlib import Path

UDEV_RULES_NAME = "70-armctl.rules"
UDEV_COMMAND = f"armctl ports --udev | sudo tee /etc/udev/rules.d/{UDEV_RULES_NAME}"
_USUAL_GROUP = "dialout"


def may_open(device: str) -> bool:
    """Whether this process may read and write ``device``."""
    return os.access(device, os.R_OK | os.W_OK)


def permission_hint(device: str) -> str:
    """What gives this user access to ``device``: the line with the group that owns it, or the udev rule."""
    group = _group_of(device)
    if _joined_since_login(group):
        return (
            f"you are in the group {group} already, but this login began before that: log out and in again "
            "(a new terminal is not enough)"
        )
    return (
        f"run `sudo usermod -aG {group} $USER`, then log out and in again "
        f"(a new terminal is not enough); or install the udev rule: `{UDEV_COMMAND}`, then plug it in again"
    )


def udev_rules() -> str:
    """The rules file that gives whoever sits at the computer access to the boards' ports."""
    return resources.files("armctl.hardware").joinpath(UDEV_RULES_NAME).read_text(encoding="utf-8")


def _group_of(device: str) -> str:
    """The group of the device file; distributions differ (dialout, uucp)."""
    try:
        group = grp.getgrgid(Path(device).stat().st_gid).gr_name
    except (OSError, KeyError):
        return _USUAL_GROUP
    # A device that belongs to root's own group has no group to join: udev has not set it up.
    return _USUAL_GROUP if group == "root" else group


def _joined_since_login(group: str) -> bool:
    """Whether this user is listed in the group, and this process does not know it yet."""
    try:
        entry, user = grp.getgrnam(group), pwd.getpwuid(os.getuid()).pw_name
    except KeyError:
        return False
    return user in entry.gr_mem and entry.gr_gid not in os.getgroups()
