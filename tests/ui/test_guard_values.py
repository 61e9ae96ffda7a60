from __future__ import annotations

from collections.abc import Iterator

import pytest
import viser
from hypothesis import given
from hypothesis import strategies as st

from armctl.ui.guard import guarded_server
from armctl.ui.guard.filter import Operable, accepts, is_operable, is_usable
from armctl.ui.guard.messages import Value


@pytest.fixture(scope="module")
def gui() -> Iterator[viser.GuiApi]:
    server = guarded_server(port=0)
    yield server.gui
    server.stop()


@pytest.fixture(scope="module")
def controls(gui: viser.GuiApi) -> dict[str, Operable]:
    return {
        "button": gui.add_button("b"),
        "checkbox": gui.add_checkbox("c", initial_value=False),
        "text": gui.add_text("t", initial_value=""),
        "group": gui.add_button_group("g", ("−", "+")),
        "dropdown": gui.add_dropdown("d", ("uzuner", "mico")),
        "slider": gui.add_slider("s", min=-90.0, max=84.36, step=0.01, initial_value=0.0),
        "count": gui.add_slider("n", min=1, max=5, step=1, initial_value=2),
        "number": gui.add_number("x", initial_value=1.5, min=0.0, max=10.0),
        "whole": gui.add_number("i", initial_value=1),
        "range": gui.add_multi_slider("m", min=0.0, max=1.0, step=0.1, initial_value=(0.2, 0.8)),
        "pair": gui.add_vector2("v2", initial_value=(0.0, 0.0)),
        "vector": gui.add_vector3("v3", initial_value=(0.0, 0.0, 0.0)),
        "rgb": gui.add_rgb("rgb", initial_value=(1, 2, 3)),
        "rgba": gui.add_rgba("rgba", initial_value=(1, 2, 3, 4)),
        "upload": gui.add_upload_button("u"),
    }


@pytest.mark.parametrize(
    ("name", "good", "bad"),
    [
        ("button", [True], [False, 1, "True", 1.0]),
        ("checkbox", [True, False], [1, 0, "false", (True,)]),
        ("text", ["", "home"], [1, True, ("a",)]),
        ("group", ["−", "+"], ["", "*", 0, True]),
        ("dropdown", ["mico"], ["", "scorbot", 0, True]),
        ("slider", [84.36, 84.36000000000001, -90, 0], [84.37, -91, 1e6, "0", True, (0.0,)]),
        ("count", [1, 5, 3.0], [2.5, 0, 6, True]),
        ("number", [5, 9.75, 150, -3.5], ["5", True, (5.0,)]),
        ("whole", [7, -1, 2.0], [0.5, "1", False]),
        ("range", [(0.1, 0.9), (0, 1)], [(0.1,), (0.1, 0.2, 0.3), (0.1, 1.2), 0.5, (True, False)]),
        ("pair", [(1, 2.5)], [(1.0,), (1.0, 2.0, 3.0), 1.0, "12"]),
        ("vector", [(1, 2, 3.5)], [(1.0, 2.0), "123"]),
        ("rgb", [(0, 255, 9)], [(0, 256, 0), (-1, 0, 0), (0.5, 0, 0), (1, 2, 3, 4)]),
        ("rgba", [(0, 255, 9, 0)], [(0, 255, 9)]),
        ("upload", [], [True, "file", 1]),
    ],
)
def test_a_control_accepts_what_it_can_show(
    controls: dict[str, Operable], name: str, good: list[Value], bad: list[Value]
) -> None:
    assert [value for value in good if not accepts(controls[name], value)] == []
    assert [value for value in bad if accepts(controls[name], value)] == []


VALUES = (
    st.booleans()
    | st.integers(-(10**9), 10**9)
    | st.floats(-1e9, 1e9)
    | st.text(max_size=9)
    | st.lists(st.integers(-300, 300) | st.floats(-1, 1), min_size=1, max_size=5).map(tuple)
)


@given(st.data())
def test_viser_can_cast_whatever_is_accepted(controls: dict[str, Operable], data: st.DataObject) -> None:
    control = controls[data.draw(st.sampled_from(sorted(controls)))]
    value = data.draw(VALUES)
    if accepts(control, value) and not isinstance(value, tuple):
        assert type(control.value)(value) == value  # the cast in viser's GuiApi._handle_gui_updates


def test_disabled_and_hidden_controls_are_not_usable(gui: viser.GuiApi) -> None:
    button = gui.add_button("b")
    assert is_usable(button)
    button.disabled = True
    assert not is_usable(button)
    button.disabled, button.visible = False, False
    assert not is_usable(button)


def test_only_controls_are_operable(gui: viser.GuiApi, controls: dict[str, Operable]) -> None:
    assert all(is_operable(control) for control in controls.values())
    assert not is_operable(gui.add_progress_bar(10.0))
    assert not is_operable(gui.add_folder("f"))
    assert not is_operable(None)
