from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from numpy.typing import NDArray

from armctl.errors import InputError, MotionRefusedError
from armctl.motion import JoinedTrajectory, PointToPoint, Sample, preflight, require_clear
from armctl.robot import load_robot

ROBOT = load_robot("uzuner")
HOME = ROBOT.pose("home")


@dataclass(frozen=True)
class Sine:
    """Joint 1 swings once; nothing of it is known in closed form."""

    amplitude: float
    duration: float = 2.0
    lie: float = 1.0
    phase: float = 0.0

    @property
    def start(self) -> NDArray[np.float64]:
        return HOME + self._unit * self.amplitude * np.sin(self.phase)

    @property
    def end(self) -> NDArray[np.float64]:
        return self.start

    def sample(self, t: float | NDArray[np.float64]) -> Sample:
        time = np.asarray(t)[..., None]
        w = 2 * np.pi / self.duration
        u = w * np.clip(time, 0, self.duration) + self.phase
        # (1 - cos) is at rest at both ends; with a phase it is not
        q = HOME + self._unit * self.amplitude * 0.5 * (1 - np.cos(u))
        v = self._unit * self.amplitude * 0.5 * w * np.sin(u) * self.lie
        a = self._unit * self.amplitude * 0.5 * w * w * np.cos(u) * self.lie
        return Sample(q, v, a, np.zeros_like(q))

    @property
    def _unit(self) -> NDArray[np.float64]:
        return np.array([1.0, 0, 0, 0, 0])


def texts(trajectory: object) -> list[str]:
    return [str(finding) for finding in preflight(ROBOT, trajectory)]  # pyright: ignore[reportArgumentType]


def test_good_motions_pass() -> None:
    rest = ROBOT.pose("rest")
    there = PointToPoint.plan(ROBOT, HOME, rest)
    back = PointToPoint.each_for_itself(ROBOT, rest, HOME)
    assert preflight(ROBOT, there) == []
    assert preflight(ROBOT, back) == []
    assert preflight(ROBOT, JoinedTrajectory([there, back])) == []
    assert preflight(ROBOT, Sine(0.3)) == []
    require_clear(ROBOT, there)


def test_a_joint_outside_its_limits_is_named_with_figures() -> None:
    end = HOME.copy()
    end[2] = np.radians(-91.2)
    (text,) = texts(PointToPoint.lasting(HOME, end, 10.0))
    assert text == (
        "Elbow: at 10.00 s, -91.20° is outside -84.36° … 95.07°; "
        "keep away from this limit: another target, another branch or a straighter way"
    )


def test_speed_and_acceleration_peaks_are_exact() -> None:
    end = HOME.copy()
    end[0] += np.radians(60)
    shortest = PointToPoint.plan(ROBOT, HOME, end).duration
    assert texts(PointToPoint.lasting(HOME, end, shortest)) == []
    (speed,) = texts(PointToPoint.lasting(HOME, end, shortest * 0.999))
    assert speed.startswith("Base: at 0.75 s, 60.1 °/s is over its limit of 60.0 °/s; take 1.00 times")
    found = texts(PointToPoint.lasting(HOME, end, 0.5))
    assert [text.split(" is over")[0] for text in found] == [
        "Base: at 0.00 s, 1440.0 °/s²",
        "Base: at 0.25 s, 180.0 °/s",
    ]
    assert found[0].endswith("limit of 360.0 °/s²; take 2.00 times as long")
    assert found[1].endswith("limit of 60.0 °/s; take 3.00 times as long")


def test_in_a_joined_motion_the_time_counts_from_the_whole_start() -> None:
    end = HOME.copy()
    end[0] += np.radians(60)
    slow = PointToPoint.lasting(HOME, end, 4.0)
    fast = PointToPoint.lasting(end, HOME, 1.0)
    (finding,) = [f for f in preflight(ROBOT, JoinedTrajectory([slow, fast])) if "°/s is" in f.what]
    assert finding.time == pytest.approx(4.5)


def test_a_foreign_trajectory_is_sampled() -> None:
    assert any("°/s is over" in text for text in texts(Sine(1.5)))
    assert any("°/s² is over" in text for text in texts(Sine(0.3, duration=0.3)))
    assert any("is outside" in text for text in texts(Sine(2.5, duration=60.0)))


def test_one_that_lies_about_its_speed_is_found_out_by_its_steps() -> None:
    assert any("°/s is over" in text for text in texts(Sine(1.5, lie=0.01)))


def test_one_that_does_not_start_at_rest_is_refused() -> None:
    assert any("the motion starts at" in text for text in texts(Sine(0.3, phase=1.0)))


def test_a_piece_of_a_blended_motion_need_not_rest() -> None:
    assert preflight(ROBOT, Sine(0.3, phase=1.0), at_rest=False) == []


def test_a_motion_through_the_floor_says_which_part_and_how_deep() -> None:
    reach = np.radians([0, 10, -30, -50, 0])
    down = np.radians([0, -3, -60, -20, 0])
    trajectory = PointToPoint.plan(ROBOT, reach, down)
    depth = 1000 * -ROBOT.forward(down)[2, 3]
    finding = preflight(ROBOT, trajectory)[0]
    assert (finding.part, finding.kind, finding.severity) == ("the tool", "floor", "error")
    assert finding.what == f"{depth:.1f} mm below the floor"
    with pytest.raises(MotionRefusedError, match=r"the tool: .* mm below the floor; .*raise the target"):
        require_clear(ROBOT, trajectory)


def test_a_dip_in_the_middle_is_found_though_both_ends_are_clear() -> None:
    # The wrist hangs 52 mm above the floor; the tool, 101 mm long, swings through the vertical.
    start, end = np.radians([0, -3, -84, -83, 0]), np.radians([0, -3, -84, 80, 0])
    assert ROBOT.forward(start)[2, 3] > 0
    assert ROBOT.forward(end)[2, 3] > 0
    trajectory = PointToPoint.plan(ROBOT, start, end)
    finding = preflight(ROBOT, trajectory)[0]
    assert 0 < finding.time < trajectory.duration
    assert "below the floor" in finding.what


def test_an_arm_that_is_below_the_floor_may_come_up_but_not_sink() -> None:
    down = np.radians([0, -3, -60, -20, 0])
    deeper = np.radians([0, -3, -62, -22, 0])
    assert preflight(ROBOT, PointToPoint.plan(ROBOT, down, HOME)) == []
    assert any("below the floor" in text for text in texts(PointToPoint.plan(ROBOT, down, deeper)))


def test_the_first_finding_is_told_and_the_rest_are_counted() -> None:
    end = HOME.copy()
    end[0] += np.radians(60)
    with pytest.raises(MotionRefusedError, match=r"Base: at 0\.00 s, 1440\.0 °/s² .* \(and 1 more\)"):
        require_clear(ROBOT, PointToPoint.lasting(HOME, end, 0.5))


def test_another_number_of_joints_is_refused() -> None:
    with pytest.raises(InputError, match="uzuner has 5 joints, the trajectory has 2"):
        preflight(ROBOT, PointToPoint.lasting([0.0, 0.0], [1.0, 1.0], 1.0))


def test_values_that_are_not_finite_are_refused() -> None:
    with pytest.raises(InputError, match="angle that is not a finite number"):
        preflight(ROBOT, Sine(float("nan")))
