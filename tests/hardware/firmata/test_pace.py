from __future__ import annotations

import pytest

from armctl.hardware.firmata.line import BYTE_S, LinePace


def test_a_byte_takes_ten_bits_at_57600_baud():
    assert pytest.approx(173.6e-6, abs=0.05e-6) == BYTE_S


def test_the_line_is_busy_until_its_bytes_are_out():
    pace = LinePace(0.02, 0.9)
    assert pace.waiting(0.0) == 0
    pace.charge(36, 0.0)
    assert pace.waiting(0.0) == 36
    assert pace.waiting(10 * BYTE_S) == 26
    assert pace.waiting(0.0062) == 1
    assert pace.waiting(0.0063) == 0


def test_what_is_written_meanwhile_queues_up():
    pace = LinePace(0.02, 0.9)
    pace.charge(36, 0.0)
    pace.charge(36, 0.001)
    assert pace.waiting(0.0124) == 1
    assert pace.waiting(0.0126) == 0


def test_the_room_is_what_the_backlog_leaves_of_the_share():
    pace = LinePace(0.02, 0.9)
    assert pace.room(0.0) == 103  # 0.9 · 115.2
    pace.charge(60, 0.0)
    assert pace.room(0.0) == 43
    assert pace.room(60 * BYTE_S) == 103
    pace.charge(200, 1.0)
    assert pace.room(1.0) == 0
