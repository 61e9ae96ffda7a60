"""What an encoder board says to what it hears: one suite for the firmware and for its simulation.

Each function takes a board that has just been started, motors off, nothing attached to its motors that
would move, and talks to it in bytes. The checksum is worked out here, apart from both sides.
"""

from __future__ import annotations

import itertools
import random
import re

from tests.avr.conformance import Line, checks

START_S = 0.3
TURN_S = 0.06
STATUS = re.compile(
    r"@ \d+ [ONHBT] [0-9a-f]{2} [0-9a-f]{2} [0-9a-f]{2} [0-9a-f]{12} [0-9a-f]{6} [0-9a-f]{8}(?: -?\d+){6}",
    re.ASCII,
)
LONGEST_FROM_BOARD = 127


def crc16(data: bytes) -> int:
    """CRC-16/IBM-3740, bit by bit."""
    remainder = 0xFFFF
    for byte in data:
        remainder ^= byte << 8
        for _ in range(8):
            remainder = remainder << 1 ^ 0x1021 if remainder & 0x8000 else remainder << 1
        remainder &= 0xFFFF
    return remainder


def sealed(text: str) -> bytes:
    return f"{text}*{crc16(text.encode()):04X}\n".encode()


class Host:
    """Asks, and takes apart what comes back; every line must carry its checksum."""

    def __init__(self, line: Line) -> None:
        self.line = line
        self.sequence = 100
        self.unasked: list[str] = []
        self.rest = b""
        self.send(b"", START_S)

    def send(self, data: bytes, seconds: float = TURN_S) -> list[str]:
        """The answers to ``data``; what came unasked is in ``unasked``."""
        raw = self.line.exchange(data, seconds)
        answers: list[str] = []
        self.unasked = []
        # A status line may be on its way when the time is up.
        *lines, self.rest = (self.rest + raw).split(b"\n")
        for one in lines:
            assert len(one) <= LONGEST_FROM_BOARD, one
            text = one.decode("ascii")
            body, _, crc = text.rpartition("*")
            assert crc == f"{crc16(body.encode()):04X}", text
            (self.unasked if body[0] in "@!#" else answers).append(body)
        return answers

    def ask(self, text: str, sequence: int | None = None) -> str:
        """The one answer to ``text``, without its number."""
        if sequence is None:
            self.sequence += 1
            sequence = self.sequence
        answers = self.send(sealed(f"{sequence} {text}"))
        assert len(answers) == 1, (text, answers)
        number, _, rest = answers[0].partition(" ")
        assert number == str(sequence), (text, answers)
        return rest

    def status(self) -> list[str]:
        """The fields of a status of now: time, mode, homed, switches, global, faults, lost edges, counts."""
        self.send(b"?")
        found = [one for one in self.unasked if one.startswith("@ ")]
        assert found, self.unasked
        assert STATUS.fullmatch(found[-1]), found[-1]
        return found[-1].split(" ")[1:]

    @property
    def mode(self) -> str:
        return self.status()[1]

    @property
    def events(self) -> list[str]:
        """The events of the last turn."""
        return [one for one in self.unasked if one.startswith("! ")]


def code(answer: str) -> str:
    """``err CODE`` of a refusal."""
    assert answer.startswith("err "), answer
    return answer.split(" ")[1]


def it_introduces_itself(line: Line) -> None:
    assert crc16(b"123456789") == 0x29B1, "the published check value"
    host = Host(line)
    banners = [one for one in host.unasked if one.startswith("# ")]
    assert len(banners) == 1
    assert re.fullmatch(
        r"# armctl-encoder \d+\.\d+\.\d+ proto=4 axes=6 reset=(power|external)", banners[0]
    ), banners
    assert host.ask("HELLO") == f"ok {banners[0][2:]}"


def it_starts_off_and_knows_nothing(line: Line) -> None:
    _, mode, homed, _, flags, faults, lost, changes, *counts = Host(line).status()
    assert (mode, homed, flags, faults, lost, changes) == ("O", "00", "00", "0" * 12, "0" * 6, "0" * 8)
    assert len(counts) == 6


def it_tells_its_status_50_times_a_second(line: Line) -> None:
    host = Host(line)
    host.send(b"", 1.0)
    assert all(STATUS.fullmatch(one) for one in host.unasked), host.unasked
    assert 48 <= len(host.unasked) <= 52
    times = [int(one.split(" ")[1]) for one in host.unasked]
    assert all(15 <= later - earlier <= 25 for earlier, later in itertools.pairwise(times))


def it_tells_its_status_when_asked(line: Line) -> None:
    host = Host(line)
    asked = 0
    for _ in range(5):
        host.send(b"?", 0.05)
        asked += len(host.unasked)
    assert 5 + 11 <= asked <= 5 + 14


def a_wrong_checksum_is_refused(line: Line) -> None:
    host = Host(line)
    good = sealed("1 EN 1")
    for wrong in (good.replace(b"EN 1", b"EN 0"), good[:-5] + b"0000\n", good[1:]):
        (answer,) = host.send(wrong)
        assert answer.startswith("0 err CRC"), (wrong, answer)
    assert host.mode == "O"


def a_line_without_a_checksum_is_refused(line: Line) -> None:
    host = Host(line)
    for wrong in (b"1 EN 1", b"*", b"1 EN 1*12", b"1 EN 1*abcd", b"1 EN 1*0x1F", b"\x00\xff\x80", b"1"):
        (answer,) = host.send(wrong + b"\n")
        assert answer.startswith("0 err CRC"), (wrong, answer)
    assert host.mode == "O"


def a_number_that_is_none_is_refused(line: Line) -> None:
    host = Host(line)
    for number in ("x", "0", "65536", "-1", "1.5", "99999999999"):
        (answer,) = host.send(sealed(f"{number} EN 1"))
        assert answer.startswith("0 err SYNTAX"), (number, answer)
    assert host.mode == "O"
    assert host.ask("PING", 65535) == "ok"
    assert host.ask("PING", 1) == "ok"


def a_line_that_is_too_long_is_dropped_whole(line: Line) -> None:
    host = Host(line)
    longest = "7 " + "X" * (96 - 7)
    assert len(sealed(longest)) == 96 + 1
    (answer,) = host.send(sealed(longest))
    assert answer.startswith("7 err UNKNOWN")
    for size in (97, 200, 1000):
        answers = host.send(b"X" * (size - 13) + sealed("12345 EN 1"), 0.2)
        assert len(answers) == 1 and answers[0].startswith("0 err LONG"), (size, answers)
    assert host.ask("PING") == "ok"
    assert host.mode == "O"
    host.send(b"X" * 97 + b"\n", 0.2)
    flags = [one.split(" ")[5] for one in host.unasked if one.startswith("@ ")]
    assert flags.count("02") == 1 and flags[-1] == "00", flags


def line_ends_of_any_computer(line: Line) -> None:
    host = Host(line)
    assert host.send(sealed("1 PING").replace(b"\n", b"\r\n")) == ["1 ok"]
    assert host.send(b"\n\r\n\n") == []
    assert host.send(sealed("2 PING") + sealed("3 PING"), 0.1) == ["2 ok", "3 ok"]


def a_line_in_pieces(line: Line) -> None:
    host = Host(line)
    for byte in sealed("1 PING")[:-1]:
        assert host.send(bytes([byte]), 0.01) == []
    assert host.send(b"\n") == ["1 ok"]


def a_repeated_line_is_answered_and_not_repeated(line: Line) -> None:
    host = Host(line)
    assert host.ask("EN 1", 7) == "ok"
    host.send(b"\x18")
    assert host.mode == "O"
    assert host.ask("EN 1", 7) == "ok"
    assert host.mode == "O", "a repeated line switched the motors on"
    assert host.ask("EN 1", 8) == "ok"
    assert host.mode == "N"
    host.ask("EN 0", 8)
    assert host.mode == "O", "another line with the same number is another line"
    refused = host.ask("P 1 - - - - -", 9)
    assert code(refused) == "OFF"
    host.send(b"junk\n")
    assert host.ask("P 1 - - - - -", 9) == refused
    said = host.ask("GET", 11)
    assert STATUS.fullmatch("@ " + said.removeprefix("ok ")), said
    assert host.ask("GET", 11) == said, "a repeated answer is from then"
    assert host.ask("GET", 12) != said


def realtime_bytes_are_no_part_of_a_line(line: Line) -> None:
    host = Host(line)
    whole = sealed("1 PING")
    for at in range(len(whole)):
        for byte in (b"?", b"!", b"~", b"\x18"):
            text = sealed(f"{at * 4 + byte[0]} PING")
            cut = min(at, len(text) - 1)
            (answer,) = host.send(text[:cut] + byte + text[cut:], 0.03)
            assert answer.endswith(" ok"), (cut, byte, answer)


def what_it_does_not_know_is_refused(line: Line) -> None:
    host = Host(line)
    for text in ("FLY", "hello", "ENX 1", "G1"):
        assert code(host.ask(text)) == "UNKNOWN", text


def arguments_that_do_not_fit_are_refused(line: Line) -> None:
    host = Host(line)
    missing = ("EN", "EN 2", "EN x", "CFG", "CFG 0", "CFG 0 bogus=1", "CFG 0 kp", "CFG 0 kp=", "CFG 0 kp=x")
    missing += ("CFG x kp=1", "P", "P 1 2 3", "P 1 2 3 4 5 x", "WD", "WD x", "PAIR", "PAIR 1", "PAIR 3 3")
    missing += ("SHOW", "HOME x", "CFG 6 kp=1", "CFG -1 kp=1", "PAIR 0 6", "HOME 6", "WD 49", "WD 501")
    ranges = (
        "vmax=0",
        "vmax=8001",
        "hv=8001",
        "amax=0",
        "amax=65536",
        "kp=-1",
        "kp=32768",
        "ki=32768",
        "kd=32768",
    )
    ranges += ("brk=256", "ferr=0", "ferr=30001", "stall=19", "stall=5001", "hord=7", "hdir=2", "hv=0")
    ranges += ("min=-1000001", "max=1000001", "min=10 max=10", "min=10 max=-10", "hpos=1000001", "hmode=2")
    ranges += ("inv=2", "minv=2", "sinv=2", "dmax=0", "dmax=256")
    before = settings(host)
    for text in (*missing, *(f"CFG 0 {pair}" for pair in ranges)):
        assert code(host.ask(text)) in ("ARGS", "RANGE"), text
    for pair in ranges:
        assert code(host.ask(f"CFG 0 {pair}")) == "RANGE", pair
    assert settings(host) == before


def settings(host: Host, axis: int = 0) -> dict[str, str]:
    """What SHOW says."""
    words: list[str] = []
    for part in (1, 2):
        answer = host.ask(f"SHOW {axis} {part}")
        assert answer.startswith("ok "), answer
        words += answer.split(" ")[1:]
    return dict(word.split("=") for word in words)


SCORBOT = (
    "min=-22000 max=22000 vmax=2840 amax=11400 kp=1200 ki=2000 kd=16 brk=200 ferr=600 "
    "stall=300 hdir=1 hv=900 hpos=0 hord=6 hmode=0 inv=0 minv=0 sinv=0 dmax=255",
    "min=-8000 max=10800 vmax=2950 amax=11800 kp=1200 ki=2000 kd=16 brk=200 ferr=600 "
    "stall=300 hdir=1 hv=900 hpos=0 hord=2 hmode=0 inv=0 minv=0 sinv=0 dmax=255",
    "min=-25600 max=4000 vmax=2950 amax=11800 kp=1200 ki=2000 kd=16 brk=200 ferr=600 "
    "stall=300 hdir=1 hv=900 hpos=0 hord=3 hmode=0 inv=0 minv=0 sinv=0 dmax=255",
    "min=-3900 max=3400 vmax=2300 amax=9200 kp=2500 ki=4000 kd=26 brk=200 ferr=400 "
    "stall=300 hdir=1 hv=800 hpos=0 hord=4 hmode=0 inv=0 minv=0 sinv=0 dmax=255",
    "min=-5100 max=5100 vmax=2900 amax=11800 kp=2500 ki=4000 kd=26 brk=200 ferr=400 "
    "stall=300 hdir=1 hv=800 hpos=0 hord=5 hmode=0 inv=0 minv=0 sinv=0 dmax=255",
    "min=0 max=1700 vmax=1600 amax=8000 kp=1000 ki=1000 kd=13 brk=200 ferr=400 "
    "stall=200 hdir=-1 hv=800 hpos=0 hord=1 hmode=1 inv=0 minv=0 sinv=0 dmax=255",
)
"""what SHOW says of each axis before any CFG, both halves"""


def until_it_is_told_otherwise_a_scorbots_values_hold(line: Line) -> None:
    host = Host(line)
    for axis, row in enumerate(SCORBOT):
        halves = [host.ask(f"SHOW {axis} {part}") for part in (1, 2)]
        assert " ".join(half.removeprefix("ok ") for half in halves) == row


def settings_are_taken_whole_or_not_at_all(line: Line) -> None:
    host = Host(line)
    parts = (
        "min=-1234 max=4321 vmax=1000 amax=5000 kp=522 ki=13",
        "kd=7 brk=89 ferr=700 stall=500 hdir=-1 hv=300",
        "hpos=5 hord=3 hmode=1 inv=1 minv=1 sinv=1 dmax=200",
    )
    wanted = dict(pair.split("=") for part in parts for pair in part.split(" "))
    other = settings(host, 1)
    for part in parts:
        assert host.ask(f"CFG 2 {part}") == "ok"
    assert settings(host, 2) == wanted
    assert settings(host, 1) == other
    assert code(host.ask("CFG 2 kp=1 vmax=0")) == "RANGE"
    assert code(host.ask("CFG 2 kp=1 bogus=1")) == "ARGS"
    assert settings(host, 2) == wanted


def settings_change_only_with_the_motors_off(line: Line) -> None:
    host = Host(line)
    assert host.ask("PAIR 3 4") == "ok"
    assert host.ask("PAIR NONE") == "ok"
    assert host.ask("EN 1") == "ok"
    assert host.mode == "N"
    assert code(host.ask("CFG 0 kp=1")) == "MOVING"
    assert code(host.ask("PAIR 3 4")) == "MOVING"
    assert host.ask("EN 0") == "ok"
    assert host.mode == "O"
    assert host.ask("CFG 0 kp=1") == "ok"


def setpoints_are_refused_unless_homed(line: Line) -> None:
    host = Host(line)
    assert code(host.ask("P - - - - - -")) == "OFF"
    assert host.ask("EN 1") == "ok"
    before = host.status()[7:]
    assert host.ask("P - - - - - -") == "ok"
    for axis in range(6):
        setpoints = ["-"] * 6
        setpoints[axis] = "10"
        assert host.ask(f"P {' '.join(setpoints)}").startswith(f"err NOTHOMED {axis}")
        assert host.ask(f"P {' '.join(setpoints)} 30").startswith(f"err NOTHOMED {axis}")
    assert host.status()[7:] == before


def hold_until_it_is_released(line: Line) -> None:
    host = Host(line)
    host.send(b"!")
    assert host.mode == "O"
    assert host.ask("EN 1") == "ok"
    host.send(b"!")
    assert "! held" in host.events
    assert host.mode == "B"
    assert code(host.ask("P - - - - - -")) == "HOLD"
    assert host.ask("EN 1") == "ok"
    assert host.mode == "B"
    host.send(b"~")
    assert host.mode == "N"
    assert host.ask("P - - - - - -") == "ok"
    host.send(b"!")
    assert host.ask("EN 0") == "ok"
    assert host.mode == "O"
    assert host.ask("EN 1") == "ok"
    assert host.mode == "N", "switching off ends the hold"


def what_follows_a_stop_counts(line: Line) -> None:
    """An ``ok`` says that the motors are on, however soon after 0x18 the line came."""
    host = Host(line)
    for number in range(1, 41):
        host.send(b"", 0.0007 * (number % 5))  # at any moment of the board's control period
        assert host.ask("EN 1") == "ok"
        answers = host.send(b"\x18" + sealed(f"{number} EN 1"))
        assert "! stopped" in host.events
        assert (answers, host.mode) == ([f"{number} ok"], "N"), number
        answers = host.send(b"\x18" + sealed(f"{number} P - - - - - -"))
        assert answers == [f"{number} err OFF"], number
        assert host.ask("EN 1") == "ok"
        assert host.send(b"!" + sealed(f"{number} P - - - - - -")) == [f"{number} err HOLD"]
        assert host.send(b"~" + sealed(f"{number} P - - - - -  -")) == [f"{number} ok"]


def motors_off_at_once(line: Line) -> None:
    host = Host(line)
    assert host.ask("EN 1") == "ok"
    host.send(b"\x18")
    assert "! stopped" in host.events
    _, mode, _, _, flags, *_ = host.status()
    assert (mode, flags) == ("O", "08")
    assert host.ask("CLR") == "ok"
    assert host.status()[4] == "00"
    host.send(b"\x18")
    assert host.ask("EN 1") == "ok"
    assert host.status()[4] == "00"


def silence_switches_the_motors_off(line: Line) -> None:
    host = Host(line)
    for milliseconds in (500, 100, 50):
        assert host.ask(f"WD {milliseconds}") == "ok"
        answers = host.send(sealed(f"{milliseconds} EN 1"), milliseconds / 1000 + 0.03)
        assert answers == [f"{milliseconds} ok"]
        assert "! watchdog" in host.events
        _, mode, _, _, flags, *_ = host.status()
        assert (mode, flags) == ("O", "01"), milliseconds
        assert host.ask("CLR") == "ok"
        assert host.status()[4] == "00"


def only_good_lines_break_the_silence(line: Line) -> None:
    host = Host(line)
    assert host.ask("WD 200") == "ok"
    assert host.ask("EN 1") == "ok"
    for _ in range(10):
        assert host.ask("PING") == "ok"
        assert all(one.split(" ")[2] == "N" for one in host.unasked), host.unasked
    for noise in (b"?", b"~", b"1 PING*0000\n", b"X" * 120 + b"\n"):
        assert host.ask("EN 1") == "ok"
        for _ in range(5):
            host.send(noise)
        assert host.mode == "O", noise


def homing_keeps_everything_else_out(line: Line) -> None:
    host = Host(line)
    assert host.ask("CFG 0 min=-100 max=100 hpos=0 hord=1 hmode=0 hv=1 brk=0 kp=0 stall=5000") == "ok"
    assert host.ask("HOME 0") == "ok"
    assert host.mode == "H"
    for text in ("EN 1", "HOME 0", "P - - - - - -"):
        assert code(host.ask(text)) == "BUSY", text
    assert code(host.ask("CFG 0 kp=1")) == "MOVING"
    host.send(b"!")
    assert host.mode == "B"
    assert code(host.ask("HOME 0")) == "HOLD"
    host.send(b"~")
    assert host.ask("HOME 0") == "ok"
    assert host.mode == "H"
    assert host.ask("EN 0") == "ok"
    _, mode, homed, *_ = host.status()
    assert (mode, homed) == ("O", "00")


def homing_needs_a_place_to_end_at(line: Line) -> None:
    host = Host(line)
    assert host.ask("CFG 0 min=-100 max=100 hpos=200 hord=1") == "ok"
    assert code(host.ask("HOME 0")) == "RANGE"
    assert host.mode == "O"


def noise_moves_nothing(line: Line) -> None:
    host = Host(line)
    generator = random.Random(5)
    before = host.status()
    for _ in range(20):
        host.line.exchange(generator.randbytes(200), 0.05)
    host.line.exchange(b"\n", 0.2)
    host.rest = b""
    after = host.status()
    assert (after[1], after[2], after[5]) == (before[1], before[2], before[5])
    assert after[6:] == before[6:]
    assert host.ask("PING") == "ok"


OFF_ANSWERS = {
    "HELLO 1": "err ARGS too many",
    "PING x": "err ARGS too many",
    "  PING ": "ok",
    "PINGS": "err UNKNOWN command",
    "EN": "err ARGS 0 or 1 missing",
    "EN x": "err ARGS 0 or 1 missing",
    "EN +1": "err ARGS 0 or 1 missing",
    "EN 1_0": "err ARGS 0 or 1 missing",
    "EN 1 1": "err ARGS too many",
    "EN 2": "err RANGE 0 1",
    "EN 00000000": "ok",
    "WD": "err ARGS ms missing",
    "WD 1234567890": "err ARGS ms missing",
    "WD 49": "err RANGE ms 50 500",
    "WD 100 1": "err ARGS too many",
    "CFG": "err ARGS axis missing",
    "CFG x": "err ARGS axis missing",
    "CFG 6": "err RANGE axis 0 5",
    "CFG 0": "err ARGS key=value missing",
    "CFG 0 kp": "err ARGS unknown key",
    "CFG 0 =1": "err ARGS unknown key",
    "CFG 0 KP=1": "err ARGS unknown key",
    "CFG 0 kp=": "err ARGS not a number",
    "CFG 0 kp=--1": "err ARGS not a number",
    "CFG 0 kp=1 kp=40000 ki=x": "err RANGE kp 40000 0 32767",
    "CFG 0 vmax=16000": "err RANGE vmax 16000 1 6000",
    "CFG 0 hdir=0": "err RANGE hdir 0 -1 1",
    "CFG 0 min=5 max=5": "err RANGE min not below max",
    "CFG  0  kp=007": "ok",
    "SHOW": "err ARGS axis missing",
    "SHOW 0 3": "err RANGE part 1 2",
    "SHOW 0 x": "err RANGE part 1 2",
    "SHOW 0 1 1": "err ARGS too many",
    "PAIR": "err ARGS axis missing",
    "PAIR 1": "err ARGS axis missing",
    "PAIR 1 6": "err RANGE axis 0 5",
    "PAIR 1 1": "err RANGE two axes",
    "PAIR NONE 1": "err ARGS too many",
    "PAIR 3 4": "ok",
    "HOME 0 x": "err ARGS axis missing",
    "HOME 0 6": "err RANGE axis 0 5",
    "P": "err ARGS six counts or -",
    "P 1 2 3 4 5": "err ARGS six counts or -",
    "P 1 2 3 4 5 x": "err ARGS not a number",
    "P 1 2 3 4 5 6 x": "err ARGS not a number",
    "P 1 2 3 4 5 6 0": "err RANGE ms 1 1000",
    "P 1 2 3 4 5 6 20 1": "err ARGS too many",
    "P 1 2 3 4 5 6": "err OFF",
    "GET 1": "err ARGS too many",
    "CLR 1": "err ARGS too many",
    "": "err UNKNOWN no command",
}
"""to the letter, motors off"""


def answers_to_the_letter(line: Line) -> None:
    host = Host(line)
    for text, answer in OFF_ANSWERS.items():
        assert host.ask(text) == answer, text
    for sent, answer in (
        ("000000007 PING", "7 ok"),
        ("  8   PING", "8 ok"),
        ("0000000009 PING", "0 err SYNTAX seq 1 65535"),
    ):
        assert host.send(sealed(sent)) == [answer]
    assert host.send(b"x" * 97 + b"\n") == ["0 err LONG more than 96 bytes"]
    assert host.send(b"1 PING\n") == ["0 err CRC line ignored"]
    assert host.send(b"\xfe" + sealed("1 PING")) == ["0 err CRC line ignored"]
    assert host.ask("EN 1") == "ok"
    assert host.ask("CFG 0 kp=1") == host.ask("PAIR NONE") == "err MOVING motors are on"
    assert host.ask("P - - - - 7 8 9") == "err NOTHOMED 4"
    host.send(b"!")
    assert host.ask("P - - - - - -") == host.ask("HOME") == "err HOLD"
    host.send(b"~")
    assert host.ask("CFG 0 bogus") == "err MOVING motors are on"
    assert host.ask("EN 0") == "ok"
    assert host.ask("CFG 2 hpos=5000") == "ok"
    assert host.ask("HOME 5 2") == "err RANGE hpos outside min max, axis 2"
    assert host.ask("CFG 5 hv=1 stall=5000 kp=0 brk=0") == "ok"
    assert host.ask("HOME 5") == "ok"
    assert host.ask("HOME") == host.ask("EN 1") == host.ask("P 0 0 0 0 0 0") == "err BUSY homing"


def spare_pins_are_named_and_switched(line: Line) -> None:
    host = Host(line)
    for text, answer in (
        ("PIN", "err ARGS pin missing"),
        ("PIN 41 in", "err RANGE pin 42 49"),
        ("PIN 50 in", "err RANGE pin 42 49"),
        ("PIN 42", "err ARGS off in up out"),
        ("PIN 42 inn", "err ARGS off in up out"),
        ("PIN 42 in low", "err ARGS keep low high, of an output"),
        ("PIN 42 out lo", "err ARGS keep low high, of an output"),
        ("PIN 42 out low 2", "err RANGE 0 1"),
        ("PIN 42 out low 1 1", "err ARGS too many"),
        ("PIN 42 in 1", "err ARGS keep low high, of an output"),
        ("SET 42 1", "err NOTOUT"),
        ("PIN 42 up", "ok"),
        ("SET 42 1", "err NOTOUT"),
        ("PIN 45 out", "ok"),
        ("SET 45", "err ARGS 0 or 1 missing"),
        ("SET 45 2", "err RANGE 0 1"),
        ("SET 45 1 1", "err ARGS too many"),
        ("SET 45 1", "ok"),
        ("PIN 49 out", "ok"),
        ("SET 49 1", "ok"),
        ("SET 49 0", "ok"),
    ):
        assert host.ask(text) == answer, text
    assert host.status()[7] == "10010002"
    assert host.ask("PIN 45 out high") == "ok"  # it is one already, and stays on
    assert host.status()[7] == "10010002"
    assert host.ask("EN 1") == host.ask("PIN 45 off") == "ok"  # also with the motors on
    assert host.status()[7] == "10000002"
    assert host.ask("PIN 46 out keep 1") == host.ask("PIN 49 out keep 1") == "ok"  # the second is one already
    assert host.status()[7] == "10001002"


def what_outputs_do_when_the_host_is_lost(line: Line) -> None:
    host = Host(line)
    for pin, word in ((45, "low"), (46, "keep"), (47, "high")):
        assert host.ask(f"PIN {pin} out {word}") == host.ask(f"SET {pin} 1") == "ok"
    assert host.ask("SET 47 0") == "ok"
    host.send(b"", 0.35)
    assert host.status()[7] == "00011200"
    host.send(b"", 0.25)
    assert host.status()[7] == "00021300"
    assert host.ask("SET 45 1") == "ok"
    assert host.status()[7] == "00031300"  # what is set later stays
    host.send(b"", 0.6)
    assert host.status()[7] == "00041300"


CONFORMANCE = checks(globals())
