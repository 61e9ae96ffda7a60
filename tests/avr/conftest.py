"""Simulated CPUs with real firmware images, for every test in this folder."""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from pathlib import Path
from typing import Any

import pytest
from tests.avr.avr import Avr
from tests.avr.building import avr_image, encoder_image, shim_library
from tests.avr.encoder_arm import EncoderArm
from tests.avr.firmata_image import firmata_image
from tests.avr.plant import NEAR_HOME, Motor, Plant

MakeAvr = Callable[[Path], Avr]
MakeArm = Callable[..., EncoderArm]


@pytest.fixture(scope="session")
def avr_library() -> Path:
    """The compiled simulator shim."""
    return shim_library()


@pytest.fixture(scope="session")
def encoder_firmware() -> Path:
    """The image of firmware/encoder, up to date."""
    return encoder_image()


@pytest.fixture(scope="session")
def firmata_firmware() -> Path:
    """The image of StandardFirmata that others built."""
    return firmata_image()


@pytest.fixture(scope="session")
def known_firmware() -> Path:
    """The image of known.c, which speaks neither of armctl's protocols."""
    return avr_image(Path(__file__).parent / "known.c")


@pytest.fixture
def make_avr(avr_library: Path) -> Generator[MakeAvr]:
    """Makes a simulated Mega with an image; all are freed after the test."""
    made: list[Avr] = []

    def make(image: Path) -> Avr:
        avr = Avr(avr_library, image)
        made.append(avr)
        return avr

    yield make
    for avr in made:
        avr.close()


@pytest.fixture
def make_arm(avr_library: Path, encoder_firmware: Path, make_avr: MakeAvr) -> Generator[MakeArm]:
    """Makes a simulated Mega with the encoder firmware, an arm on its pins and a host; booted."""
    made: list[EncoderArm] = []

    def make(motors: Sequence[Motor] = NEAR_HOME, **options: Any) -> EncoderArm:
        avr = make_avr(encoder_firmware)
        arm = EncoderArm(avr, Plant(avr_library, avr, motors, **options))
        made.append(arm)
        arm.boot()
        return arm

    yield make
    for arm in made:
        arm.avr.close()
        arm.plant.close()
