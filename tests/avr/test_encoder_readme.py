"""What firmware/README.md shows of the line is what a board would take and send."""

from __future__ import annotations

import re

from tests.avr.building import ROOT
from tests.avr.encoder_arm import sealed
from tests.avr.mega import PINS
from tests.avr.plant import WIRES

FIRMWARE = ROOT / "firmware"


def test_every_line_of_the_session_has_the_right_check() -> None:
    _, _, session = (FIRMWARE / "README.md").read_text().partition("### A session")
    lines = re.findall(r"^    (\S.*\*[0-9A-F]{4})$", session, re.MULTILINE)
    assert len(lines) > 20
    assert [sealed(line.rpartition("*")[0]).decode().rstrip() for line in lines] == lines


def test_the_readme_names_the_version_and_the_protocol_of_the_source() -> None:
    source = (FIRMWARE / "encoder" / "config.h").read_text()
    version, protocol = re.findall(r'^#define (?:FIRMWARE|PROTOCOL)_VERSION "(.*)"$', source, re.MULTILINE)
    readme = (FIRMWARE / "README.md").read_text()
    assert f"(this one: {protocol}, firmware {version})" in readme
    assert set(re.findall(r"armctl-encoder (\S+) proto=(\d+)", readme)) == {(version, protocol)}


def test_the_pins_of_the_readme_are_those_of_the_source_and_of_the_simulated_arm() -> None:
    """Axis by axis; ``config.h`` repeats the table for who reads the source."""
    readme = table((FIRMWARE / "README.md").read_text(), "|")
    source = table((FIRMWARE / "encoder" / "config.h").read_text().replace("//", ""), None)
    arm = {
        "motor PWM": [wires.pwm for wires in WIRES],
        "motor direction": [wires.direction for wires in WIRES],
        "encoder A": [wires.a for wires in WIRES],
        "encoder B": [wires.b for wires in WIRES],
        "home switch": [wires.switch for wires in WIRES],
    }
    assert readme == arm
    assert source == arm


def test_the_pins_lie_on_the_ports_that_the_firmware_reads_as_a_whole() -> None:
    """Both channels of an encoder, at the bits that ``encoders.cpp`` takes them from."""
    assert [(PINS[wires.a], PINS[wires.b]) for wires in WIRES] == [
        ("D0", "D1"),
        ("D2", "D3"),
        *((f"K{bit}", f"K{bit + 1}") for bit in (0, 2, 4, 6)),
    ]
    assert [PINS[wires.switch] for wires in WIRES] == [f"A{axis}" for axis in range(6)]
    assert [PINS[wires.direction] for wires in WIRES] == [f"C{axis}" for axis in range(6)]
    assert [PINS[wires.pwm] for wires in WIRES] == ["E3", "E4", "E5", "H3", "H4", "H5"]  # OC3A … OC4C


def table(text: str, separator: str | None) -> dict[str, list[int]]:
    """The rows of a pin table by their name; A8 is pin 62."""
    rows: dict[str, list[int]] = {}
    for line in text.splitlines():
        found = re.match(r"[\s|]*(motor PWM|motor direction|encoder [AB]|home switch)\s+(.*)", line)
        if found:
            cells = [cell.strip() for cell in found[2].strip(" |").split(separator)][:6]
            rows.setdefault(found[1], [54 + int(c[1:]) if c[0] == "A" else int(c) for c in cells])
    return rows
