from __future__ import annotations

from armctl.hardware.maestro.clamp_watch import Clamped, ClampWatch


def test_a_channel_that_stands_still_elsewhere_is_clamped():
    watch = ClampWatch(patience_s=0.2)
    assert watch.observe({2: 2100.0}, {2: 2000.0}, 0.0) == ()
    assert watch.observe({2: 2100.0}, {2: 2000.0}, 0.19) == ()
    found = watch.observe({2: 2100.0}, {2: 2000.0}, 0.2)
    assert found == (Clamped(2, 2100.0, 2000.0),)
    assert str(found[0]).startswith("channel 2: 2100 µs was asked for, but the board stays at 2000 µs")


def test_a_channel_on_its_way_is_not():
    watch = ClampWatch(patience_s=0.2)
    for step in range(50):
        assert watch.observe({0: 2000.0}, {0: 1000.0 + step * 0.5}, step * 0.02) == ()


def test_a_new_target_starts_the_patience_anew():
    watch = ClampWatch(patience_s=0.2)
    watch.observe({0: 2100.0}, {0: 2000.0}, 0.0)
    assert watch.observe({0: 2101.0}, {0: 2000.0}, 0.3) == ()


def test_at_the_target_or_off_is_not_clamped():
    watch = ClampWatch(patience_s=0.0)
    for now in (0.0, 1.0):
        assert watch.observe({0: 1500.0, 1: 1500.0}, {0: 1500.0, 1: None}, now) == ()


def test_forgetting_starts_anew():
    watch = ClampWatch(patience_s=0.2)
    watch.observe({0: 2100.0}, {0: 2000.0}, 0.0)
    watch.forget()
    assert watch.observe({0: 2100.0}, {0: 2000.0}, 1.0) == ()
