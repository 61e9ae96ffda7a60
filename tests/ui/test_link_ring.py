"""A ring at the joint of the link that was clicked."""

from __future__ import annotations

import numpy as np
import pytest
from tests.ui.page_kit import FakePage

from armctl.arrays import FloatArray
from armctl.errors import InputError
from armctl.kinematics import quaternion_wxyz
from armctl.kinematics.samples import joint_samples
from armctl.robot import Robot, load_robot
from armctl.ui.guard import GuardedServer
from armctl.ui.tabs.manual.link_ring import LinkRing, clicked_joint, ring_frame

ARMS = [load_robot(name) for name in ("uzuner", "ur5", "so101", "parol6", "scorbot")]
ROBOT = ARMS[0]
HOME = ROBOT.pose("home")


def about(frame: FloatArray, angle: float) -> FloatArray:
    """The frame, turned about its z."""
    c, s = np.cos(angle), np.sin(angle)
    return quaternion_wxyz(frame @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]]))


@pytest.mark.parametrize("robot", ARMS, ids=lambda robot: robot.name)
def test_a_ring_turns_the_tool_as_its_joint_does(robot: Robot) -> None:
    low, high = robot.limits.T
    for q in joint_samples(robot.limits, 20):
        for joint in range(robot.n):
            angle = 0.2 if q[joint] + 0.2 < high[joint] else -0.2
            point, frame = ring_frame(robot, q, joint)
            turned = q.copy()
            turned[joint] += angle
            R = frame @ np.array(
                [[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]]
            ) @ frame.T  # fmt: skip
            tool = robot.forward(q)[:3, 3]
            assert robot.forward(turned)[:3, 3] == pytest.approx(point + R @ (tool - point), abs=1e-9)
    assert (low <= high).all()


@pytest.mark.parametrize("robot", ARMS, ids=lambda robot: robot.name)
def test_a_ray_at_a_link_from_outside_meets_it_or_one_before_it(robot: Robot) -> None:
    random = np.random.default_rng(7)
    collision, met = robot.collision, 0
    for q in joint_samples(robot.limits, 12):
        starts, spans = collision.placed(collision.frames(q[None]))
        middles = (starts + 0.5 * spans)[:, :, 0].T
        for k, piece in enumerate(collision.capsules):
            out = random.normal(size=3)
            eye = middles[k] + 5 * robot.chain.length * out / np.linalg.norm(out)
            found = clicked_joint(robot, q, eye, (middles[k] - eye) / np.linalg.norm(middles[k] - eye))
            met += found == piece.link
            assert found is None or 0 <= found < robot.n
    assert met > 12
    assert clicked_joint(robot, robot.pose("home"), np.array([9.0, 9, 9]), np.array([0, 0, 1.0])) is None


class Bench:
    def __init__(self, server: GuardedServer) -> None:
        self.page = FakePage(server, ROBOT, HOME)
        self.page.console.last_known.drawn = lambda snapshot: snapshot.q_command
        self.taken = False
        self.ring = LinkRing(self.page.session, lambda origin, direction: self.taken)

    def click(self, point: FloatArray) -> None:
        """On a place of the arm, from far off."""
        eye = point + np.array([4.0, 0.0, 0.8])
        words = " ".join(map(str, [*eye.tolist(), -1.0, 0.0, -0.2, 0.0, 0.0]))
        self.page.act(lambda: self.page.parts.done("scene-click", "", words))

    def middle(self, link: int) -> FloatArray:
        collision = ROBOT.collision
        starts, spans = collision.placed(collision.frames(HOME[None]))
        k = next(k for k, one in enumerate(collision.capsules) if one.link == link)
        return (starts + 0.5 * spans)[:, k, 0]


def test_a_click_shows_a_ring_and_takes_it_away(server: GuardedServer) -> None:
    bench = Bench(server)
    bench.click(bench.middle(2))
    joint = bench.ring.joint
    assert joint is not None
    bench.click(bench.middle(2))
    assert bench.ring.joint is None
    bench.click(bench.middle(2))
    bench.click(np.array([0.0, 0.0, 9.0]))  # beside the arm
    assert bench.ring.joint is None
    bench.taken = True
    bench.click(bench.middle(2))  # a pin stands before it
    assert bench.ring.joint is None
    for nonsense in ("", "1 2 3", "0 0 0 0 0 0 0 0", "nan 0 0 0 0 1 0 0"):
        with pytest.raises(InputError):
            bench.page.act(lambda text=nonsense: bench.page.parts.done("scene-click", "", text))


def test_dragging_it_turns_one_joint_of_the_next_pose_as_far_as_its_limit(server: GuardedServer) -> None:
    bench = Bench(server)
    bench.page.act(lambda: bench.ring._show(1))
    _, frame = ring_frame(ROBOT, HOME, 1)
    for angle in (0.1, 0.2, 0.3):
        bench.page.act(lambda angle=angle: bench.ring.turn(about(frame, angle), done=angle == 0.3))
    q = bench.page.next.q
    assert q is not None and q - HOME == pytest.approx([0, 0.3, 0, 0, 0])
    assert "ring at Shoulder" in bench.page.parts["next"] and not bench.page.sent
    _, frame = ring_frame(ROBOT, q, 1)
    for step in range(1, 41):  # more than a turn
        bench.page.act(lambda step=step: bench.ring.turn(about(frame, 0.2 * step), done=step == 40))
    assert bench.page.next.q is not None
    assert bench.page.next.q[1] == pytest.approx(ROBOT.joints[1].upper)
    for nonsense in (np.zeros(4), np.full(4, np.nan)):
        bench.page.act(lambda wxyz=nonsense: bench.ring.turn(wxyz, done=True))
    assert bench.page.next.q[1] == pytest.approx(ROBOT.joints[1].upper)
