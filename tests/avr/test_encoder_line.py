"""The encoder firmware's serial line under bad bytes, repeats and resets."""

from __future__ import annotations

import random

import pytest

from tests.avr.conftest import MakeArm
from tests.avr.encoder_arm import EncoderArm, Status, sealed

TCCR1B, TIMSK1 = 0x81, 0x6F
"""Data addresses of the control tick's timer."""


def test_a_repeated_line_is_answered_again_and_not_carried_out_again(make_arm: MakeArm) -> None:
    arm = make_arm()
    arm.home()
    line = arm.post("P 300 - - - - - 300")
    arm.run(0.8)
    first = arm.answers[-1]
    assert first == f"{arm.seq} ok"
    assert arm.ask("P -200 - - - - - 300") == "ok"
    arm.run(0.45)
    last = sealed(f"{arm.seq} P -200 - - - - - 300")
    here = arm.now().counts[0]
    assert here == pytest.approx(-200, abs=1)

    # The very last line that was carried out is GET now; repeat that, and a motion that is the last.
    assert arm.ask("P -150 - - - - - 300") == "ok"
    line = sealed(f"{arm.seq} P -150 - - - - - 300")
    arm.avr.write(b"\x18")
    arm.run(0.05)
    answers = len(arm.answers)
    way = arm.plant.way
    for _ in range(5):
        arm.avr.write(line)
        arm.run(0.02)
    assert arm.answers[answers:] == [f"{arm.seq} ok"] * 5
    assert arm.plant.way == way
    assert arm.status[-1].mode == "O"
    assert last != line


def test_the_banner_says_why_it_started(make_arm: MakeArm) -> None:
    arm = make_arm()
    assert arm.banners == ["armctl-encoder 1.0.0 proto=1 axes=6 reset=power"]
    arm.avr.reset()
    arm.boot()
    assert arm.banners[-1].endswith(" reset=external")
    assert arm.ask("HELLO").endswith(" reset=external")


def test_a_hung_control_resets_the_cpu_with_the_motors_off(make_arm: MakeArm) -> None:
    arm = make_arm()
    arm.home()
    arm.post("P -6000 - - - - - 1000")
    arm.run(0.4)
    assert arm.plant.powered
    arm.avr.set_data(TIMSK1, 0)  # as if the control had crashed
    arm.run(0.4)
    assert arm.banners[-1].endswith(" reset=watchdog")
    assert not arm.plant.powered
    status = arm.now()
    assert (status.mode, status.homed) == ("O", 0)
    arm.run(0.5)
    assert arm.plant.speed == 0.0


def noise(generator: random.Random, count: int) -> bytes:
    return generator.randbytes(count)


def mutated(generator: random.Random, count: int) -> bytes:
    """Lines that would move or configure the arm, each with something wrong in it."""
    commands = (
        "EN 1", "HOME", "HOME 0 1", "P 500 500 500 100 100 500 20", "CFG 0 min=-9 max=9 kp=9", "WD 500",
        "PAIR NONE", "CLR", "GET", "PING", "HELLO", "SHOW 3 1", "P - - - - - 100",
    )  # fmt: skip
    data = bytearray()
    seq = 0
    while len(data) < count:
        seq += 1
        line = bytearray(sealed(f"{seq % 65536} {generator.choice(commands)}"))
        for _ in range(generator.randint(1, 3)):
            match generator.randrange(4):
                case 0:
                    at = generator.randrange(len(line))
                    line[at] ^= 1 << generator.randrange(8)
                case 1:
                    del line[generator.randrange(len(line))]
                case 2:
                    line.insert(generator.randrange(len(line)), generator.randrange(256))
                case _:
                    at = generator.randrange(len(line))
                    line[at:at] = line[at : at + generator.randrange(40)]
        data += line
    return bytes(data[:count])


@pytest.mark.parametrize(("bytes_of", "seed"), [(noise, 1), (mutated, 2)])
def test_half_a_million_bytes_of_rubbish_move_nothing(make_arm: MakeArm, bytes_of, seed: int) -> None:
    """As fast as the line carries them. Two kinds: a million bytes in all."""
    arm = make_arm()
    assert arm.ask("PING") == "ok"
    arm.avr.watch("H6")
    data = bytes_of(random.Random(seed), 500_000)
    rest = b""
    answers = 0
    for at in range(0, len(data), 20_000):
        arm.avr.write(data[at : at + 20_000])
        arm.avr.run_for(20_000 * 10 / 117_647)
        *lines, rest = (rest + arm.avr.read()).split(b"\n")
        for line in lines:
            check(line)
            answers += line[:2] == b"0 "
    arm.avr.write(b"\n")
    arm.run(0.2)
    assert answers > 1000, "the board has not heard much of it"
    assert arm.plant.way == 0.0
    assert not arm.avr.edges(), "the motors were switched on"
    arm._rest = b""
    assert arm.ask("PING") == "ok"
    status = arm.now()
    assert (status.mode, status.homed, status.faults) == ("O", 0, (0,) * 6)
    assert status.ms > 1000 * (arm.avr.now - 1), "the board has started anew on the way"


def check(line: bytes) -> None:
    """Every line from the board is whole, whatever it was sent."""
    text = line.decode("ascii")
    body, _, _ = text.rpartition("*")
    assert sealed(body) == line + b"\n", line
    if body.startswith("@ "):
        Status.of(body[2:])
        return
    assert body[0] in "!0123456789", body


def test_rubbish_does_not_keep_the_motors_on(make_arm: MakeArm) -> None:
    """Bytes are not a host: the watchdog strikes under noise."""
    arm: EncoderArm = make_arm()
    assert arm.ask("EN 1") == "ok"
    generator = random.Random(3)
    for _ in range(6):
        arm.avr.write(bytes(byte for byte in generator.randbytes(1000) if byte not in b"\x18!~?"))
        arm.avr.run_for(0.1)
    assert not arm.plant.powered
