"""The next pose of a page: the one configuration that its ghost shows and its *Go* sends.

Whoever can say where the arm should be writes it with a ``PoseWriter``: sliders, typed angles, a way.
Fields that hold nothing of their own show it while there is one, and else where the arm stands (``shown``).

=====  ===========================================================================================
empty  no ghost; *Go* says why it cannot be pressed
set    the ghost stands there; the motion is planned from where the arm stands; *Go* sends this
going  it was sent; the ghost stays until the arm has come to it
=====  ===========================================================================================

It ends when the arm has come to it, by ×, by who wrote it, and with the arm. STOP, a refusal and a fault
leave it: what was asked for is not lost. Where the arm is moved otherwise it is planned anew.
"""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Coroutine
from html import escape
from typing import Annotated, Any, Literal, Protocol, Self

import msgspec
import numpy as np
import viser

from armctl.arrays import FloatArray
from armctl.errors import ArmctlError, InputError
from armctl.facts import Need
from armctl.motion import Profile, Trajectory
from armctl.motion.one_sided import ONE_SIDED, commanded_end
from armctl.protocol import Command, MoveJoints, Snapshot
from armctl.robot import Robot
from armctl.ui import next_line
from armctl.ui.console import Console, present_pose
from armctl.ui.events import Newest, OneAtATime
from armctl.ui.guard.parts import Parts
from armctl.ui.next_line import FORGET, NOTHING, WATCHED, Told
from armctl.ui.next_plan import Movement, Planned, ToPlan, usual
from armctl.ui.offers import refused_by
from armctl.ui.scene.ghost import SAME_RAD, Ghost, Lines, segments
from armctl.ui.widgets.html import fixed, sentence

_COLOR, _THEIRS = (0, 180, 216), (134, 142, 150)
_LINE = "next"
_NONE = "there is no next pose yet"
_INSTEAD = "another motion is looked at; Run starts that one"
_RUNS = "a program runs; stop first"
_CHANGED = "the next pose has just changed; look at it, then press again"

End = Literal["arrived", "replaced", "forgotten"]


class WritingPage(Protocol):
    """What a next pose asks of its page (``ui.session``)."""

    client: viser.ClientHandle
    parts: Parts
    closed: bool

    @property
    def console(self) -> Console: ...  # noqa: D102
    @property
    def next(self) -> NextPose: ...  # noqa: D102
    @property
    def snapshot(self) -> Snapshot: ...  # noqa: D102
    @property
    def held(self) -> Robot: ...  # noqa: D102
    @property
    def me(self) -> str: ...  # noqa: D102
    @property
    def operates(self) -> bool: ...  # noqa: D102
    def why_not(self, arm: Need | None, snapshot: Snapshot) -> str | None: ...  # noqa: D102
    def on_part(self, do: str, action: Callable[[str], Awaitable[object] | None]) -> None: ...  # noqa: D102
    def on_part_value(self, do: str, action: Callable[[str, str], Awaitable[object] | None]) -> None: ...  # noqa: D102
    def on_press(self, do: str, label: str, action: Callable[[str], Awaitable[object] | None]) -> None: ...  # noqa: D102
    def spawn(self, work: Coroutine[Any, Any, None]) -> None: ...  # noqa: D102
    async def submit(self, command: Command) -> object: ...  # noqa: D102


class PoseWriter:
    """Somebody who can say where the arm should be: a screen, in its own words."""

    def __init__(
        self,
        session: WritingPage,
        words: str,
        movement: Callable[[], Movement] = usual,
        ended: Callable[[End], None] | None = None,
        settled: Callable[[], None] = lambda: None,
        kept_words: str = "",
    ) -> None:
        """``words``: who it is. ``movement``: how the arm goes. ``ended``: what it asked for counts no more.

        ``ended`` is called with "replaced" whenever somebody else writes, else where its pose was the next.
        ``settled`` refuses (``ArmctlError``) while fields are being typed into. ``kept_words``: who it was,
        on a page that is loaded anew; empty: ``words``, which go on being true.
        """
        self._next, self._newest, self._begun = session.next, Newest(), 0
        self.words, self.movement = words, movement
        self.ended: Callable[[End], None] = ended or (lambda _: None)
        self.settled, self.kept_words = settled, kept_words
        if ended is not None:
            self._next.told.append(self)

    @property
    def shown(self) -> bool:
        """Whether the next pose is this one's."""
        return self._next.writer is self

    @property
    def taken(self) -> bool:
        """Whether it is somebody else's."""
        return self._next.q is not None and not self.shown

    def show(self, q: FloatArray) -> None:
        """Make ``q`` (n,) [rad] the next pose."""
        self._next.set(q, self)
        self.begin()

    def begin(self) -> Callable[[], bool]:
        """Something is to be worked out; gives whether it is the newest still that was asked or written."""
        self._begun, is_newest = self._next.writes, self._newest.begin()
        self._next.note(self, None)
        return lambda: is_newest() and not self.overtaken

    @property
    def overtaken(self) -> bool:
        """Whether somebody else has written the next pose, or forgotten it, since this one began."""
        return self._next.writes != self._begun

    def hide(self, why: Told | None = None) -> None:
        """There is no next pose, if it was this one's; where there is none, the line says ``why``."""
        if self.shown:
            self._next.clear(None)
            self.begin()
        self._next.note(self, why)

    async def go(self, q: FloatArray) -> None:
        """Make ``q`` (n,) [rad] the next pose, and send it."""
        movement = self.movement()
        self.show(q)
        await self._next.send(q, movement)


class NextPoses:
    """What all pages share of their next poses: what each shows."""

    def __init__(self) -> None:
        self.by_party: dict[str, FloatArray] = {}
        """(n,) of each page that has one [rad]"""

    @classmethod
    def of(cls, console: Console, before: Self | None) -> Self:
        """Those of an arm; nobody has one yet."""
        del console, before
        return cls()


class _Kept(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What a page keeps of its next pose while it is loaded anew."""

    arm: str
    q: tuple[float, ...]
    """[rad]"""
    words: Annotated[str, msgspec.Meta(max_length=40)]
    profile: Profile
    duration_s: Annotated[float, msgspec.Meta(gt=0)] | None


class NextPose:
    """Where this page would send the arm; event loop only."""

    def __init__(self, session: WritingPage) -> None:
        self._session = session
        scene, robot = session.client.scene, session.console.robot
        self.ghost = Ghost(scene, robot, lambda: session.snapshot, "/ghost", _COLOR)
        self._path = Lines(scene, "/next_path", _COLOR, 2.5)
        self._theirs = Ghost(scene, robot, lambda: session.snapshot, "/theirs", _THEIRS)
        self._poses = session.console.shared(NextPoses)
        self.q: FloatArray | None = None
        """(n,) [rad]; None: there is none"""
        self.told: list[PoseWriter] = []
        """who wants to hear that somebody else writes"""
        self.writer: PoseWriter | None = None
        self.number = self.writes = 0
        """count what was written and planned, which *Go* names; how often somebody wrote it or forgot it"""
        self.running: Callable[[Snapshot], Told | None] = lambda _: None
        """the step of a program that runs: the line tells that meanwhile, and no ghost stands in its way"""
        self.instead: Callable[[Snapshot], Told | None] = lambda _: None
        """a motion that a tab shows and starts by itself: likewise, until it is looked at no more"""
        self.graph: bool | None = None
        """whether the graph below the line is open; None: there is none"""
        self._note: tuple[PoseWriter, Told] | None = None
        """why there is no next pose, and who says so"""
        self._going = self._waits = False
        self._asked: ToPlan | None = None
        self._planned: Planned | None = None
        """None: it is not known yet"""
        self._planning = OneAtATime(self._plan)
        session.on_press("go", "Go", self._on_go)
        session.on_part("forget", lambda _: self.clear())
        session.on_part_value("recall", self._on_recall)

    @property
    def _movement(self) -> Movement:
        """How the arm goes to it, as it was planned last."""
        return usual() if self._asked is None else self._asked.movement

    @property
    def trajectory(self) -> Trajectory | None:
        """The motion to it; None: it is not planned yet, or refused."""
        return None if self._planned is None else self._planned.trajectory

    def shown(self, present: FloatArray) -> FloatArray:
        """(n,) what fields show that nobody edits [rad]: the next pose, or where the arm stands."""
        return present if self.q is None else self.q

    def shown_in(self, snapshot: Snapshot) -> FloatArray:
        """As ``shown``, where the arm stands in a snapshot, or is drawn before its first command."""
        return self.shown(self.standing(snapshot))

    def standing(self, snapshot: Snapshot) -> FloatArray:
        """(n,) where a motion would begin [rad]."""
        return self._session.console.last_known.standing(snapshot)

    def set(self, q: FloatArray, writer: PoseWriter) -> None:
        """Make ``q`` (n,) [rad] the next pose; where the arm stands there, there is none."""
        if self._session.closed:  # what was asked for has outlived its page
            return
        self.writes += 1
        snapshot, before = self._session.snapshot, self.writer
        if self._is_there(q, snapshot):
            self.clear(None if before is writer else "replaced")
            return
        if self.q is None or not np.array_equal(q, self.q):
            self.q, self._going = q.copy(), False
            self._forget_plan()
            self._poses.by_party[self._session.me] = self.q
        self.writer, self._note = writer, None
        self._show_in_view()
        for other in self.told if before is not writer else ():
            if other is not writer:
                other.ended("replaced")
        self.refresh(snapshot)

    def clear(self, why: End | None = "forgotten") -> None:
        """There is no next pose any more; who wrote it is told why, or knows (None)."""
        if self.q is None:
            if why == "forgotten":
                self._note = None
            return
        writer, self.writer = self.writer, None
        self.q, self._going = None, False
        self.writes += why != "arrived"
        self._forget_plan()
        self._poses.by_party.pop(self._session.me, None)
        self.ghost.hide()
        if writer is not None and why is not None:
            writer.ended(why)
        self.refresh(self._session.snapshot)

    def note(self, writer: PoseWriter, why: Told | None) -> None:
        """Say ``why`` there is no next pose; None: this writer says no more about it."""
        before, self._note = self._note, None if why is None else (writer, why)
        if why is None and before is not None and before[0] is not writer:
            self._note = before
        if self._note != before:
            self.draw()

    @property
    def in_view(self) -> FloatArray | None:
        """(n,) where its ghost stands [rad]; None: nowhere, also while it waits."""
        return None if self._waits else self.q

    def _show_in_view(self) -> None:
        """A ghost over the arm that runs a program, or over another motion, would hide it."""
        if (q := self.in_view) is None:
            self.ghost.hide()
        else:
            self.ghost.show(q)
        self._path.set_visible(q is not None and self.trajectory is not None)

    def refresh(self, snapshot: Snapshot) -> None:
        """Plan anew where the arm stands elsewhere, end where it has come to the pose, and say so."""
        waits = snapshot.program is not None or self.instead(snapshot) is not None
        if self._waits != waits:
            self._waits = waits
            self._show_in_view()
        if self.q is not None and self.writer is not None:
            self._going = self._going and snapshot.busy
            if snapshot.commanded and self._is_there(self.q, snapshot):  # not one that is led there by hand
                self.clear("arrived")
                return
            if not snapshot.busy:
                self._ask(self.q, self.writer, snapshot)
        self._show_theirs(snapshot)
        self.draw()

    def draw(self) -> None:
        """Show the line."""
        self._session.parts.show(_LINE, self._html(self._session.snapshot))

    def close(self) -> None:
        """The page is gone."""
        self._poses.by_party.pop(self._session.me, None)

    def _show_theirs(self, snapshot: Snapshot) -> None:
        """Who watches sees where the operator would send the arm."""
        operator = snapshot.control.operator
        q = None if operator is None or self._session.operates else self._poses.by_party.get(operator.id)
        if q is None or operator is None:
            self._theirs.hide()
        elif self._theirs.q is None or not np.array_equal(q, self._theirs.q):
            self._theirs.show(q, label=f"{operator.name.removeprefix('browser ')}: next")

    def _is_there(self, q: FloatArray, snapshot: Snapshot) -> bool:
        """Also where it came to it from one side, half of the play ahead."""
        if snapshot.busy:
            return False
        (profile, _), standing = self._movement, self.standing(snapshot)
        ends = [q] if profile not in ONE_SIDED else [q, commanded_end(self._robot, q, profile)]
        return any(float(np.abs(end - standing).max()) < SAME_RAD for end in ends)

    def _ask(self, q: FloatArray, writer: PoseWriter, snapshot: Snapshot) -> None:
        """Have the motion planned, unless it is."""
        try:
            movement = writer.movement()
        except ArmctlError as refusal:
            if self._asked is not None or self._planned is None:
                self._forget_plan()
            self._planned = Planned(refused=str(refusal))
            return
        asked = ToPlan(self._session.held, self.standing(snapshot).copy(), q, movement)
        if not asked.is_as(self._asked):
            self._forget_plan()
            self._asked = asked
            self._session.spawn(self._planning.run())

    def _forget_plan(self) -> None:
        """The motion is another one, or none: what was said of it counts no more, nor does a press."""
        self.number += 1
        self._asked = self._planned = None
        self._path.set_visible(False)

    async def _plan(self) -> None:
        asked = self._asked
        if asked is None:
            return
        planned = await asyncio.to_thread(asked.plan)
        if self._session.closed or asked is not self._asked:
            return
        self._planned = planned
        if planned.tool_m is not None:
            self._path.show(segments(planned.tool_m))
            self._path.set_visible(not self._waits)
        self.draw()

    # Go.

    async def _on_go(self, key: str) -> None:
        q, writer = self.q, self.writer
        if q is None or writer is None:
            raise InputError(_NONE)
        if self.instead(self._session.snapshot) is not None:  # it is not in view
            raise InputError(_INSTEAD)
        writer.settled()
        self.refresh(self._session.snapshot)  # fields of the movement may have changed since it was drawn
        self.require_seen(key)
        if self._asked is None:  # then the movement is refused
            raise InputError(_CHANGED if self._planned is None else self._planned.refused)
        if self._planned is not None and self._planned.refused:
            raise InputError(self._planned.refused)
        await self.send(q, self._asked.movement)

    async def send(self, q: FloatArray, movement: Movement) -> None:
        """Send the arm to ``q`` (n,) [rad]; raises what refuses it."""
        profile, duration = movement
        await self._session.submit(MoveJoints(q, duration, profile))
        self._going = self.q is not None and np.array_equal(q, self.q)

    # A page that is loaded anew says what it had (``overlay.js``). It can do no more by it than by typing.

    def _kept(self, q: FloatArray, writer: PoseWriter) -> str:
        profile, duration = self._movement
        words = writer.kept_words or writer.words
        kept = _Kept(self._robot.name, tuple(q.tolist()), words, profile, duration)
        return f"<i hidden data-keep=recall data-kept='{escape(msgspec.json.encode(kept).decode())}'></i>"

    def _on_recall(self, _: str, value: str) -> None:
        """Of another arm it means nothing; what is newer stays."""
        try:
            kept = msgspec.json.decode(value, type=_Kept)
        except msgspec.DecodeError as cause:
            raise InputError(f"the next pose that the page kept cannot be read: {cause}") from cause
        if self.q is None and kept.arm == self._robot.name:
            q = self._robot.check_limits(np.array(kept.q))
            PoseWriter(self._session, kept.words, lambda: (kept.profile, kept.duration_s)).show(q)

    # The line.

    def _html(self, snapshot: Snapshot) -> str:
        why, record = self._session.why_not(Need.HOLDING, snapshot), self._record(snapshot)
        record += next_line.graph(self.graph)
        if (runs := self.running(snapshot)) is not None:
            kept = "" if self.q is None or self.writer is None else self._kept(self.q, self.writer)
            return runs.html(kept + record + next_line.go(why or _RUNS), " program")
        if (instead := self.instead(snapshot)) is not None:
            kept = "" if self.q is None or self.writer is None else self._kept(self.q, self.writer)
            return instead.html(kept + record + next_line.go(_INSTEAD), " looked")
        if self.q is None or self.writer is None:
            nothing = NOTHING if self._session.operates else WATCHED
            told = nothing if self._note is None else self._note[1]
            return told.html(record + next_line.go(_NONE))
        x, y, z = (fixed(1000 * value, 1) for value in self._robot.forward(self.q)[:3, 3].tolist())
        place = f"<b>X {x} &ensp;Y {y} &ensp;Z {z} mm</b>" + self._kept(self.q, self.writer)
        planned, motion = self._planned, self.trajectory
        seconds = "" if motion is None else f" · {fixed(motion.duration / snapshot.speed, 2)} s"
        who = f"{escape(self.writer.words)}{seconds} · "
        if self._going:
            come = "" if snapshot.progress is None else f" · {round(100 * snapshot.progress)} %"
            go = next_line.go("the arm is on its way")
            return next_line.line(place, f"{who}on its way{come}", record + go, " on")
        if planned is not None and planned.refused:
            why = sentence(planned.refused)
            told = next_line.refusal(why, "bad")
        elif why is not None:
            told = next_line.refusal(why)
        else:
            told = "planning …" if planned is None else "<em class='good'>clear</em>"
        return next_line.line(place, who + told, FORGET + record + next_line.go(why, str(self.number)), " on")

    def require_seen(self, key: str) -> None:
        """Refuse (``InputError``) what was pressed for another next pose than this one."""
        if key != str(self.number):
            raise InputError(_CHANGED)

    def _record(self, snapshot: Snapshot) -> str:
        what, why = "the next pose", self._session.why_not(None, snapshot)
        if self.q is None:
            what, why = "where the arm is", why or _UNKNOWN(snapshot)
        return next_line.record(what, str(self.number), why)

    @property
    def _robot(self) -> Robot:
        return self._session.console.robot


_UNKNOWN = refused_by(present_pose)
