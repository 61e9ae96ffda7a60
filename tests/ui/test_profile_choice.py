"""Which law and how long: one rule for the choice of a movement and for that of a profile."""

from __future__ import annotations

import pytest

from armctl.errors import InputError
from armctl.motion import PROFILES
from armctl.ui.guard import GuardedServer
from armctl.ui.widgets.profile_choice import ALL_PROFILES, MOVEMENTS, Laws, ProfileChoice

BOTH = pytest.mark.parametrize("laws", [ALL_PROFILES, MOVEMENTS], ids=lambda laws: laws[0])


def choice(server: GuardedServer, laws: Laws) -> ProfileChoice:
    return ProfileChoice(server.gui, lambda attach, action: None, laws)


@BOTH
def test_it_begins_with_the_cubic_and_the_duration_is_read(server: GuardedServer, laws: Laws) -> None:
    chosen = choice(server, laws)
    assert chosen.checked() == ("cubic", None)
    for text, seconds in (("", None), ("0", None), ("2.5", 2.5)):
        chosen.duration.handle.value = text
        assert chosen.checked() == ("cubic", seconds)
    chosen.duration.handle.value = "-1"
    with pytest.raises(InputError, match="Duration: -1 s is negative; 0 is the shortest possible"):
        chosen.checked()


@BOTH
def test_each_joint_for_itself_has_no_duration(server: GuardedServer, laws: Laws) -> None:
    chosen = choice(server, laws)
    chosen.duration.handle.value = "2.5"
    chosen.choose("normal")
    chosen.show(profile=True, duration=True, normal=True)
    assert not chosen.duration.visible
    assert chosen.checked() == ("normal", None)


def test_normal_is_offered_only_where_it_means_something(server: GuardedServer) -> None:
    chosen = choice(server, ALL_PROFILES)
    chosen.choose("quintic")
    chosen.show(profile=True, duration=True, normal=False)
    assert chosen.profile == "quintic"
    assert set(ALL_PROFILES[1].values()) == {*PROFILES, "normal"}
