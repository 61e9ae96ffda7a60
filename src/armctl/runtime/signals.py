"""Inputs, debounced, with their edges counted; and outputs: who switches them, and what they do at STOP."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

from armctl.errors import ArmctlError, InputError, StateError
from armctl.facts.commands import NoBoard, NotDigital, ShareOutside, UnknownName
from armctl.hardware.input_script import InputScript, read_script
from armctl.kinematics.target import checked_number
from armctl.robot import Robot
from armctl.robot.signals import ON, Input, Moment
from armctl.runtime.board import Board, Reading
from armctl.runtime.notices import EventLog

_ROUNDING_S = 1e-6


class InputSimulator(Protocol):
    """What is connected to the inputs of a simulated board."""

    def simulate(self, channel: int, level: float) -> None:
        """Put an input at a level 0 ... 1."""
        ...

    def play(self, script: InputScript | None) -> None:
        """Have the inputs follow a script from now on; None: they stay as they are."""
        ...


class SignalWatch:
    """What the inputs of a board are at, and what its outputs do when something ends."""

    def __init__(self, robot: Robot, log: EventLog) -> None:
        self._robot, self._log = robot, log
        self._simulator: InputSimulator | None = None
        self.scripted: tuple[str, ...] = ()
        """names of the inputs that follow a script"""
        self.reset()

    def reset(self) -> None:
        """Another board, or none: nothing is known."""
        self.inputs: Mapping[str, float] = {}
        """by name, debounced"""
        self.outputs: Mapping[str, float] = {}
        """by name, as at the last reading"""
        self.edges: Mapping[str, int] = {}
        """by name of a digital input, how often it has changed since the board was connected"""
        self._changing: dict[str, tuple[float, float]] = {}
        """inputs that read something new: what, and since when"""

    def take(self, reading: Reading, now: float) -> None:
        """Take a reading in: a change counts once it has lasted for the input's debounce time."""
        inputs, edges = dict(self.inputs), dict(self.edges)
        for name, value in reading.inputs.items():
            known = self._robot.signals.input(name) or Input(name, name, -1)
            if known.kind == "analog":
                inputs[name] = value
                continue
            edges.setdefault(name, 0)
            if name in inputs and not known.debounce_s:  # pulses between two readings: pairs of changes
                edges[name] += reading.changes.get(name, 0) // 2 * 2
            if inputs.setdefault(name, value) == value:
                self._changing.pop(name, None)
                continue
            candidate, since = self._changing.setdefault(name, (value, now))
            if candidate != value:
                self._changing[name], since = (value, now), now
            if now - since >= known.debounce_s - _ROUNDING_S:
                del self._changing[name]
                inputs[name] = value
                edges[name] += 1
        self.inputs, self.edges, self.outputs = inputs, edges, reading.outputs

    # Of a simulated board.

    def let_simulate(self, simulator: InputSimulator | None) -> None:
        """Who sets them where the board is simulated; None: nobody."""
        self._simulator = simulator

    def simulate(self, board: Board | None, name: str, value: float, who: str) -> None:
        """Put an input of the simulated board at a value, as if somebody pressed it."""
        signal, simulator = self._robot.signals.input(name), self._simulated(board, f"input {name}")
        if signal is None:
            every = tuple(one.name for one in self._robot.signals.inputs)
            raise InputError(UnknownName("input", name, every))
        if not 0 <= checked_number(value, f"input {name}") <= 1:
            raise InputError(ShareOutside("input", value, 0, 1, name))
        simulator.simulate(signal.channel, signal.value(value))
        self._log.add(f"simulated input {name}: {value:g} ({who})")

    def play(self, board: Board | None, text: str, who: str) -> None:
        """Have the inputs of the simulated board follow a script; an empty one: they stay as they are."""
        simulator = self._simulated(board, "a script of inputs")
        script = read_script(text, self._robot.signals) if text.strip() else None
        simulator.play(script)
        self.scripted = () if script is None else script.names
        what = f"a script sets {', '.join(self.scripted)}" if self.scripted else "no script sets them"
        self._log.add(f"simulated inputs: {what} ({who})")

    def _simulated(self, board: Board | None, what: str) -> InputSimulator:
        if self._simulator is None or board is None or not board.identity.simulated:
            raise StateError(f"{what}: only those of a connected simulated board are set by hand")
        return self._simulator

    # Outputs.

    def set(self, board: Board | None, name: str, value: float) -> None:
        """Switch an output; ``InputError``: there is none of that name, or it has no such value."""
        if board is None:
            raise StateError(NoBoard())
        known = self.outputs
        if not known:
            raise StateError("this board has no outputs beside those of the joints")
        if name not in known:
            raise InputError(UnknownName("output", name, tuple(known)))
        if not 0 <= checked_number(value, f"output {name}") <= 1:
            raise InputError(ShareOutside("output", value, 0, 1, name))
        own = self._robot.signals.output(name)
        if own is not None and own.kind == "digital" and value not in (0, 1):
            raise InputError(NotDigital(name, value))
        self._put(board, name, value)

    def switch(self, board: Board | None, moment: Moment) -> None:
        """Let the outputs do what the robot file says for a moment.

        One that fails keeps no other from its own; then the first ``BoardError`` is raised.
        """
        failures: list[ArmctlError] = []
        for one in self._robot.signals.outputs if board is not None else ():
            value = one.goes(moment)
            if value is None or board is None:
                continue
            try:
                self._put(board, one.name, value)
            except ArmctlError as failure:
                failures.append(failure)
                continue
            self._log.add(f"output {one.title} {'on' if value > ON else 'off'} at {_MOMENTS[moment]}")
        if failures:
            raise failures[0]

    def _put(self, board: Board, name: str, value: float) -> None:
        board.set_output(name, value)
        self.outputs = {**self.outputs, name: value}  # what the next reading should say, too

    def switch_if_possible(self, board: Board | None, moment: Moment) -> None:
        """The same on a board that may be gone; a failure is told in the log."""
        try:
            self.switch(board, moment)
        except ArmctlError as failure:
            self._log.warn(f"outputs could not be switched at {_MOMENTS[moment]}: {failure}")


_MOMENTS: Mapping[Moment, str] = {
    "stop": "STOP", "release": "Release", "fault": "the fault", "end": "the end of the program",
}  # fmt: skip
