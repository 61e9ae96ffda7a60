"""A gamepad as the browser reports it, and a finger on a pad of the page: the arm moves, and stops."""

from __future__ import annotations

import numpy as np
import pytest
from tests.browser.kit import Screen
from tests.browser.served_arm import ServedArm

from armctl.facts import State

pytestmark = pytest.mark.browser
SWITCH = "Gamepad is off: press to switch on"
PAD = """
  const pad = { id: "Test pad", index: 0, connected: true, mapping: "standard", axes: [0, 0, 0, 0],
    buttons: Array.from({ length: 17 }, () => ({ pressed: false, value: 0 })), rumbled: 0,
    vibrationActuator: { playEffect: async () => { pad.rumbled += 1; } } };
  window.testPad = pad;
  navigator.getGamepads = () => [null, pad];
"""


def push(page: Screen, axes: list[float], *buttons: int) -> None:
    page.page.evaluate(
        "([axes, down]) => { testPad.axes = axes; testPad.buttons.forEach((one, i) => {"
        " one.pressed = down.includes(i); }); }",
        [axes, list(buttons)],
    )


def wait_for_pad(page: Screen) -> None:
    """The page has seen it, and looked once more: what is held before that has to be let go first."""
    page.wait_for_text("Test pad")
    page.pause(200)


@pytest.fixture
def pad(page: Screen, served: ServedArm) -> Screen:
    page.page.evaluate(f"() => {{ {PAD} }}")
    page.open_tab("Manual")
    page.open_tab("Jog & gripper")
    page.open_tab("Gamepad")
    return page


def test_the_arm_follows_a_stick_while_the_button_is_held_and_only_then(
    pad: Screen, served: ServedArm
) -> None:
    push(pad, [0, -1, 0, 0], 5)  # held already as it is switched on
    pad.click(SWITCH)
    pad.wait_for_text("(let its sticks go)")
    at = served.tool_mm
    pad.pause()
    assert served.now.state is State.HOLDING and np.allclose(served.tool_mm, at)
    push(pad, [0, 0, 0, 0])
    pad.pause()
    push(pad, [0, -1, 0, 0], 5)
    pad.wait_until(lambda: served.tool_mm[0] > at[0] + 3, "the tool goes forward")
    pad.screenshot("gamepad")
    push(pad, [0, -1, 0, 0])
    served.wait_for(pad, State.HOLDING)
    assert np.abs(served.tool_mm - at)[1:].max() < 0.1
    there = served.tool_mm
    pad.pause()
    assert np.allclose(served.tool_mm, there)


def test_who_comes_back_with_the_button_held_has_to_let_go_first(pad: Screen, served: ServedArm) -> None:
    pad.click(SWITCH)
    wait_for_pad(pad)
    at = served.tool_mm
    for leave, come_back in (
        ("document.hasFocus = () => false", "delete document.hasFocus"),
        (
            "window.had = navigator.getGamepads; navigator.getGamepads = () => []",
            "navigator.getGamepads = had",
        ),
    ):
        pad.page.evaluate(f"() => {{ {leave} }}")
        push(pad, [0, -1, 0, 0], 5)
        pad.pause()
        pad.page.evaluate(f"() => {{ {come_back} }}")
        pad.pause()
        assert served.now.state is State.HOLDING and np.allclose(served.tool_mm, at)
        push(pad, [0, 0, 0, 0])
        pad.pause()


@pytest.mark.parametrize("axes", [[0, 0, -1, 0, 0, -1, 0, 0], [0, 0, -1, 0, 0, -1]])
def test_what_nobody_knows_is_not_heard(pad: Screen, served: ServedArm, axes: list[float]) -> None:
    pad.page.evaluate("testPad.mapping = ''")
    push(pad, axes, 0, 4)
    pad.click(SWITCH)
    pad.wait_for_text("No gamepad and no 3D mouse is seen")
    at = served.tool_mm
    pad.pause()
    assert served.now.state is State.HOLDING and np.allclose(served.tool_mm, at)


def test_a_3d_mouse_is_heard_once_it_has_rested(pad: Screen, served: ServedArm) -> None:
    pad.page.evaluate(
        "() => { testPad.mapping = ''; testPad.id = '3Dconnexion SpaceMouse (Vendor: 256f Product: c635)'; }"
    )
    push(pad, [0, -1, 0, 0, 0, 0])
    pad.click(SWITCH)
    pad.wait_for_text("(let its sticks go)")
    push(pad, [0, 0, 0, 0, 0, 0])
    pad.wait_until(lambda: "(let its" not in pad.page.inner_text("body"), "it has rested")
    at = served.tool_mm
    push(pad, [0, -1, 0, 0, 0, 0], 0)
    pad.wait_until(lambda: served.tool_mm[0] > at[0] + 2, "the tool goes forward")
    push(pad, [0, 0, 0, 0, 0, 0])
    served.wait_for(pad, State.HOLDING)


def test_its_buttons_stop_the_arm_and_move_the_gripper_and_a_limit_is_felt(
    pad: Screen, served: ServedArm
) -> None:
    pad.click(SWITCH)
    wait_for_pad(pad)
    push(pad, [0, 0, 0, 0], 4, 1)
    pad.wait_until(lambda: served.now.gripper == 1.0, "the gripper opens")
    pad.choose("Sticks move", "Joints")
    push(pad, [-1, 0, 0, 0], 4)
    served.wait_for(pad, State.MOVING)
    push(pad, [-1, 0, 0, 0], 4, 9)
    served.wait_for(pad, State.HOLDING)
    push(pad, [-1, 0, 0, 0], 4)  # still held: it has to be let go first
    pad.pause()
    assert served.now.state is State.HOLDING
    assert served.now.cause.startswith("stopped by")
    assert pad.notifications() == []
    push(pad, [0, 0, 0, 0])
    pad.pause()
    high = float(np.degrees(served.robot.limits[0, 1]))
    served.go_deg(pad, [high - 0.2, *served.commanded_deg[1:]])
    push(pad, [-1, 0, 0, 0], 4)
    pad.wait_until(lambda: pad.page.evaluate("testPad.rumbled") == 1, "the hand feels it")
    assert served.commanded_deg[0] <= high + 1e-6
    push(pad, [0, 0, 0, 0])
    served.wait_for(pad, State.HOLDING)


def test_a_finger_on_a_pad_moves_the_tool_and_lifting_it_stops(pad: Screen, served: ServedArm) -> None:
    pad.page.evaluate("navigator.getGamepads = () => [null]")
    pad.click(SWITCH)
    thumb = pad.page.get_by_label("Thumb pad: left stick")
    thumb.scroll_into_view_if_needed()
    box = thumb.bounding_box()
    assert box is not None
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    at, mouse = served.tool_mm, pad.page.mouse
    mouse.move(x, y)
    mouse.down()
    mouse.move(x - 0.4 * box["width"], y)
    pad.wait_until(lambda: served.tool_mm[1] > at[1] + 3, "the tool goes to the left")
    pad.screenshot("thumbs")
    mouse.up()
    served.wait_for(pad, State.HOLDING)
    assert np.abs(served.tool_mm - at)[[0, 2]].max() < 0.1
