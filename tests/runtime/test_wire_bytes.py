"""The bytes on the wire stay what they were: every part of a session, on every kind of board."""

from __future__ import annotations

import pytest
from tests.runtime.wire_kit import ROBOTS, golden, recorded


@pytest.mark.parametrize("robot", ROBOTS)
def test_a_session_sends_the_bytes_that_were_recorded(robot: str) -> None:
    now, then = recorded(robot), golden(robot)
    for line, (new, old) in enumerate(zip(now, then, strict=False)):
        assert new == old, f"write {line}, after {[one for one in then[:line] if one.startswith('#')][-1]}"
    assert len(now) == len(then)
