"""Which law and how long: one rule for the choice of a movement and for that of a profile."""

from __future__ import annotations

import pytest

from armctl.errors import InputError
from armctl.motion import PROFILES
from armctl.ui.guard import GuardedServer
from armctl.ui.widgets.profile_choice import ALL_PROFILES, MOVEMENTS, Laws, ProfileChoice

BOTH = pytest.mark.parametrize("laws", [ALL_PROFILES, MOVEMENTS], ids=lambda laws: laws[0])


@BOTH
def test_it_begins_with_the_cubic_and_the_duration_is_read(server: GuardedServer, laws: Laws) -> None:
    chosen = ProfileChoice(server.gui, lambda attach, action: None, laws)
    assert chosen.checked() == ("cubic", None)
    for text, seconds in (("", None), ("0", None), ("2.5", 2.5)):
        chosen.duration.handle.value = text
        assert chosen.checked() == ("cubic", seconds)
    chosen.duration.handle.value = "-1"
    with pytest.raises(InputError, match="Duration: -1 s is negative; 0 is the shortest possible"):
        chosen.checked()
    chosen.choose("normal")  # each joint for itself
    chosen.show(profile=True, duration=True, normal=True)
    assert not chosen.duration.visible
    assert chosen.checked() == ("normal", None)


def test_normal_is_offered_only_where_it_means_something(server: GuardedServer) -> None:
    chosen = ProfileChoice(server.gui, lambda attach, action: None, ALL_PROFILES)
    chosen.choose("quintic")
    chosen.show(profile=True, duration=True, normal=False)
    assert chosen.profile == "quintic"
    assert chosen.choice.options == PROFILES
    assert set(ALL_PROFILES[1].values()) == {*PROFILES, "normal"}
