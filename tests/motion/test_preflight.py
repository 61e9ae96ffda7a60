"""Pre-flight: each check can fail and can pass."""

from __future__ import annotations

import tracemalloc
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import pytest
from tests.arms import FIVE
from tests.motion.sentence_kit import body_pieces
from tests.sticks import of_sticks

from armctl.arrays import FloatArray
from armctl.errors import InputError, MotionRefusedError
from armctl.facts import Found, RateLimit
from armctl.motion import (
    JoinedTrajectory,
    PathTrajectory,
    PiecewisePolynomial,
    PointToPoint,
    ProfileName,
    Sample,
    SlowedTrajectory,
    arc,
    line,
    plan_spline,
    preflight,
    require_clear,
)
from armctl.motion.clearance import SelfCollision
from armctl.motion.plan import plan_joints
from armctl.motion.preflight import Finding, not_checked, passes
from armctl.robot import Robot, load_robot
from armctl.robot.parts import Obstacle

ROBOT, SCORBOT, MICO = map(of_sticks, ("uzuner", "scorbot", "mico"))
HOME = ROBOT.pose("home")


@dataclass(frozen=True)
class Sine:
    """Joint 1 swings once; nothing of it is known in closed form."""

    amplitude: float
    duration: float = 2.0
    lie: float = 1.0
    phase: float = 0.0

    @property
    def start(self) -> FloatArray:
        return HOME + self._unit * self.amplitude * np.sin(self.phase)

    @property
    def end(self) -> FloatArray:
        return self.start

    def sample(self, t: float | FloatArray) -> Sample:
        time = np.asarray(t)[..., None]
        w = 2 * np.pi / self.duration
        u = w * np.clip(time, 0, self.duration) + self.phase
        # (1 - cos) is at rest at both ends; with a phase it is not
        q = HOME + self._unit * self.amplitude * 0.5 * (1 - np.cos(u))
        v = self._unit * self.amplitude * 0.5 * w * np.sin(u) * self.lie
        a = self._unit * self.amplitude * 0.5 * w * w * np.cos(u) * self.lie
        return Sample(q, v, a, np.zeros_like(q))

    @property
    def _unit(self) -> FloatArray:
        return np.array([1.0, 0, 0, 0, 0])


def texts(trajectory: object) -> list[str]:
    return [str(finding) for finding in preflight(ROBOT, trajectory)]  # pyright: ignore[reportArgumentType]


def test_good_motions_pass() -> None:
    rest = ROBOT.pose("rest")
    there = PointToPoint.plan(ROBOT, HOME, rest)
    back = PointToPoint.each_for_itself(ROBOT, rest, HOME)
    for motion in (there, back, JoinedTrajectory([there, back]), Sine(0.3)):
        assert preflight(ROBOT, motion) == []
        require_clear(ROBOT, motion)


def test_a_joint_outside_its_limits_is_named_with_figures() -> None:
    end = HOME.copy()
    end[2] = np.radians(-91.2)
    (text,) = texts(PointToPoint.lasting(HOME, end, 10.0))
    assert text == (
        "Elbow: at 10.00 s, -91.20° is outside -84.36° … 95.07°; "
        "keep away from this limit: another target, or a straighter way"
    )


@pytest.mark.parametrize("profile", ["s-curve", "quintic"])
def test_the_jerk_of_a_profile_that_limits_it_is_checked(profile: ProfileName) -> None:
    end = HOME + np.radians([40, 5, 0, 0, 0])
    strict = replace(ROBOT, joints=tuple(replace(one, jerk=0.1 * one.jerk) for one in ROBOT.joints))
    spline = np.array([HOME, end, HOME + np.radians([20, -8, 10, 0, 0])])
    for motion in (
        PointToPoint.plan(ROBOT, HOME, end, None, profile),
        plan_spline(ROBOT, spline, profile=profile),
    ):
        for part in (motion, JoinedTrajectory([motion]), SlowedTrajectory(motion, 1.0)):
            assert preflight(ROBOT, part) == []
            found = preflight(strict, part)
            assert {one.kind for one in found} == {"jerk"}
            assert found[0].part == "Base"
        assert preflight(strict, SlowedTrajectory(motion, 10 ** (1 / 3))) == []
    for motion in (PointToPoint.plan(ROBOT, HOME, end), plan_spline(ROBOT, spline)):  # they promise nothing
        assert preflight(strict, JoinedTrajectory([motion])) == []


def test_speed_and_acceleration_peaks_are_exact() -> None:
    end = HOME.copy()
    end[0] += np.radians(60)
    shortest = PointToPoint.plan(ROBOT, HOME, end).duration
    assert texts(PointToPoint.lasting(HOME, end, shortest)) == []
    (speed,) = texts(PointToPoint.lasting(HOME, end, shortest * 0.999))
    assert speed.startswith("Base: at 0.75 s, 60.1 °/s is over its limit of 60.0 °/s; take 1.01 times")
    found = texts(PointToPoint.lasting(HOME, end, 0.5))
    assert [text.split(" is over")[0] for text in found] == [
        "Base: at 0.00 s, 1440.0 °/s²",
        "Base: at 0.25 s, 180.0 °/s",
    ]
    assert found[0].endswith("limit of 360.0 °/s²; take 2.00 times as long")
    assert found[1].endswith("limit of 60.0 °/s; take 3.00 times as long")
    with pytest.raises(
        MotionRefusedError, match=r"Base: at 0\.00 s, 1440\.0 °/s² .* \(and 1 more\)"
    ) as refusal:
        require_clear(ROBOT, PointToPoint.lasting(HOME, end, 0.5))
    found = refusal.value.reason
    assert isinstance(found, Found) and (found.part, found.at_s, found.more) == ("Base", 0.0, 1)
    assert isinstance(found.reason, RateLimit) and found.reason.value == pytest.approx(np.radians(1440))


def test_in_a_joined_motion_the_time_counts_from_the_whole_start() -> None:
    end = HOME.copy()
    end[0] += np.radians(60)
    slow = PointToPoint.lasting(HOME, end, 4.0)
    fast = PointToPoint.lasting(end, HOME, 1.0)
    (finding,) = [f for f in preflight(ROBOT, JoinedTrajectory([slow, fast])) if "°/s is" in f.what]
    assert finding.time == pytest.approx(4.5)


@pytest.mark.parametrize(
    ("motion", "found"),
    [
        (Sine(1.5), "°/s is over"),
        (Sine(1.5, lie=0.01), "°/s is over"),  # its steps tell
        (Sine(0.3, duration=0.3), "°/s² is over"),
        (Sine(2.5, duration=60.0), "is outside"),
        (Sine(0.3, phase=1.0), "the motion starts at"),
    ],
)
def test_a_foreign_trajectory_is_sampled(motion: Sine, found: str) -> None:
    assert any(found in text for text in texts(motion))


def test_a_motion_of_too_many_samples_is_refused_before_they_are_made() -> None:
    with pytest.raises(InputError, match="a motion of 11 parts that needs more than 40000 samples"):
        preflight(ROBOT, JoinedTrajectory([Sine(1e-6, 4.0)] * 11))


def test_the_peaks_of_a_long_path_with_a_long_law_need_little_memory() -> None:
    count = 5000
    begins, aside = np.arange(count + 1.0), np.array([1e-3, 0, 0, 0, 0])
    zigzag = [[HOME + (k % 2) * aside, (1 - 2 * (k % 2)) * aside] for k in range(count)]
    path = PiecewisePolynomial(begins, zigzag)
    law = PiecewisePolynomial(begins, [[[at], [1.0], [0.0], [0.0]] for at in begins[:-1]])
    tracemalloc.start()
    try:
        assert np.isinf(PathTrajectory(path, law).peaks.acceleration[0])
        assert tracemalloc.get_traced_memory()[1] < 32 << 20
    finally:
        tracemalloc.stop()


def test_a_piece_of_a_blended_motion_need_not_rest() -> None:
    assert preflight(ROBOT, Sine(0.3, phase=1.0), at_rest=False) == []


def test_a_motion_through_the_floor_says_which_part_and_how_deep() -> None:
    reach = np.radians([0, 10, -30, -50, 0])
    down = np.radians([0, -3, -60, -20, 0])
    trajectory = PointToPoint.plan(ROBOT, reach, down)
    pieces = zip(ROBOT.collision.capsules, body_pieces(ROBOT, down[None]), strict=True)
    depths = [(1000 * (margin - at[0, :, 2].min()), piece.part) for piece, (at, margin) in pieces]
    depth = max(deep for deep, _ in depths)
    deepest = {part for deep, part in depths if deep == pytest.approx(depth)}  # both jaws, maybe
    assert depth > 1000 * -ROBOT.forward(down)[2, 3]  # deeper than the tool point
    finding = preflight(ROBOT, trajectory)[0]
    assert finding.part in deepest and (finding.kind, finding.severity) == ("floor", "error")
    assert finding.what == f"{depth:.1f} mm below the floor"
    with pytest.raises(
        MotionRefusedError, match=rf"{finding.part}: .* mm below the floor; .*raise the target"
    ):
        require_clear(ROBOT, trajectory)


def test_what_is_no_motion_of_the_arm_is_refused() -> None:
    with pytest.raises(InputError, match="uzuner has 5 joints, the trajectory has 2"):
        preflight(ROBOT, PointToPoint.lasting([0.0, 0.0], [1.0, 1.0], 1.0))
    with pytest.raises(InputError, match="angle that is not a finite number"):
        preflight(ROBOT, Sine(float("nan")))
    for payload in (-0.1, float("nan"), "a"):
        with pytest.raises(InputError, match="payload"):
            preflight(ROBOT, PointToPoint.plan(ROBOT, HOME, HOME), payload)
    with pytest.raises(InputError, match="cannot take -1"):
        preflight(ROBOT, Sine(0.1, duration=-1.0))


def of_kind(kind: str, robot: Robot, *poses_deg: tuple[float, ...], **more: object) -> list[Finding]:
    """Findings of one kind on the way from pose to pose."""
    poses = np.radians(poses_deg)
    parts = [PointToPoint.plan(robot, a, b) for a, b in pairwise(poses)]
    found = preflight(robot, JoinedTrajectory(parts), **more)  # type: ignore[arg-type]
    return [finding for finding in found if finding.kind == kind]


# --- self-collision


def test_folding_into_the_base_is_refused_with_both_parts_named() -> None:
    (finding,) = of_kind("self-collision", SCORBOT, (0, -60, 95, -80, 0), (0, 30, 130, -30, 0))
    assert finding.severity == "error"
    assert finding.part in ("the gripper", "the link behind elbow")
    assert "mm inside the base" in finding.what and "the base" in finding.mend
    assert 0 < finding.time


@pytest.mark.parametrize("name", ["ur5", "so101"])
def test_a_motion_passes_where_nothing_is_found_and_what_is_found_is_the_deepest(name: str) -> None:
    robot = load_robot(name)
    solids = SelfCollision(robot)
    rng = np.random.default_rng(3)
    seen = set[bool]()
    for _ in range(10):
        motion = plan_joints(robot, robot.pose("home"), rng.uniform(*robot.limits.T), checked=False)
        findings = preflight(robot, motion)
        passed = not any(finding.severity == "error" for finding in findings)
        seen.add(passed)
        assert passes(robot, motion) == passed
        assert passes(robot, motion, warned=False) == (not findings)
        for finding in findings:
            if finding.kind == "self-collision":
                assert finding.time is not None
                told, anywhere = (
                    solids.gaps(robot.body_frames(motion.sample(times).q), 0.0).min()
                    for times in (np.array([finding.time]), np.linspace(0.0, motion.duration, 150))
                )
                assert told < anywhere + 2e-4
    assert seen == {True, False}


@pytest.mark.parametrize("name", FIVE)
def test_the_ways_between_home_and_rest_are_clear(name: str) -> None:
    robot = load_robot(name)
    there = PointToPoint.plan(robot, robot.pose("home"), robot.pose("rest"))
    assert [str(f) for f in preflight(robot, there) if f.severity == "error"] == []


@pytest.mark.parametrize("points_m", [arc(), line()], ids=["arc", "line"])
def test_the_published_ways_are_clear(points_m: FloatArray) -> None:
    q = np.array([ROBOT.inverse(p).best("published") for p in points_m])
    parts = [PointToPoint.plan(ROBOT, a, b) for a, b in pairwise(q)]
    assert [str(f) for f in preflight(ROBOT, JoinedTrajectory(parts), tool_path=True)] == []


# --- obstacles

WALL = Obstacle("the wall", np.array([0.2, -0.5, 0.0]), np.array([0.3, 0.5, 0.6]))
WALLED = replace(ROBOT, obstacles=(WALL,))


def test_a_wall_in_the_way_is_named() -> None:
    found = of_kind("obstacle", WALLED, (0, 120, -80, -40, 0), (0, 40, -20, 0, 0))
    (finding,) = found
    assert finding.severity == "error"
    assert "mm inside the wall" in finding.what and "the wall" in finding.mend
    assert of_kind("obstacle", ROBOT, (0, 120, -80, -40, 0), (0, 40, -20, 0, 0)) == []
    assert of_kind("obstacle", WALLED, (0, 120, -80, -40, 0), (20, 120, -80, -40, 0)) == []


@pytest.mark.parametrize("angle_deg", [-51.3, -33.9, -22.1, -8.7, 4.4, 17.6, 28.2, 41.7])
def test_a_thin_post_is_found_between_samples(angle_deg: float) -> None:
    # the gripper, 13 mm wide, sweeps past a post of 2 mm; samples are up to 30 mm apart
    q = (10, -10, 0, 0)
    x, y, z = ROBOT.forward(np.radians([angle_deg, *q]))[:3, 3]
    low, high = np.array([x - 0.001, y - 0.001, z - 0.05]), np.array([x + 0.001, y + 0.001, z + 0.05])
    robot = replace(ROBOT, obstacles=(Obstacle("the post", low, high),))
    assert of_kind("obstacle", robot, (-90, *q), (90, *q))
    assert of_kind("obstacle", robot, (-90, *q), (angle_deg - 5, *q)) == []
    assert of_kind("obstacle", robot, (90, *q), (angle_deg + 5, *q)) == []


def test_a_table_under_the_arm_does_not_stop_the_column_from_turning() -> None:
    table = Obstacle("the table", np.array([-0.5, -0.5, -0.02]), np.array([0.5, 0.5, 0.0]))
    robot = replace(ROBOT, obstacles=(table,))
    assert of_kind("obstacle", robot, (-60, 90, -80, -40, 0), (60, 90, -80, -40, 0)) == []
    down = np.degrees(ROBOT.inverse([0.2, 0.0, -0.01]).best("least-rotation"))
    (finding,) = of_kind("obstacle", robot, (0, 90, -80, -40, 0), tuple(down))
    assert finding.part == "the gripper"
    touching = np.degrees(ROBOT.inverse([0.2, 0.0, 0.0], pitch=-np.pi / 2).best("least-rotation"))
    assert of_kind("obstacle", robot, (0, 90, -80, -40, 0), tuple(touching)) == []  # picking from it


@pytest.mark.parametrize(
    ("kind", "robot", "inside", "deeper", "out"),
    [
        ("floor", ROBOT, (0, -3, -60, -20, 0), (0, -3, -62, -22, 0), (0, 90, -80, -40, 0)),
        ("obstacle", WALLED, (0, 40, -20, 0, 0), (0, 30, -10, 0, 0), (0, 120, -80, -40, 0)),
        ("self-collision", SCORBOT, (0, 30, 115, -12, 0), (0, 33, 120, -12, 0), (0, -60, 95, -80, 0)),
    ],
)
def test_where_an_arm_touches_it_may_come_free_but_not_go_deeper(
    kind: str, robot: Robot, inside: tuple[float, ...], deeper: tuple[float, ...], out: tuple[float, ...]
) -> None:
    assert of_kind(kind, robot, out, inside)
    assert of_kind(kind, robot, inside, out) == []
    assert of_kind(kind, robot, inside, deeper)


# --- singularity


def test_a_joint_motion_that_ends_stretched_is_warned_of() -> None:
    (finding,) = preflight(ROBOT, PointToPoint.plan(ROBOT, HOME, np.zeros(5)))
    assert (finding.kind, finding.severity) == ("singularity", "warning")
    assert finding.what.startswith("singularity: ")
    require_clear(ROBOT, PointToPoint.plan(ROBOT, HOME, np.zeros(5)))


def test_a_path_of_the_tool_through_the_lost_direction_is_refused() -> None:
    # stretched upright at the middle: the tool comes out along the arm, stands for an instant, goes back in
    through = [(0, 120, -40, -20, 0), (0, 90, 0, 0, 0), (0, 60, 40, 20, 0)]
    (finding,) = of_kind("singularity", ROBOT, *through, tool_path=True)
    assert finding.severity == "error"
    assert "choose a line that does not pass there" in finding.mend
    # a joint motion may pass it
    assert of_kind("singularity", ROBOT, (0, 20, 40, 30, 0), (0, 20, -40, -30, 0)) == []
    # stretched all the way, only the base turns: sideways is free
    (finding,) = of_kind("singularity", ROBOT, (-40, 0, 0, 0, 0), (40, 0, 0, 0, 0), tool_path=True)
    assert finding.severity == "warning"


def test_isotropy_is_that_of_the_singular_values() -> None:
    rng = np.random.default_rng(9)
    for q in rng.uniform(ROBOT.limits[:, 0], ROBOT.limits[:, 1], (60, 5)):
        sizes = np.linalg.svd(ROBOT.jacobian(q)[:3], compute_uv=False)
        found = [f for f in preflight(ROBOT, PointToPoint.lasting(q, q, 0.0)) if f.kind == "singularity"]
        assert bool(found) == bool(sizes[2] / sizes[0] < 0.05)
        if found:
            assert f"{100 * sizes[2] / sizes[0]:.1f} %" in found[0].what


def test_of_an_arm_that_is_always_singular_nothing_is_said() -> None:
    flat = replace(
        ROBOT,
        joints=tuple(
            replace(joint, lower=0.0, upper=0.0) if joint.name in ("base", "wrist_roll") else joint
            for joint in ROBOT.joints
        ),
    )
    assert of_kind("singularity", flat, (0, 90, -80, -40, 0), (0, 0, 0, 0, 0)) == []


# --- torque


def test_a_payload_that_is_too_heavy_is_refused_and_one_that_warms_is_told() -> None:
    ways = (0, 90, -80, -40, 0), (0, 5, 5, 5, 0)
    assert of_kind("torque", ROBOT, *ways) == []
    warm = of_kind("torque", ROBOT, *ways, payload_kg=0.4)
    assert {f.severity for f in warm} == {"warning"}
    assert "Shoulder" in {f.part for f in warm}
    heavy = [f for f in of_kind("torque", ROBOT, *ways, payload_kg=1.0) if f.severity == "error"]
    assert "Shoulder" in {f.part for f in heavy}
    q = np.radians(ways[1])
    torque = abs(float(replace(ROBOT.gravity, payload_kg=1.0).torque(q)[1]))
    (shoulder,) = [f for f in heavy if f.part == "Shoulder"]
    assert shoulder.what.startswith(
        f"gravity loads it with {torque:.2f} N·m, {100 * torque / 2.941995:.0f} %"
    )
    assert "(counted: links of 0.7 kg and a payload of 1 kg)" in shoulder.what
    with pytest.raises(MotionRefusedError, match="stall torque"):
        require_clear(ROBOT, PointToPoint.plan(ROBOT, HOME, q), 1.0)


def test_an_overloaded_arm_may_be_brought_in() -> None:
    out, in_, farther = (0, 30, 0, 0, 0), (0, 90, -80, -40, 0), (0, 0, 0, 0, 0)
    errors = [f for f in of_kind("torque", ROBOT, out, in_, payload_kg=1.2) if f.severity == "error"]
    assert errors == []
    assert any(f.severity == "error" for f in of_kind("torque", ROBOT, out, farther, payload_kg=1.2))


def test_what_is_not_known_is_said_and_not_invented() -> None:
    assert not_checked(ROBOT) == ()
    assert "no stall torque of any joint" in not_checked(MICO)[0].text
    assert of_kind("torque", MICO, (0, -100, 30, 0), (0, 0, 0, 0), payload_kg=50.0) == []
    bare = replace(ROBOT, gravity=replace(ROBOT.gravity, bodies=()))
    assert "no masses of links, so there are no loads and no least-torque" in not_checked(bare)[0].text
