"""The Forward tab: coupled fields, figures of a configuration, what the two buttons would do."""

from __future__ import annotations

import numpy as np
import pytest
from tests.arms import FIVE
from tests.ui.page_kit import FakePage

from armctl.errors import InputError
from armctl.kinematics import Target
from armctl.kinematics.velocity import position_freedom
from armctl.robot import Robot, load_robot
from armctl.ui.guard import GuardedServer
from armctl.ui.offers import NO_REASON
from armctl.ui.tabs.forward.figures import (
    LAST,
    REFERENCE,
    SHOWN,
    direction_words,
    goals_html,
    jacobian_html,
    joint_rates_html,
    manipulability_html,
    offers_html,
    pose_html,
    resulting_pose,
    results,
    tool_speeds_html,
    tool_velocity_html,
)
from armctl.ui.tabs.forward.screen import ForwardScreen, PoseFields, angle_fields, coupled_joints

ROBOTS = tuple(load_robot(name) for name in FIVE)
ROBOT, MICO, HUMANOID, SCORBOT = (load_robot(name) for name in ("uzuner", "mico", "humanoid", "scorbot"))
HOME, SCORBOT_HOME = ROBOT.pose("home"), SCORBOT.pose("home")


def test_results_tell_where_both_buttons_lead_and_what_is_outside(server: GuardedServer) -> None:
    asked = np.radians([10, 90, -80, -40, 0])
    for how, goal in ((REFERENCE, asked), (SHOWN[0], asked), (LAST, HOME + asked), (SHOWN[1], HOME + asked)):
        assert np.array_equal(resulting_pose(how, asked, HOME), goal)
    angles = angle_fields(server.gui, ROBOT, asked)
    told = goals_html(ROBOT, HOME, results(angles, HOME).goals)
    to, by = told.split("<td>last</td>")
    assert "<td>now</td>" in to and "<td>reference</td>" in to and "class=bad" not in to
    assert "<td class=bad>180.0</td>" in by
    page = FakePage(server, ROBOT, HOME)
    screen = ForwardScreen(page.session)
    page.put("Shoulder °", "90")
    assert screen._outside(REFERENCE, page.session.snapshot) is None
    why = screen._outside(LAST, page.session.snapshot)
    told = offers_html({REFERENCE: None, LAST: why})
    assert "<td>last</td><td>Shoulder: 180.00° is outside −3.19° … 146.83°.</td>" in told
    assert "reference" not in told and offers_html({REFERENCE: None, LAST: None}) == NO_REASON
    page.put("Base °", "999")
    outside = {how: screen._outside(how, page.session.snapshot) for how in (REFERENCE, LAST)}
    told = offers_html(outside)
    assert "<td>both</td><td>Base: 999.00° is outside" in told and told.count("<tr>") == 3
    assert "unit" not in told  # a page counts in degrees
    page.put("Base °", "10")
    assert offers_html({REFERENCE: "it is off", LAST: "it is off"}).count("It is off.") == 1
    page.put("Shoulder °", "half")
    assert screen._outside(LAST, page.session.snapshot) is None  # told elsewhere, and where it is pressed
    assert "The fields follow the arm" in results(angles, HOME, edited=False).notes
    angles.fields[2].handle.value = "<b>4x"
    half = results(angles, HOME)
    assert "Nothing can be sent: Elbow °: &#x27;&lt;b&gt;4x&#x27; is not a number" in half.notes
    assert goals_html(ROBOT, HOME, half.goals).count("<td>–</td>") == 2 * 8


def test_a_pose_in_figures_and_which_way_a_stretched_arm_cannot_go() -> None:
    html = pose_html(ROBOT, HOME)  # the tool looks 30° down
    for text in ("255.56", "Rz(yaw) · Ry(pitch) · Rx(roll)", "Rx (roll)", "Ry (pitch) <b>−60.000°</b>"):
        assert text in html
    assert "Ry is not the tool pitch: that is −30.000°" in html
    html = jacobian_html(ROBOT, np.zeros(5))
    for row in ("vx mm/s", "ωz rad/s", "330.00", "Wrist roll", "√det(Jᵀ J) of all six rows"):
        assert row in html
    stretched = position_freedom(ROBOT.jacobian(np.zeros(5)))
    html = manipulability_html(stretched, ROBOT.forward(np.zeros(5))[:3, 3])
    assert "Singular" in html and "the tool cannot move out or in, along (" in html
    assert "smallest singular value: <b>0.00</b> mm/rad; largest / smallest: ∞" in html
    J = ROBOT.jacobian(HOME)
    html = manipulability_html(position_freedom(J), ROBOT.forward(HOME)[:3, 3])
    assert "Well away from singularities" in html and "moves least" in html
    assert f"{1e3 * np.sqrt(np.linalg.det(J[:3] @ J[:3].T)):.4f}" in html


@pytest.mark.parametrize(
    ("direction", "tip", "words"),
    [
        ([1, 0, 0], [0, 0.3, 0.1], "left or right"),
        ([0.6, 0, 0.8], [0.3, 0, 0.1], "out and up or in and down"),
        ([-0.6, 0, 0.8], [0.3, 0, 0.1], "out and down or in and up"),
        ([0, 1, 0], [0, 0, 0.7], "along +y or along −y"),
    ],
)
def test_directions_in_words(direction: list[float], tip: list[float], words: str) -> None:
    assert direction_words(np.array(direction, dtype=float), np.array(tip, dtype=float)) == words


def test_the_tool_speed_of_each_joint_is_listed() -> None:
    """The abaas arm in a pose of its paper: the shoulder is the most effective joint at equal rates."""
    abaas = load_robot("abaas")
    q = abaas.pose("home")
    html = tool_speeds_html(abaas, abaas.jacobian(q))
    for text in ("at 20 °/s", "its limit", "Base", "60.0 °/s", "120.0 °/s"):
        assert text in html
    x, y, _ = 1000 * abaas.forward(q)[:3, 3]
    assert f"{np.radians(20) * np.hypot(x, y):.1f} mm/s" in html
    marked = html[html.index("background") :]
    assert "Shoulder" in marked[: marked.index("</tr>")]
    assert "held at 0°" in tool_speeds_html(HUMANOID, HUMANOID.jacobian(HUMANOID.pose("home")))


def fields(server: GuardedServer, robot: Robot) -> PoseFields:
    return PoseFields(server.gui, robot, robot.pose("home"))


@pytest.mark.parametrize("robot", ROBOTS, ids=lambda robot: robot.name)
def test_the_fields_ask_for_the_pose_they_show_and_the_nearest_solution_is_taken(
    server: GuardedServer, robot: Robot
) -> None:
    solver, q = robot.inverse_kinematics, robot.pose("home")
    pose = fields(server, robot)
    assert [float(field.text) for field in pose.xyz.fields] == pytest.approx(
        1000 * robot.forward(q)[:3, 3], abs=1e-3
    )
    found = coupled_joints(robot, pose.target(pose.xyz.fields[0]), q)
    np.testing.assert_allclose(found.q, q, atol=1e-6)
    pitch, roll = solver.pitch_and_roll(q)
    asked = None if robot.name in ("mico", "humanoid") else pitch
    for _ in range(10):
        point = robot.forward(q)[:3, 3] + [0.0, 0.002, 0.001]
        found = coupled_joints(robot, Target.of(point, asked, roll), q)
        assert found.q is not None and found.why_not is None
        assert np.abs(found.q - q).max() < np.radians(4)  # no joint jumps to another branch
        np.testing.assert_allclose(robot.forward(found.q)[:3, 3], point, atol=1e-9)
        q = found.q
    low, high = robot.limits.T
    for q in np.random.default_rng(3).uniform(low, high, (20, robot.n)):
        _, roll = solver.pitch_and_roll(q)
        found = coupled_joints(robot, Target.of(robot.forward(q)[:3, 3], None, roll), q)
        np.testing.assert_allclose(found.q, q, atol=1e-6)


def test_which_fields_there_are_and_when_the_pitch_is_asked_for(server: GuardedServer) -> None:
    labels = [field.label for field in fields(server, ROBOT).fields]
    assert labels == ["X mm", "Y mm", "Z mm", "Pitch °", "Roll °"]
    mico = fields(server, MICO)  # two pitch joints: the position decides the pitch
    assert [field.label for field in mico.fields] == ["X mm", "Y mm", "Z mm", "Roll °"]
    assert mico.target(mico.xyz.fields[0]).pitch is None
    assert mico.pitch.visible and mico.pitch.handle.disabled and not mico.hold.visible
    mico.fill(np.zeros(4), turn_only=True)  # the tool hangs straight down
    assert mico.pitch.value == pytest.approx(-90.0)
    pose = fields(server, HUMANOID)  # its wrist roll is held
    assert [field.label for field in pose.fields] == ["X mm", "Y mm", "Z mm", "Pitch °"]
    x = pose.xyz.fields[0]
    assert pose.target(x).roll is None
    assert not pose.hold.value and fields(server, ROBOT).hold.value
    assert pose.target(x).pitch is None and pose.target(pose.pitch).pitch is not None
    pose.hold.value = True
    assert pose.target(x).pitch is not None
    x.handle.value = "-"
    with pytest.raises(InputError, match="X mm: '-' is not a number"):
        pose.target(x)
    wrist = angle_fields(server.gui, HUMANOID, HUMANOID.pose("home")).fields[4].handle
    assert wrist.disabled and wrist.hint == "Wrist roll: held at 0°"


def rates(*linear: float, q: np.ndarray = SCORBOT_HOME, keep: bool = False) -> str:
    return joint_rates_html(SCORBOT, SCORBOT.jacobian(q), np.array(linear), keep=keep)


def test_the_waist_alone_moves_the_tool_sideways_and_rates_over_their_limits_are_named() -> None:
    J = SCORBOT.jacobian(SCORBOT_HOME)
    html = tool_velocity_html(SCORBOT, J, np.radians([20.0, 0, 0, 0, 0]))
    assert f">{np.radians(20) * 1000 * SCORBOT.forward(SCORBOT_HOME)[0, 3]:.1f}<" in html  # mm/s along y
    assert ">20.0<" in html and "at most" not in html  # °/s about z
    over = tool_velocity_html(SCORBOT, J, np.radians([25.0, 0, -40.0, 0, 0]))
    assert "Waist turns at 20.0 °/s at most; Elbow turns at 26.0 °/s at most" in over


def test_a_velocity_is_met_or_limited_and_not_turning_is_more_than_five_joints_can() -> None:
    html, x = rates(0.0, 0.05, 0.0), SCORBOT.forward(SCORBOT_HOME)[0, 3]
    assert "<b>50.0 mm/s</b> of 50.0 mm/s</div>" in html and "Out of" not in html
    assert f"{np.degrees(0.05 / x):.2f} °/s" in html
    met = 1000 * np.radians(20) * x
    limited = f"<b>{met:.1f} mm/s</b> of 1000.0 mm/s; Waist is at its limit, at {met / 10:.1f} %"
    assert limited in rates(0.0, 1.0, 0.0)
    stretched = np.radians([0.0, 0.0, 0.0, -90.0, 0.0])  # at its reach of 604 mm
    html = rates(0.05, 0.0, 0.0, q=stretched)
    assert "The joints cannot give 50.00 mm/s" in html
    assert "<b>0.0 mm/s</b> of 50.0 mm/s" in html
    assert "The tool cannot move like this without turning" in rates(0.0, 0.05, 0.0, keep=True)
    straight = rates(0.03, 0.0, 0.0, keep=True)
    assert "cannot" not in straight and "Out of" not in straight
    q = HUMANOID.pose("home")
    html = joint_rates_html(HUMANOID, HUMANOID.jacobian(q), np.array([0.05, 0.0, 0.0]), keep=False)
    assert "held at 0°" in html and "0.00 °/s" in html
