"""Simulated CPUs with real firmware images, for every test in this folder."""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest
from tests.avr.avr import Avr
from tests.avr.building import IMAGES
from tests.avr.encoder_arm import EncoderArm
from tests.avr.plant import NEAR_HOME, Motor, Plant

MakeAvr = Callable[[str | Path], Avr]
MakeArm = Callable[..., EncoderArm]


@pytest.fixture
def make_avr() -> Generator[MakeAvr]:
    """Makes a simulated Mega with an image (one of ``IMAGES``, or a file); all are freed after the test."""
    with ExitStack() as made:

        def make(image: str | Path) -> Avr:
            avr = Avr(IMAGES[image]() if isinstance(image, str) else image)
            made.callback(avr.close)
            return avr

        yield make


@pytest.fixture
def make_arm() -> Generator[MakeArm]:
    """Makes a simulated Mega with the encoder firmware, an arm on its pins and a host; booted."""
    with ExitStack() as made:

        def make(motors: Sequence[Motor] = NEAR_HOME, **options: Any) -> EncoderArm:
            avr = Avr(IMAGES["encoder"]())
            plant = Plant(avr, motors, **options)
            made.callback(plant.close)  # after the simulator
            made.callback(avr.close)
            arm = EncoderArm(avr, plant)
            arm.boot()
            return arm

        yield make


@pytest.fixture
def homed(make_arm: MakeArm) -> EncoderArm:
    """An arm at home."""
    arm = make_arm()
    arm.home()
    return arm
