"""What a robot file says of bus servos besides their map: how strong they may be, and their supply."""

from __future__ import annotations

from pathlib import Path

import pytest
from tests.hardware.bus_kit import BusBench

import armctl
from armctl.errors import BoardTimeoutError, RobotFileError
from armctl.hardware.bus import BusSettings
from armctl.hardware.bus.line import BusLine
from armctl.hardware.feetech.make import FeetechMake
from armctl.robot import load_robot

SO101 = (Path(armctl.__file__).parents[2] / "robots/so101.toml").read_text(encoding="utf-8")
LIFT = "range_steps = [910, 3186]"


def arm(folder: Path, *changes: tuple[str, str]) -> BusBench:
    """An SO-101 whose file is changed."""
    text = SO101
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    path = folder / "changed.toml"
    path.write_text(text, encoding="utf-8")
    return BusBench(load_robot(path))


def limits(bench: BusBench) -> list[int]:
    return [one.get("torque_limit") for one in bench.bus.servos]


def test_joints_have_all_of_their_torque_and_the_gripper_half_where_the_file_says_nothing() -> None:
    settings = load_robot("so101").board_settings
    assert settings == BusSettings((*((servo, 1.0) for servo in range(1, 6)), (6, 0.5)))
    bench = BusBench().open()
    assert bench.enable() is None
    assert limits(bench) == [1000] * 5 + [500]


def test_a_file_says_how_strong_each_servo_may_be(tmp_path: Path) -> None:
    bench = arm(
        tmp_path,
        (LIFT, f"{LIFT}, torque_percent = 70"),
        ("open_steps = 3186", "open_steps = 3186, torque_percent = 30"),
    ).open()
    assert bench.enable() is None
    assert limits(bench) == [1000, 700, 1000, 1000, 1000, 300]
    assert bench.back.limits[2].load == 0.7  # it cannot press with more; the EEPROM's 80 % are beyond
    assert bench.back.limits[1].load == 0.8
    bench.driver.limit_torque({2: 0.5})
    assert limits(bench)[1] == 350  # a share of what the file allows


@pytest.mark.parametrize("percent", ["4", "101", "true"])
def test_a_torque_that_is_none_is_refused_with_its_place(tmp_path: Path, percent: str) -> None:
    with pytest.raises(RobotFileError, match="torque_percent"):
        arm(tmp_path, (LIFT, f"{LIFT}, torque_percent = {percent}"))


def test_a_second_servo_of_a_joint_has_a_torque_of_its_own(tmp_path: Path) -> None:
    also = "also = [{ channel = 7, zero_steps = 2048, steps_per_deg = -11.3778, range_steps = [910, 3186]"
    bench = arm(tmp_path, (LIFT, f"{LIFT}, torque_percent = 70, {also}, torque_percent = 60 }}]"))
    assert dict(bench.robot.board_settings.torque)[7] == 0.6  # pyright: ignore


def test_the_supply_is_that_of_the_file_or_the_highest_that_was_measured(tmp_path: Path) -> None:
    told = arm(tmp_path, ('kind = "feetech"', 'kind = "feetech"\nsupply_v = 7.4')).open()
    assert {one.supply_v for one in told.back.limits.values()} == {7.4}
    measured = BusBench().open()
    measured.bus.supply.open_v = 11.0
    assert {one.supply_v for one in measured.ticks(5).limits.values()} == {12.0}


def test_torque_that_is_taken_away_comes_back_in_the_servo_with_the_release() -> None:
    bench = BusBench().open()
    assert bench.enable() is None
    bench.driver.scale_torque(0.4)
    assert limits(bench) == [400] * 5 + [200]
    back = bench.ticks(5)  # it is not taken for a servo that has started anew
    assert back.faults == {} and all(one.driven for one in bench.bus.servos)
    bench.driver.release()
    assert limits(bench) == [1000] * 5 + [500]
    assert not any(one.driven for one in bench.bus.servos)


def test_all_others_have_less_torque_where_one_does_not_confirm(monkeypatch: pytest.MonkeyPatch) -> None:
    bench = BusBench().open()
    assert bench.enable() is None
    limit = FeetechMake.limit_torque
    monkeypatch.setattr(
        FeetechMake,
        "limit_torque",
        lambda make, line, servo, share: servo != 3 and limit(make, line, servo, share),
    )
    with pytest.raises(BoardTimeoutError, match="servo 3 did not confirm the torque limit"):
        bench.driver.scale_torque(0.4)
    assert limits(bench) == [400, 400, 1000, 400, 400, 200]


@pytest.mark.parametrize("taken", [True, False])
def test_a_limit_that_was_not_confirmed_is_the_one_that_the_next_reading_tells(
    monkeypatch: pytest.MonkeyPatch, taken: bool
) -> None:
    bench = BusBench().open()
    assert bench.enable() is None
    limit = FeetechMake.limit_torque

    def not_heard(make: FeetechMake, line: BusLine, servo: int, share: float) -> bool:
        return bool((taken or servo != 3) and limit(make, line, servo, share) and servo != 3)

    with monkeypatch.context() as lossy:
        lossy.setattr(FeetechMake, "limit_torque", not_heard)
        for ask in (lambda: bench.driver.limit_torque({3: 0.7}), lambda: bench.driver.scale_torque(0.4)):
            with pytest.raises(BoardTimeoutError, match="servo 3 did not confirm the torque limit"):
                ask()
            assert bench.ticks(5).faults == {} and all(one.driven for one in bench.bus.servos)
    assert limits(bench) == [400, 400, 280 if taken else 1000, 400, 400, 200]
    bench.driver.scale_torque(1.0)
    assert limits(bench) == [1000, 1000, 700 if taken else 1000, 1000, 1000, 500]
    bench.bus.servo(3).put("torque_limit", 300)  # nobody told it that
    assert "servo 3 has switched its torque off" in bench.ticks(5).faults[3]


def test_a_dynamixel_has_less_pwm_and_all_of_it_again() -> None:
    bench = BusBench("open_manipulator_x").open()
    assert bench.enable() is None
    whole = [one.get("goal_pwm") for one in bench.bus.servos]
    bench.driver.scale_torque(0.2)
    assert [one.get("goal_pwm") for one in bench.bus.servos] == pytest.approx(
        [0.2 * one for one in whole], abs=1
    )
    assert bench.ticks(5).faults == {}
    bench.driver.release()
    assert [one.get("goal_pwm") for one in bench.bus.servos] == whole
