"""What the host last sent to each pin of a Firmata board, and what the board says to that."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable, Mapping

from armctl.hardware.firmata import LARGEST_PULSE_US, SERVO_FRAME_S, SMALLEST_PULSE_US
from armctl.hardware.firmata.codec import PinMode, PinState
from armctl.lazy_dataclass import dataclass

_CERTAIN = 2
"""answers carry no checksum: one alone does not prove that a pin is on or off, or what its width is"""
_GONE = 3
"""in a row they prove that a pin is not as it was seen before, which gives the arm up"""
_ATTACH_ATTEMPTS = 3
_ATTACHING_S = 1.0
"""so long after it was switched on first a pin may be tried again: it must not come on when nobody waits"""
_STRAYS_WITHIN_S = 10.0
_STALLS_S, _STALLS_TIMES, _FORGETS = 0.05, 2.0, 0.95
"""a silence longer than that, and than so many times what answers take, which fades by so much an answer"""
_LONG_LOSS_S = 0.1
"""what is lost for longer than this shows as a step of the arm"""
_LOST = "bytes were lost or garbled on the line"


@dataclass(slots=True)
class _Question:
    """A pin state that was asked for: when, and what the answer should be."""

    pin: int
    at: float
    on: bool = False
    pulse_us: int | None = None


@dataclass(slots=True)
class _Pin:
    on: bool = False
    pulse_us: int | None = None  # last sent, or found; None: off, or set to degrees by another program
    sent_at: float = -math.inf
    doubtful: bool = False  # the board was seen with another value: what was sent last must be sent again
    held_us: int | None = None  # the value that the board was seen with then
    step_us_per_s: float = math.inf  # how fast it is brought from there to where it should be
    asked: _Question | None = None
    contradictions: int = 0
    agreements: int = 0  # right answers since it was switched on
    seen_on: bool = False  # the board has said for certain that it is on, since it was switched on
    kept_us: int | None = None  # the width that the sketch keeps for it, on or off; None: not known
    attempts: int = 0  # to switch it on
    tried_at: float = -math.inf  # when it was tried first
    other_us: int | None = None  # another value that the last answer told: the next one must tell it, too
    agreed: _Question | None = None  # the last answer that was right
    strayed: int = 0  # how often the board had another value though nothing had been sent
    strayed_at: float = -math.inf


class PinWatch:
    """What was sent to the configured pins, compared with what the board says of them.

    An answer is compared with what had been sent when it was asked. Answers come in the order of the
    questions, so a question that is overtaken by the answer to a later one is lost. ``states``: the pins at
    the beginning. ``steps_us_per_s``: by pin, how fast it may be brought back to where it should be.
    """

    def __init__(
        self, states: Iterable[PinState] = (), steps_us_per_s: Mapping[int, float | None] | None = None
    ) -> None:
        self._pins: dict[int, _Pin] = {}
        steps = steps_us_per_s or {}
        for state in sorted(states, key=lambda state: state.pin):
            on = state.mode == PinMode.SERVO
            # Degrees, or no value yet, are no pulse width.
            pulse_us = _possible(state.value) if on else None
            step = steps.get(state.pin) or math.inf
            self._pins[state.pin] = _Pin(
                on, pulse_us, step_us_per_s=step, seen_on=on, kept_us=pulse_us, attempts=int(on)
            )
        self._turn: list[int] = list(self._pins)
        self._open: deque[_Question] = deque()
        self._waiting_since: float | None = None
        self.asked = self.lost = 0
        """questions that were put, and those that got no answer, since the caller set them to 0"""
        self.delay_s: float | None = None
        """the longest that an answer took, since the caller set it to None"""
        self._usual_s = 0.0
        """how long answers take lately, at most"""

    @property
    def positions(self) -> dict[int, float | None]:
        """The pulse width [µs] last sent to each pin; None where it is off, not known, or not confirmed."""
        return {
            number: float(pin.pulse_us) if pin.on and pin.seen_on and pin.pulse_us is not None else None
            for number, pin in self._pins.items()
        }

    @property
    def powered(self) -> bool:
        """Whether any pin sends pulses, or has been told to."""
        return any(pin.on for pin in self._pins.values())

    @property
    def confirmed(self) -> bool:
        """Whether the board has said of each pin that is on that it is."""
        return all(pin.seen_on for pin in self._pins.values() if pin.on)

    @property
    def on_at_no_width(self) -> bool:
        """Whether a pin is on for certain, at a width that is not known (degrees of another program)."""
        return any(pin.on and pin.seen_on and pin.pulse_us is None for pin in self._pins.values())

    def is_on(self, pin: int) -> bool:
        """Whether a pin sends pulses, or has been told to."""
        return self._pins[pin].on

    def keeps(self, pin: int, pulse_us: int) -> bool:
        """Whether the sketch would attach a pin that is off with this width [µs]."""
        return self._pins[pin].kept_us == pulse_us

    def prepared(self, pulses: Mapping[int, int]) -> None:
        """Note that the sketch keeps these widths [µs] by pin, all of them off."""
        for number, pulse_us in pulses.items():
            self._pins[number].kept_us = pulse_us

    def give_up(self) -> None:
        """Try no pin again that is off."""
        for pin in self._pins.values():
            pin.attempts = _ATTACH_ATTEMPTS
            if not pin.on:
                pin.doubtful = False

    def dropped(self, number: int) -> None:
        """What was to be sent to a pin has waited for too long. It is left where the board has it."""
        pin = self._pins[number]
        if not pin.on:
            pin.doubtful = False  # it is not tried again
        elif pin.held_us is None:
            pin.held_us = pin.pulse_us  # the next setpoint may be far from there

    @property
    def switched_off(self) -> tuple[int, ...]:
        """The pins that the board has off for certain while they should be on."""
        return tuple(
            number
            for number, pin in self._pins.items()
            if pin.on and pin.contradictions >= (_GONE if pin.seen_on else _CERTAIN)
        )

    @property
    def never_on(self) -> tuple[int, ...]:
        """Those of them that the board never had on."""
        return tuple(number for number in self.switched_off if not self._pins[number].seen_on)

    @property
    def strayed(self) -> tuple[int, ...]:
        """The pins that somebody else has set for certain."""
        return tuple(number for number, pin in self._pins.items() if pin.strayed >= _CERTAIN)

    @property
    def open_questions(self) -> int:
        """How many have not been answered yet."""
        return len(self._open)

    def silent_s(self, now: float) -> float:
        """For how long the board has left questions unanswered, all of them."""
        return 0.0 if self._waiting_since is None else now - self._waiting_since

    def stalls(self, now: float) -> bool:
        """Whether the board says nothing for longer than it usually does: it may get nothing, either."""
        return self.silent_s(now) > max(_STALLS_S, _STALLS_TIMES * self._usual_s)

    def oldest_s(self, now: float) -> float:
        """How long ago the oldest question was put that is not answered yet."""
        return now - self._open[0].at if self._open else 0.0

    def due(self, wanted: Mapping[int, int], now: float) -> tuple[dict[int, int], dict[int, int]]:
        """What the board has not got, or must be sent again [µs]: on pins that are on, and off.

        A pin that was seen with another value is brought to the right one no faster than it may move.
        """
        on: dict[int, int] = {}
        off: dict[int, int] = {}
        for number, pin in self._pins.items():
            pulse_us = wanted.get(number, pin.pulse_us if pin.doubtful else None)
            if pulse_us is None or not (pin.doubtful or pulse_us != pin.pulse_us):
                continue
            if pin.on and pin.held_us is not None:
                step = pin.step_us_per_s * min(now - pin.sent_at, SERVO_FRAME_S)
                if abs(pulse_us - pin.held_us) > step:
                    pulse_us = pin.held_us + round(math.copysign(max(step, 1.0), pulse_us - pin.held_us))
            (on if pin.on else off)[number] = pulse_us
        return on, off

    def carry_on(self, earlier: PinWatch) -> tuple[tuple[int, ...], tuple[str, ...]]:
        """Take over what an earlier watch says was sent.

        Returns the pins that were on then and are not now, and what is to be said of those that are on and
        have another value than the one last sent: they are brought there.
        """
        gone: list[int] = []
        words: list[str] = []
        runs_on = any(was.on and was.seen_on for was in earlier._pins.values())
        for number, was in earlier._pins.items():
            pin = self._pins.get(number)
            if pin is not None and not pin.on and runs_on:  # else the board may have started anew
                pin.kept_us = was.kept_us
            if pin is None or not was.on:
                continue
            if not pin.on and was.seen_on:
                gone.append(number)
            elif not pin.on:  # it never was: it is to be switched on again, if that is not too late
                pin.pulse_us, pin.doubtful, pin.attempts = was.pulse_us, True, was.attempts
                pin.tried_at = was.tried_at
            else:
                held_us, pin.pulse_us, pin.sent_at = pin.pulse_us, was.pulse_us, was.sent_at
                pin.doubtful, pin.held_us, pin.strayed = was.doubtful, was.held_us, was.strayed
                if was.pulse_us is not None and held_us != was.pulse_us:
                    pin.doubtful, pin.held_us = True, held_us
                    words.append(_another(number, held_us, was.pulse_us))
        return tuple(gone), tuple(words)

    def sent(self, pulses: Mapping[int, int], now: float, wanted: Mapping[int, int] | None = None) -> None:
        """Note what was sent [µs] by pin; a pin that was off is on now. ``wanted``: where it is to go."""
        for number, pulse_us in pulses.items():
            pin = self._pins[number]
            if not pin.on:
                pin.contradictions, pin.agreements, pin.seen_on, pin.other_us = 0, 0, False, None
                again = pin.doubtful and pin.attempts < _ATTACH_ATTEMPTS
                pin.attempts = pin.attempts + 1 if again else 1
                pin.tried_at = pin.tried_at if again else now
            goal = (pulses if wanted is None else wanted).get(number, pin.pulse_us)
            # On the way there it is sent again and again, each time from where it is by then.
            pin.doubtful = goal is not None and goal != pulse_us
            pin.held_us = pulse_us if pin.doubtful else None
            pin.on, pin.pulse_us, pin.sent_at = True, goal if pin.doubtful else pulse_us, now
            pin.kept_us = pulse_us

    def released(self) -> None:
        """Note that every pin is off."""
        self._pins = {
            number: _Pin(step_us_per_s=pin.step_us_per_s, kept_us=pin.kept_us)
            for number, pin in self._pins.items()
        }
        self._open.clear()
        self._waiting_since = None

    def ask(self, count: int, now: float) -> tuple[int, ...]:
        """The next pins to ask about, at most ``count``, none that has not answered yet."""
        chosen = [number for number in self._turn if self._pins[number].asked is None][:count]
        for number in chosen:
            pin = self._pins[number]
            # On its way to where it should be it may have any value in between.
            pin.asked = _Question(number, now, pin.on, None if pin.doubtful else pin.pulse_us)
            self._note(pin.asked)
        self._turn = [number for number in self._turn if number not in chosen] + chosen
        return tuple(chosen)

    def ask_marker(self, marker: int, now: float) -> int:
        """Ask about a pin that is not configured: its answer shows what else is lost."""
        self._note(_Question(marker, now))
        return marker

    def _note(self, question: _Question) -> None:
        self._open.append(question)
        self.asked += 1
        if self._waiting_since is None:
            self._waiting_since = question.at

    def answered(self, state: PinState, now: float) -> str | None:
        """Take an answer; words where it is not what it should be, None where it is or was not asked."""
        if all(question.pin != state.pin for question in self._open):
            return None
        words: str | None = None
        while (question := self._open.popleft()).pin != state.pin:
            self.lost += 1
            if question.pin in self._pins:
                self._pins[question.pin].asked = None
            if now - question.at > _LONG_LOSS_S and words is None:
                words = (
                    f"the board did not get what was sent {1000 * (now - question.at):.0f} ms ago: setpoints "
                    "may be lost, which shows as a step of the arm; check the USB cable"
                )
        self._waiting_since = now if self._open else None
        took_s = now - question.at
        self.delay_s = max(self.delay_s or 0.0, took_s)
        self._usual_s = max(took_s, _FORGETS * self._usual_s)
        pin = self._pins.get(state.pin)
        if pin is None or pin.asked is not question:
            return words
        pin.asked = None
        return self._compared(state, pin, question, now) or words

    def _compared(self, state: PinState, pin: _Pin, asked: _Question, now: float) -> str | None:
        on = state.mode == PinMode.SERVO
        if on != asked.on:
            pin.contradictions += 1
            self._ask_first(state.pin)
            if not on and not pin.seen_on:
                again = pin.attempts < _ATTACH_ATTEMPTS and now - pin.tried_at < _ATTACHING_S
                if pin.on and pin.contradictions >= _CERTAIN and again:
                    pin.on, pin.doubtful, pin.held_us, pin.contradictions = False, True, None, 0
                return None
            if pin.contradictions < _GONE:
                return None
            return (
                f"pin {state.pin} is {'still on' if on else 'no longer on'} at the board, though armctl "
                f"{'switched it off' if on else 'did not switch it off'}"
            )
        pin.contradictions = 0
        if not on:
            pin.seen_on = False
            return None
        if asked.pulse_us is None:
            return None
        if state.value == asked.pulse_us:
            pin.agreed, pin.other_us = asked, None
            pin.agreements += 1
            pin.seen_on |= pin.agreements >= _CERTAIN
            if not pin.seen_on:
                self._ask_first(state.pin)
            return None
        if pin.other_us != state.value:  # one answer alone moves nothing
            pin.other_us = state.value
            self._ask_first(state.pin)
            return None
        pin.other_us = None
        # Sent again at once, unless the next setpoint overtakes it.
        pin.doubtful = pin.on
        told_us = _possible(state.value)
        pin.held_us = told_us if pin.pulse_us == asked.pulse_us else None
        agreed = pin.agreed
        if state.value > LARGEST_PULSE_US:
            agreed = None  # nobody sets that: the answer is garbled
        if agreed is not None and agreed.pulse_us == asked.pulse_us and agreed.at >= pin.sent_at:
            pin.strayed = 1 + (pin.strayed if asked.at - pin.strayed_at < _STRAYS_WITHIN_S else 0)
            pin.strayed_at, pin.agreed = asked.at, None
            unit = "°" if told_us is None else " µs"
            return (
                f"pin {state.pin} went from {asked.pulse_us} µs to {state.value}{unit}, which armctl did not "
                f"send: another program writes to this board, or {_LOST}; brought back"
            )
        return _another(state.pin, told_us, asked.pulse_us)

    def _ask_first(self, number: int) -> None:
        """Ask about a pin before the others."""
        self._turn.remove(number)
        self._turn.insert(0, number)


def _possible(value: int) -> int | None:
    """A value that the board has told, where it can be a pulse width; None: garbled, or set as degrees."""
    return value if SMALLEST_PULSE_US <= value <= LARGEST_PULSE_US else None


def _another(pin: int, held_us: int | None, pulse_us: int) -> str:
    return (
        f"pin {pin} had {'no pulse width' if held_us is None else held_us} instead of the {pulse_us} µs last "
        f"sent: {_LOST}; sent again. Check the USB cable"
    )
