"""What a board measures of a joint besides where it is."""

from __future__ import annotations

from dataclasses import dataclass, fields


@dataclass(frozen=True, slots=True)
class Quantities:
    """Numbers of one moment; None: not measured, or for once not known."""

    load: float | None = None
    """force of its motor, as a signed share of the largest"""
    temperature_c: float | None = None
    """[°C]"""
    voltage_v: float | None = None
    """of its supply [V]"""
    current_a: float | None = None
    """[A]"""

    def __str__(self) -> str:
        """As people read them: ``load −12 %, 41 °C``."""
        told = (
            form.format(scale * value).replace("-", "−")
            for value, (scale, form) in zip((getattr(self, name) for name in NAMES), _FORMS, strict=True)
            if value is not None
        )
        return ", ".join(told)


NAMES = tuple(one.name for one in fields(Quantities))
_FORMS = ((100, "load {:.0f} %"), (1, "{:.0f} °C"), (1, "{:.1f} V"), (1, "{:.2f} A"))
