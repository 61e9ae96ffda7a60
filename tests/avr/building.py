"""Builds what the simulated boards need: the shim, and firmware images."""

from __future__ import annotations

import fcntl
import os
import shutil
import subprocess
from collections.abc import Generator, Sequence
from contextlib import contextmanager
from pathlib import Path

ROOT = Path(__file__).parents[2]
BUILD = ROOT / "build" / "avr"
PACKAGES = "simavr libsimavr-dev libelf-dev gcc libc6-dev gcc-avr avr-libc arduino-core-avr pkg-config make"

_HERE = Path(__file__).parent


class BuildError(RuntimeError):
    """What a simulated board needs cannot be built here; the message says why and what to do."""


@contextmanager
def build_lock() -> Generator[None]:
    """One process builds at a time, however many test workers there are."""
    BUILD.mkdir(parents=True, exist_ok=True)
    with (BUILD / ".lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield


def shim_library() -> Path:
    """The compiled shim.

    Raises:
        BuildError: no compiler or no simavr.
    """
    return _library(_HERE / "shim.c", BUILD / "libavr.so")


def plant_library() -> Path:
    """The compiled plant.

    Raises:
        BuildError: no compiler or no simavr.
    """
    return _library(_HERE / "plant.c", BUILD / "libplant.so")


def _library(source: Path, library: Path) -> Path:
    """Compiled for this computer, again when its source is newer."""
    with build_lock():
        if _is_stale(library, [source]):
            flags = run(["pkg-config", "--cflags", "--libs", "simavr"]).split()
            partial = library.with_suffix(".partial")
            options = ["-O2", "-Wall", "-Wextra", "-Werror", "-shared", "-fPIC"]
            run(["gcc", *options, "-o", str(partial), str(source), *flags, "-lm"])
            partial.replace(library)
    return library


def encoder_image() -> Path:
    """The encoder firmware's image, built by its own Makefile, which knows what is stale.

    Raises:
        BuildError: it does not compile, or the compiler is missing.
    """
    folder = ROOT / "firmware" / "encoder"
    with build_lock():
        run(["make", "--silent", "-C", str(folder)])
    image = ROOT / "build" / "firmware" / "encoder.hex"
    if not image.is_file():
        raise BuildError(f"make -C {folder.relative_to(ROOT)} left no {image.relative_to(ROOT)}")
    return image


def avr_image(source: Path) -> Path:
    """A small firmware of one C file, compiled for the Mega's CPU without any library.

    Raises:
        BuildError: it does not compile, or the compiler is missing.
    """
    elf, image = BUILD / f"{source.stem}.elf", BUILD / f"{source.stem}.hex"
    with build_lock():
        if _is_stale(image, [source]):
            options = ["-mmcu=atmega2560", "-DF_CPU=16000000UL", "-Os", "-Wall", "-Wextra", "-Werror"]
            run(["avr-gcc", *options, "-o", str(elf), str(source)])
            partial = image.with_suffix(".partial")
            run(["avr-objcopy", "-O", "ihex", "-R", ".eeprom", str(elf), str(partial)])
            partial.replace(image)
    return image


def _is_stale(product: Path, sources: Sequence[Path]) -> bool:
    return not product.exists() or any(source.stat().st_mtime > product.stat().st_mtime for source in sources)


def run(command: Sequence[str], packages: str = PACKAGES) -> str:
    """Run a command and return what it prints.

    Raises:
        BuildError: it is not installed (of Debian's ``packages``), or it failed.
    """
    if shutil.which(command[0]) is None:
        raise BuildError(f"{command[0]} is not installed; install it first: sudo apt-get install {packages}")
    # A test run out of make would else hand its own make's options on.
    environment = {name: value for name, value in os.environ.items() if not name.startswith("MAKE")}
    done = subprocess.run(command, capture_output=True, text=True, env=environment, check=False)
    if done.returncode:
        raise BuildError(
            f"`{' '.join(command)}` failed:\n{done.stdout}{done.stderr}\n"
            f"If something is missing: sudo apt-get install {packages}"
        )
    return done.stdout
