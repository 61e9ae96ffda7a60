"""The encoder firmware on its board: bridges, pins and lines as its README has them, Arduino's build."""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from tests.avr.building import BUILD, ROOT, build_lock, run
from tests.avr.conftest import MakeAvr
from tests.avr.encoder_arm import EncoderArm, sealed
from tests.avr.mega import PINS
from tests.avr.plant import WIRES

BEGINNING_CYCLES = 20_000
ENABLE = "H6"
RUNS_TO_ICR = 0x10
"""WGMn3 in TCCRnB: in modes without it ICRn cannot be written (datasheet, 16-bit timers, ICRn)."""


@pytest.mark.parametrize("timer", [0x90, 0xA0], ids=["timer 3", "timer 4"])
def test_the_period_of_the_pwm_is_set_when_it_can_be(make_avr: MakeAvr, timer: int) -> None:
    """The simulator takes it at any time; a real timer would keep 0, and every duty would be full drive."""
    avr = make_avr("encoder")
    period = 0
    for _ in range(BEGINNING_CYCLES):
        before, mode = period, avr.data(timer + 1)
        avr.run_until(avr.cycle + 1)
        period = avr.data(timer + 6) | avr.data(timer + 7) << 8
        if period != before:
            assert mode & RUNS_TO_ICR
    assert period == 510


def test_a_bridge_turns_round_only_while_it_is_off(homed: EncoderArm) -> None:
    """The duty takes effect a PWM period late: turned at once, the old one would drive the wrong way."""
    for counts in ((-900, -700, -800, -300, 300, 900), (-100, -50, -100, -10, 10, 100)):
        assert homed.ask(homed.setpoints(counts, 1)) == "ok"
        homed.run_until(lambda counts=counts: abs(homed.now().counts[0] - counts[0]) <= 2, 3)
    homed.run(0.3)
    assert homed.now().mode == "N"
    assert homed.plant.hot_turns == 0


def test_nothing_is_driven_from_the_reset_to_the_first_command(make_avr: MakeAvr) -> None:
    avr = make_avr("encoder")
    avr.watch(ENABLE)
    avr.run_for(1.0)
    avr.reset()
    avr.run_for(1.0)
    assert avr.edges() == []
    assert avr.pin(ENABLE) == 0
    for timer in (0x90, 0xA0):
        assert [avr.data(timer + offset) for offset in range(8, 14)] == [0] * 6


# What firmware/README.md shows is what a board would take and send.

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


# The sketch folder as the Arduino IDE builds it: with the Arduino core, all its symbols and flags.

SKETCH = ROOT / "firmware" / "encoder"
CORE = Path("/usr/share/arduino/hardware/arduino/avr")

# From its platform.txt and boards.txt (mega.build.*, compiler.*.flags), but with warnings on.
COMMON = (
    *("-mmcu=atmega2560", "-DF_CPU=16000000L"),
    *("-DARDUINO=10819", "-DARDUINO_AVR_MEGA2560", "-DARDUINO_ARCH_AVR"),
    *("-Os", "-g", "-flto", "-ffunction-sections", "-fdata-sections", "-c"),
    *(f"-I{CORE / 'cores' / 'arduino'}", f"-I{CORE / 'variants' / 'mega'}"),
)
LANGUAGES = {
    ".S": ("avr-gcc", "-x", "assembler-with-cpp"),
    ".c": ("avr-gcc", "-std=gnu11", "-fno-fat-lto-objects"),
    ".cpp": ("avr-g++", "-std=gnu++11", "-fpermissive", "-fno-exceptions", "-fno-threadsafe-statics"),
}


def compiled(sources: Sequence[Path], folder: Path, *options: str) -> list[str]:
    """The sources' object files."""

    def compile_one(source: Path) -> str:
        product = folder / f"{source.name}.o"
        run([*LANGUAGES[source.suffix], *COMMON, *options, str(source), "-o", str(product)])
        return str(product)

    with ThreadPoolExecutor(os.cpu_count()) as pool:
        return list(pool.map(compile_one, sources))


def arduino_core() -> Path:
    """The Arduino core, which does not change, as an archive."""
    sources = sorted(path for path in (CORE / "cores" / "arduino").iterdir() if path.suffix in LANGUAGES)
    archive, folder = BUILD / "arduino-core.a", BUILD / "arduino-core"
    with build_lock():
        if not archive.exists():
            folder.mkdir(exist_ok=True)
            # Debian's compiler has no DECIMAL_DIG in C++11; Arduino's own has.
            objects = compiled(sources, folder, "-w", "-DDECIMAL_DIG=__DECIMAL_DIG__")
            partial = folder / "partial.a"
            partial.unlink(missing_ok=True)
            run(["avr-gcc-ar", "rcs", str(partial), *objects])
            partial.replace(archive)
    return archive


def test_the_sketch_folder_links_with_the_arduino_core(tmp_path: Path) -> None:
    """Its ``main`` takes the core's place, and no interrupt is wanted by both."""
    # The IDE makes one C++ file out of the .ino files, with the core's header in front.
    ino = tmp_path / "encoder.ino.cpp"
    ino.write_text("#include <Arduino.h>\n" + (SKETCH / "encoder.ino").read_text())
    objects = compiled([ino, *sorted(SKETCH.glob("*.cpp"))], tmp_path, "-Wall", "-Wextra", "-Werror")
    elf = tmp_path / "encoder.elf"
    link = ("avr-gcc", "-mmcu=atmega2560", "-Os", "-g", "-flto", "-fuse-linker-plugin", "-Wl,--gc-sections")
    run([*link, "-o", str(elf), *objects, str(arduino_core()), "-lm"])

    symbols = {line.split()[-1] for line in run(["avr-nm", str(elf)]).splitlines()}
    assert "setup" not in symbols, "the core's main() was linked"
    assert {"main", "__vector_17", "__vector_25"} <= symbols  # the control's tick and the serial line's
    data, bss = map(int, run(["avr-size", str(elf)]).splitlines()[1].split()[1:3])
    assert data + bss < 4096, "half of the RAM is the stack's"
