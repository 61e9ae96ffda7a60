"""Whether a control of the page can take the value that a page sends for it.

viser casts a value to the type of the present one and hands it to the callbacks: a string becomes
``True`` in a checkbox, a slider leaves its range, a disabled button is pressed. A *number field* is let
through outside its range on purpose: the page itself sends such values while the user types, and the
screen must be able to say "150 is outside" instead of going on with the digits that were inside.
"""

from __future__ import annotations

from typing import Any

from typing_extensions import TypeIs
from viser import (
    GuiButtonGroupHandle,
    GuiButtonHandle,
    GuiCheckboxHandle,
    GuiDropdownHandle,
    GuiMultiSliderHandle,
    GuiNumberHandle,
    GuiRgbaHandle,
    GuiRgbHandle,
    GuiSliderHandle,
    GuiTextHandle,
    GuiUploadButtonHandle,
    GuiVector2Handle,
    GuiVector3Handle,
)

from armctl.ui.guard.messages import Value

_CLASSES = (
    GuiButtonHandle,
    GuiUploadButtonHandle,
    GuiCheckboxHandle,
    GuiTextHandle,
    GuiButtonGroupHandle,
    GuiDropdownHandle,
    GuiSliderHandle,
    GuiNumberHandle,
    GuiMultiSliderHandle,
    GuiVector2Handle,
    GuiVector3Handle,
    GuiRgbHandle,
    GuiRgbaHandle,
)
Operable = (
    GuiButtonHandle
    | GuiUploadButtonHandle
    | GuiCheckboxHandle
    | GuiTextHandle
    | GuiButtonGroupHandle
    | GuiDropdownHandle[Any]
    | GuiSliderHandle[Any]
    | GuiNumberHandle[Any]
    | GuiMultiSliderHandle[Any]
    | GuiVector2Handle
    | GuiVector3Handle
    | GuiRgbHandle
    | GuiRgbaHandle
)
"""The controls that a page can operate; a progress bar, for one, is not among them."""


def is_operable(handle: object) -> TypeIs[Operable]:
    """Tell whether a handle of viser is a control that a page can operate."""
    return isinstance(handle, _CLASSES)


def is_usable(control: Operable) -> bool:
    """Tell whether the user could operate the control: the page greys it out, but sends all the same."""
    return control.visible and not control.disabled


def accepts(control: Operable, value: Value) -> bool:
    """Tell whether the control can hold this value.

    Args:
        control: the addressed control.
        value: what the page sent.
    """
    match control:
        case GuiButtonHandle():
            return value is True
        case GuiCheckboxHandle():
            return isinstance(value, bool)
        case GuiTextHandle():
            return isinstance(value, str)
        case GuiButtonGroupHandle() | GuiDropdownHandle():
            return isinstance(value, str) and value in control.options
        case GuiNumberHandle():
            return _is_number_like(control.value, value)
        case GuiSliderHandle():
            return _is_number_like(control.value, value) and _is_within(value, control.min, control.max)
        case GuiMultiSliderHandle():
            return _are_numbers_like(control.value, value) and all(
                _is_within(part, control.min, control.max) for part in _parts(value)
            )
        case GuiVector2Handle() | GuiVector3Handle():
            return _are_numbers_like(control.value, value)
        case GuiRgbHandle() | GuiRgbaHandle():
            return _are_numbers_like(control.value, value) and all(0 <= part <= 255 for part in _parts(value))
        case GuiUploadButtonHandle():
            return False


def _is_number_like(present: object, value: object) -> bool:
    """Tell whether ``value`` is a number that needs no rounding to take the place of ``present``."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    return not isinstance(present, int) or float(value).is_integer()


def _are_numbers_like(present: tuple[float, ...], value: Value) -> bool:
    """Tell whether ``value`` has the components of ``present``, each a number of the same kind."""
    return (
        isinstance(value, tuple)
        and len(value) == len(present)
        and all(_is_number_like(old, new) for old, new in zip(present, value, strict=True))
    )


def _is_within(value: Value, low: float, high: float) -> bool:
    """Tell whether a slider can show the value; the page's rounding to its digits is let pass."""
    slack = 1e-6 * abs(high - low)
    return isinstance(value, int | float) and low - slack <= value <= high + slack


def _parts(value: Value) -> tuple[float, ...]:
    return value if isinstance(value, tuple) else ()
