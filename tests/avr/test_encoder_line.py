"""The encoder firmware's serial line under bad bytes, repeats and resets."""

from __future__ import annotations

import os
import random
from collections.abc import Callable

import pytest
from tests.avr.conftest import MakeArm
from tests.avr.encoder_arm import EncoderArm, sealed

TIMSK1 = 0x6F
"""Data address of the register that enables the control's timer interrupt."""
BYTE_S = 10 / 115_200
MCUSR = 0x54
"""Data address of the register that says why the CPU was reset, where no boot loader has cleared it."""
POWER_ON, EXTERNAL, BROWN_OUT = 1, 2, 4
INTERRUPTED = 16


def test_a_repeated_line_is_answered_again_and_not_carried_out_again(make_arm: MakeArm) -> None:
    """Carried out again, the answers below would be others: the motors are off by then."""
    arm = make_arm()
    arm.home()
    line = arm.post("P 300 - - - - - 200")
    arm.run(0.35)
    assert arm.answers[-1] == f"{arm.seq} ok"
    arm.avr.write(b"\x18")
    arm.run(0.3)
    answers, way = len(arm.answers), arm.plant.way
    for _ in range(5):
        arm.avr.write(line)
        arm.run(0.02)
    assert arm.answers[answers:] == [f"{arm.seq} ok"] * 5
    assert arm.plant.way == way
    assert arm.status[-1].mode == "O"

    line = arm.post("EN 1")
    arm.run(0.02)
    assert arm.plant.powered
    arm.avr.write(b"\x18" + line)
    arm.run(0.05)
    assert not arm.plant.powered
    assert arm.answers[-2:] == [f"{arm.seq} ok"] * 2
    arm.post("PING")
    arm.avr.write(line)
    arm.run(0.05)
    assert arm.plant.powered, "only the last line is remembered"


def test_a_reset_forgets_the_last_line(make_arm: MakeArm) -> None:
    """Else a host that begins to count anew would hear `ok` and nothing be done."""
    arm = make_arm()
    assert arm.ask("EN 1") == "ok"
    arm.reset()
    assert not arm.plant.powered
    arm.seq = 0
    arm.answers.clear()
    assert arm.ask("EN 1") == "ok"
    assert arm.plant.powered


def test_the_banner_says_why_it_started(make_arm: MakeArm) -> None:
    arm = make_arm()
    assert arm.banners == ["armctl-encoder 1.3.0 proto=4 axes=6 reset=power"]
    arm.reset()
    assert arm.banners[-1].endswith(" reset=external")
    assert arm.ask("HELLO").endswith(" reset=external")


def restarted(arm: EncoderArm, flags: int) -> tuple[str, int]:
    """The cause that it tells, and its status flags, after a reset that has left ``flags`` in MCUSR."""
    seen = len(arm.banners)
    arm.avr.reset()
    arm.avr.set_data(MCUSR, flags)
    arm.avr.read()
    arm._rest = b""
    arm.run(0.05)
    (banner,) = arm.banners[seen:]
    return banner.rpartition("=")[2], arm.now().flags


def test_a_reset_in_the_middle_of_work_is_told_behind_a_boot_loader(make_arm: MakeArm) -> None:
    """A boot loader hands on nothing of the cause; RAM stays, as in a brown-out."""
    arm = make_arm()
    arm.home()
    assert restarted(arm, 0) == ("unexpected", INTERRUPTED)
    arm.run(0.6)
    assert restarted(arm, 0) == ("external", INTERRUPTED), "nobody has taken note yet"
    assert arm.ask("CLR") == "ok"
    arm.run(0.6)
    assert restarted(arm, 0) == ("external", 0), "a host that opens the port"
    assert restarted(arm, 0) == ("unexpected", INTERRUPTED), "a host had just been heard"
    assert restarted(arm, POWER_ON) == ("power", 0)
    assert restarted(arm, BROWN_OUT) == ("brownout", 4)
    assert arm.ask("CLR") == "ok"
    assert restarted(arm, EXTERNAL) == ("external", 0), "without a boot loader it is known"


def test_a_hang_is_told_behind_a_boot_loader(make_arm: MakeArm) -> None:
    """The motors go off at half of the watchdog's time."""
    arm = make_arm()
    assert arm.ask("EN 1") == "ok"
    arm.avr.set_data(TIMSK1, 0)
    arm.avr.run_for(0.14)
    assert not arm.plant.powered
    assert restarted(arm, 0) == ("watchdog", INTERRUPTED)


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
        line = damaged(generator, sealed(f"{seq % 65535 + 1} {generator.choice(commands)}"))
        heard = line.translate(None, b"\x18!~?")  # those are no part of a line: it may be whole without
        if not any(whole(piece) for piece in heard.split(b"\n")):
            data += line
    return bytes(data[:count])


def whole(line: bytes) -> bool:
    """Whether a board would take it."""
    line = line.removesuffix(b"\r") + b"\n"
    return sealed(line.rpartition(b"*")[0].decode("latin-1")) == line


def damaged(generator: random.Random, line: bytes) -> bytes:
    damage = bytearray(line)
    for _ in range(generator.randint(1, 3)):
        at = generator.randrange(len(damage))
        match generator.randrange(4):
            case 0:
                damage[at] ^= 1 << generator.randrange(8)
            case 1:
                del damage[at]
            case 2:
                damage.insert(at, generator.randrange(256))
            case _:
                damage[at:at] = damage[at : at + generator.randrange(40)]
    return bytes(damage)


RUBBISH = 500_000 if os.environ.get("ARMCTL_LONG") else 60_000


@pytest.mark.parametrize(("bytes_of", "seed"), [(noise, 1), (mutated, 2)])
def test_bytes_of_rubbish_move_nothing(
    make_arm: MakeArm, bytes_of: Callable[[random.Random, int], bytes], seed: int
) -> None:
    """As fast as the line carries them."""
    arm = make_arm()
    arm.avr.watch("H6")
    data = bytes_of(random.Random(seed), RUBBISH)
    for at in range(0, len(data), 20_000):
        arm.avr.write(data[at : at + 20_000])
        arm.run(20_000 * BYTE_S)
    arm.run(5.0)  # what the simulated line still holds back
    arm.avr.write(b"\n")  # behind it: a board that is flooded loses bytes
    arm.run(0.1)
    assert len(arm.answers) > RUBBISH // 500, "the board has not heard much of it"
    assert {answer.split(" ")[0] for answer in arm.answers} == {"0"}, "a line was carried out"
    assert arm.plant.way == 0.0
    assert not arm.avr.edges(), "the motors were switched on"
    assert len(arm.banners) == 1, "the board has started anew on the way"
    assert arm.ask("PING") == "ok"
    status = arm.now()
    assert (status.mode, status.homed, status.faults) == ("O", 0, (0,) * 6)


def test_rubbish_does_not_keep_the_motors_on(make_arm: MakeArm) -> None:
    """Bytes are not a host: the watchdog strikes under noise."""
    arm: EncoderArm = make_arm()
    assert arm.ask("EN 1") == "ok"
    generator = random.Random(3)
    for _ in range(6):
        arm.avr.write(bytes(byte for byte in generator.randbytes(1000) if byte not in b"\x18!~?"))
        arm.avr.run_for(0.1)
    assert not arm.plant.powered


def test_a_damaged_byte_does_not_set_free_what_is_held(make_arm: MakeArm) -> None:
    arm = make_arm()
    assert arm.ask("EN 1") == "ok"
    arm.avr.write(b"!", damaged=True)
    arm.avr.write(b"\n")
    arm.run(0.05)
    assert arm.now().mode == "B", "what stops acts in any case"
    arm.avr.write(b"~", damaged=True)
    arm.avr.write(b"\n")
    arm.run(0.05)
    assert arm.now().mode == "B"
    arm.avr.write(b"~")
    arm.run(0.05)
    assert arm.now().mode == "N"


def test_a_flood_of_status_requests_keeps_no_line_waiting(make_arm: MakeArm) -> None:
    """Else the watchdog would strike although the host talks."""
    arm = make_arm()
    arm.avr.write(b"?" * 250)
    arm.run(250 * BYTE_S)
    begin = len(arm.status)
    assert arm.ask("PING") == "ok"
    arm.run(0.3)
    assert len(arm.status) - begin > 20, "they are not thrown away either"
