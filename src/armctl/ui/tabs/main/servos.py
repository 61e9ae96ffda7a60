"""*Main → Servos*: who is on the bus, what differs from what the arm needs, and one change at a time."""

from __future__ import annotations

from collections import Counter
from collections.abc import Awaitable, Callable, Sequence
from html import escape

import viser

from armctl.boards import SIMULATED
from armctl.errors import InputError
from armctl.hardware.bus.lerobot import KeptServo, changed, decode_kept, encode_kept, require_fits
from armctl.hardware.servos import Difference, FoundServo, Mend
from armctl.protocol import Snapshot
from armctl.ui.console import PortChoice
from armctl.ui.events import Action
from armctl.ui.session import Session
from armctl.ui.tabs.main.shared_servos import ScannedBus, SharedServos, servo_key
from armctl.ui.widgets.html import ERROR, GOOD, WARNING, LiveHtml, button, heading, muted, sentence
from armctl.ui.widgets.number_field import in_row

_PART = "servos"
_ALL_RATES = "all"
_HIGHEST_ID = 252
_ABOUT = (
    "Look who is on the bus, before you connect. Nothing moves, and nothing is written unless you press a "
    "button for it."
)
_SIMULATED = (
    "These servos are simulated. What you write into them is there when you connect, until the arm is opened "
    "anew, for another port, robot or calibration, or the console ends."
)
_NEW = (
    "New servos all have the id 1. Plug in <b>one servo alone</b>, choose which joint it becomes, and press "
    "the button. Then unplug it, plug in the next one, and go on."
)
_LEROBOT = (
    "Homing offset and range of each servo, in the file that LeRobot uses. To save also keeps them as right: "
    "what another program changes later is named here, and when you connect."
)
_EEPROM = "It is written into the EEPROM of the servo, locked again and read back. It is kept without power."


class Servos:
    """``port``: the one chosen in *Arm*, where ``connect`` connects; ``disconnect`` asks if it has to."""

    def __init__(
        self, session: Session, port: Callable[[], PortChoice], connect: Action, disconnect: Action
    ) -> None:
        self._session, self._port, gui = session, port, session.gui
        self._shared = session.console.shared(SharedServos)
        self._file: tuple[str, dict[str, KeptServo]] | None = None
        """a calibration of LeRobot that was compared with the servos: its name, and what is in it"""
        shared = self._shared
        self._where = LiveHtml(gui)
        with in_row(gui):
            self._disconnect = gui.add_button(
                "Disconnect the arm", icon=viser.Icon.PLUG_OFF, visible=False, color="gray"
            )
        session.needs(None, self._disconnect, told=False)
        session.parts.add(gui, _PART)
        with in_row(gui):
            self._keep = gui.add_button(
                "They are right as they are", icon=viser.Icon.CHECK, visible=False, color="gray"
            )
            self._connect = gui.add_button("Connect the arm", icon=viser.Icon.PLUG_CONNECTED, color="gray")
        session.needs(None, self._keep, self._connect, also=self._not_now, told=False)
        with gui.add_folder("A new servo", expand_by_default=False):
            LiveHtml(gui, _NEW)
            self._becomes = gui.add_dropdown("It becomes", tuple(map(self._named, shared.ids)))
            with in_row(gui):
                give = gui.add_button("Give it this id", icon=viser.Icon.TAG)
            self._step = LiveHtml(gui)
            session.needs(None, give, also=self._not_now)
        with gui.add_folder("LeRobot's calibration", expand_by_default=False):
            LiveHtml(gui, _LEROBOT)
            with in_row(gui):
                save = gui.add_button("Save as LeRobot's file", icon=viser.Icon.DOWNLOAD, color="gray")
                self._upload = gui.add_upload_button(
                    "Compare with a file", icon=viser.Icon.UPLOAD, mime_type=".json", color="gray"
                )
            self._compared = LiveHtml(gui)
            self._restore = gui.add_button("Write what differs", icon=viser.Icon.DEVICE_FLOPPY, visible=False)
            session.needs(None, save, self._upload, self._restore, also=self._not_now)
        session.on(self._connect.on_click, connect)
        session.on(self._disconnect.on_click, disconnect)
        session.on(self._keep.on_click, self._on_keep)
        session.on(give.on_click, self._on_give)
        session.on(save.on_click, self._on_save)
        session.on(self._upload.on_upload, self._on_upload)
        session.on(self._restore.on_click, self._on_restore)
        session.on_press("servo-look", "Look for the servos", self._on_look)
        session.on_part("servo-cancel", lambda _: shared.cancel())
        session.on_press("servo-nudge", "Nudge", self._on_nudge)
        session.on_press("servo-id", "Change id", self._on_id)
        session.on_press("servo-mend", "Mend", self._on_mend)

    def require_free(self) -> None:
        """Refuse (``StateError``) what would need the port that a job on the bus has."""
        self._shared.require_free()

    def refresh(self, snapshot: Snapshot) -> None:
        """Show the bus, as far as somebody has looked."""
        shared, session = self._shared, self._session
        connected = snapshot.board is not None
        self._disconnect.visible, self._connect.visible = connected, not connected
        self._keep.visible = shared.seen is not None and shared.seen.kept is not None and not connected
        if not session.sees("Main"):
            return
        self._where.show(self._where_html(snapshot))
        busy = shared.why_not(snapshot)
        why = session.why_not(None, snapshot) or busy
        seen = "" if shared.seen is None else servos_html(shared, shared.seen, why)
        session.parts.show(_PART, f"{'' if connected else _look_html(shared, busy)}{seen}")

    def _where_html(self, snapshot: Snapshot) -> str:
        if snapshot.board is not None:
            port = escape(snapshot.board.port)
            return sentence(
                f"the arm is connected on {port}, and only one program can use the bus: disconnect it to "
                "look at the servos"
            )
        chosen = self._port()
        simulated = muted(_SIMULATED) if chosen.port == SIMULATED else ""
        return f"Port: <b>{escape(chosen.label)}</b>{muted(_ABOUT)}{simulated}"

    def _named(self, servo: int) -> str:
        return f"{servo} · {self._shared.titles.get(servo, 'not of this arm')}"

    def _not_now(self, snapshot: Snapshot) -> str | None:
        return self._shared.why_not(snapshot)

    def _chosen(self) -> str:
        """The port to use; ``InputError``: it cannot be."""
        choice = self._port()
        if choice.why_not is not None:
            raise InputError(f"{choice.label} cannot be used: {choice.why_not}")
        return choice.port

    def _seen_on(self) -> str:
        """The port on which the servos that are shown were seen."""
        seen = self._shared.seen
        return self._chosen() if seen is None else seen.port

    def _ask(self, title: str, text: str, label: str, action: Callable[[], Awaitable[object]]) -> None:
        """Ask before something is written."""
        session, gui = self._session, self._session.gui
        session.require_operator()
        question = gui.add_modal(title)

        async def taken() -> None:
            question.close()
            session.require_operator()
            await action()

        with question:
            LiveHtml(gui, f"{sentence(escape(text))}{muted(_EEPROM)}")
            session.on(gui.add_button(label, color="green").on_click, taken)
            session.on(gui.add_button("Leave it as it is", color="gray").on_click, question.close)

    # What is pressed.

    async def _on_look(self, key: str) -> None:
        shared = self._shared
        if not await shared.scan(self._chosen(), all_rates=key == _ALL_RATES):
            self._session.notify("Servos", "The search was cancelled.")
        elif (missing := shared.first_silent) is not None and not self._session.closed:
            self._becomes.value = self._named(missing)

    async def _on_keep(self) -> None:
        self._session.require_operator()
        found = await self._shared.look_at_all(self._seen_on(), right=True)
        self._session.notify("Servos", f"The settings of {len(found)} servos are kept as right.")

    async def _on_nudge(self, key: str) -> None:
        self._session.require_operator()
        one = self._shared.found(key)
        await self._shared.nudge(self._seen_on(), one.id, one.baud)
        self._session.notify("Servos", f"Servo {self._named(one.id)} has moved, and is limp again.")

    def _on_mend(self, key: str) -> None:
        """``key``: as ``_keyed`` has it."""
        seen = self._shared.seen
        one = None if seen is None else _keyed(seen.differ).get(key)
        if one is None or one.mend is None:
            raise InputError("that difference is no longer there; look for the servos again")
        mend = one.mend
        self._ask("Change a servo?", mend.words, "Write it", lambda: self._mend(mend))

    async def _mend(self, mend: Mend) -> None:
        found = await self._shared.mend(self._seen_on(), mend)
        self._session.notify("Servos", f"Servo {self._named(found.id)}: written and checked.")

    def _on_id(self, key: str) -> None:
        """Ask which id a servo is to get."""
        session, gui, one = self._session, self._session.gui, self._shared.found(key)
        session.require_operator()
        question = gui.add_modal(f"Another id for servo {one.id}?")

        async def taken() -> None:
            question.close()
            session.require_operator()
            await self._mend(Mend(one.id, one.baud, new_id=_as_id(new.value)))

        with question:
            new = gui.add_text("New id", str(one.id))
            LiveHtml(gui, muted(_EEPROM))
            session.on(gui.add_button("Write it", color="green").on_click, taken)
            session.on(gui.add_button("Leave it as it is", color="gray").on_click, question.close)

    async def _on_give(self) -> None:
        """Find the one new servo, and ask whether it is to get this id."""
        self._session.require_operator()
        shared = self._shared
        wanted, port = shared.ids[self._becomes.options.index(self._becomes.value)], self._chosen()
        self._step.show("Looking for it …")
        try:
            one = await shared.find_new(port)
        except BaseException:
            self._step.show("")
            raise
        volts = "" if one.voltage is None else f" at {one.voltage:.1f} V"
        self._step.show(f"One servo answers: <b>{escape(one.model)}</b>{volts}, id {one.id}.")
        text = f"the servo that answers as {one.id} becomes servo {self._named(wanted)}"
        self._ask("Give it this id?", text, f"Give it id {wanted}", lambda: self._give(port, one, wanted))

    async def _give(self, port: str, one: FoundServo, wanted: int) -> None:
        if one.baud != self._shared.baud:
            one = await self._shared.mend(port, Mend(one.id, one.baud, new_baud=self._shared.baud))
        await self._shared.mend(port, Mend(one.id, one.baud, new_id=wanted))
        done = f"<b style='color:{GOOD}'>✓ Servo {escape(self._named(wanted))}</b> is set up."
        place = self._shared.ids.index(wanted) + 1
        if place < len(self._shared.ids):
            self._becomes.value = self._becomes.options[place]
            done += f" Unplug it, and plug in the next one: <b>{escape(self._becomes.value)}</b>."
        else:
            done += " It was the last one: plug all of them in, and look for the servos."
        self._step.show(done)

    async def _on_save(self) -> None:
        self._session.require_operator()
        found = await self._shared.look_at_all(self._chosen(), right=True)
        self._session.download("calibration.json", encode_kept(found))

    async def _on_upload(self) -> None:
        session, file = self._session, self._upload.value
        session.require_operator()
        kept = decode_kept(file.content, file.name)
        require_fits(kept, self._shared.robot, file.name)
        found = await self._shared.look_at_all(self._chosen())
        self._show_compared(file.name, kept, found)

    def _show_compared(self, name: str, kept: dict[str, KeptServo], found: dict[str, FoundServo]) -> None:
        lines = [
            f"<div>{escape(self._named(one.id))}: {register} is {has}, the file has {wanted}</div>"
            for motor, one in kept.items()
            for register, wanted, has in changed(one, found[motor])
        ]
        self._file = (name, kept) if lines else None
        self._restore.visible = bool(lines)
        same = f"<span style='color:{GOOD}'>✓ The servos are as {escape(name)} has them.</span>"
        self._compared.show("".join(lines) or same)

    async def _on_restore(self) -> None:
        if self._file is None:
            raise InputError("choose a file first")
        name, kept = self._file
        text = f"what differs from {name} is written into the servos. An offset moves what a servo calls its "
        text += "position: look at the arm's zeros afterwards"
        self._ask("Write LeRobot's calibration?", text, "Write it", lambda: self._write(name, kept))

    async def _write(self, name: str, kept: dict[str, KeptServo]) -> None:
        port = self._seen_on()
        count = await self._shared.restore(port, kept)
        self._session.notify("Servos", f"{count} registers are written and checked.")
        self._show_compared(name, kept, await self._shared.look_at_all(port))


def _as_id(text: str) -> int:
    typed = text.strip()
    if not (typed.isascii() and typed.isdecimal() and int(typed) <= _HIGHEST_ID):
        raise InputError(f"{typed!r} is no id of a servo: 0 … {_HIGHEST_ID}")
    return int(typed)


# What is shown of the servos.

_CELL = "padding:2px 4px;white-space:nowrap"
_TABLE = "border-collapse:collapse;width:100%;font-size:11.5px"
_HEADS = ("Id", "Joint", "Model", "V", "°C", "Firmware", "State", "")
_TROUGH = "height:6px;margin:6px 0;border-radius:3px;background:rgba(128,128,128,.25)"


def _look_html(shared: SharedServos, busy: str | None) -> str:
    """The buttons that look for servos, or how far a search is."""
    if not shared.doing:
        every = button("servo-look", "At every baud rate", key=_ALL_RATES, why=busy)
        look = button("servo-look", "Look for the servos", why=busy, kind="go")
        return f"<div style='display:flex;gap:8px'>{look}{every}</div>"
    done = (
        f"<div style='height:100%;width:{100 * shared.share:.0f}%;background:{GOOD};border-radius:3px'></div>"
    )
    cancel = button("servo-cancel", "Cancel the search") if shared.cancellable else ""
    return f"<div>{escape(sentence(shared.doing)[:-1])} … {cancel}<div style='{_TROUGH}'>{done}</div></div>"


def servos_html(shared: SharedServos, seen: ScannedBus, why: str | None) -> str:
    """A table in the order of the chain, and what differs; ``why``: why nothing can be changed now."""
    by_id: dict[int, list[FoundServo]] = {}
    for one in seen.found:
        by_id.setdefault(one.id, []).append(one)
    strangers = [servo for servo in by_id if servo not in shared.ids]
    rows = "".join(
        _row(servo, shared.titles.get(servo, "not of this arm"), one, why)
        for servo in (*shared.ids, *strangers)
        for one in by_id.get(servo, [None])
    )
    heads = "".join(f"<th style='{_CELL};text-align:left;font-weight:400'>{head}</th>" for head in _HEADS)
    table = (
        f"<div style='overflow-x:auto;margin-top:6px'><table class=armctl-servos style='{_TABLE}'>"
        f"<tr style='opacity:.7'>{heads}</tr>{rows}</table></div>"
    )
    if not seen.found:
        none = "no servo answers: does the supply feed them, and is the first plug in?"
        return f"<div style='color:{ERROR};margin-top:4px'>{sentence(none)}</div>{table}"
    if not seen.differ:
        good = f"✓ {len(seen.found)} servos, as the arm needs them."
        return f"{table}<div style='color:{GOOD};margin-top:4px'>{good}</div>"
    count = "1 difference" if len(seen.differ) == 1 else f"{len(seen.differ)} differences"
    return f"{table}{heading(f'{count} from what the arm needs')}{_differences_html(seen.differ, why)}"


def _row(servo: int, title: str, one: FoundServo | None, why: str | None) -> str:
    if one is None:
        cells = [str(servo), escape(title), "–", "–", "–", "–"]
        state, buttons = f"<span style='color:{ERROR}'>silent</span>", ""
    else:
        own = one.settings
        volts = "–" if one.voltage is None else f"{one.voltage:.1f}"
        heat = "–" if one.temperature is None else f"{one.temperature:.0f}"
        cells = [str(servo), escape(title), escape(one.model), volts, heat, escape(own.firmware)]
        wrong = bool(one.faults or own.unfit)
        words = "fault" if one.faults else "not fit" if own.unfit else "torque on" if one.on else "limp"
        state = f"<span style='color:{WARNING if wrong else 'inherit'}'>{words}</span>"
        hint = "turns it by 2° and back, weakly; support the arm"
        buttons = button("servo-nudge", "Nudge", key=servo_key(one), why=why, title=hint, kind="chip")
        buttons += button(
            "servo-id", "Change id", key=servo_key(one), why=why, title="gives it another id", kind="chip"
        )
    wraps = (k in (1, 6) for k in range(len(_HEADS)))  # the name of the joint, and how it stands
    line = "".join(
        f"<td style='{_CELL}{';white-space:normal' * wrap}'>{cell}</td>"
        for cell, wrap in zip((*cells, state, buttons), wraps, strict=True)
    )
    return f"<tr style='border-top:1px solid rgba(128,128,128,.2)'>{line}</tr>"


def _keyed(differ: Sequence[Difference]) -> dict[str, Difference]:
    """Differences by what their buttons say when they are pressed."""
    places = Counter[int]()
    keyed: dict[str, Difference] = {}
    for one in differ:
        keyed[f"{one.servo}.{places[one.servo]}"] = one
        places[one.servo] += 1
    return keyed


def _differences_html(differ: Sequence[Difference], why: str | None) -> str:
    html = ""
    for key, one in _keyed(differ).items():
        cure = f"<div style='opacity:.8'>→ {escape(sentence(one.cure))}</div>" if one.cure else ""
        mend = "" if one.mend is None else button("servo-mend", one.mend.words, key=key, why=why)
        html += (
            f"<div style='margin:4px 0;padding:2px 0 2px 8px;border-left:3px solid {WARNING}'>"
            f"<div>{escape(sentence(one.what))}</div>{cure}{mend}</div>"
        )
    return html
