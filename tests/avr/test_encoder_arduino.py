"""The sketch folder as the Arduino IDE builds it: with the Arduino core, all its symbols and flags."""

from __future__ import annotations

import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from tests.avr.building import BUILD, ROOT, build_lock, run

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
