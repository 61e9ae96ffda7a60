"""A planned motion as one HTML file, which plays in any browser, without armctl and without a network.

The file is viser's client with the arm in it, as viser embeds a scene (``KeptScene``), a
player of our own (``twin_file.js``), graphs, and what the pre-flight found. viser's own player would repeat
the poses as messages of 80 bytes each; here a pose is seven numbers of two bytes, as differences, deflated.
"""

from __future__ import annotations

import base64
import json
import math
import zlib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from html import escape
from importlib import resources
from typing import Any

import numpy as np

from armctl import __version__
from armctl.arrays import FloatArray
from armctl.errors import ProgramError
from armctl.facts import Several, ShownSoFar
from armctl.facts.angles import DEGREE
from armctl.motion.figure import color_of
from armctl.motion.preflight import Finding, not_checked
from armctl.program import Program
from armctl.program.rehearsal import Rehearsal, rehearse
from armctl.robot import CarriedPart, Robot
from armctl.ui.scene.arm_model import ARM, HALF_OPEN, ArmFigure
from armctl.ui.scene.camera import first_view
from armctl.ui.scene.ghost import Lines, segments
from armctl.ui.scene.stage import Stage, set_lights
from armctl.ui.viser_seam import FILE_STYLE, SCRIPT, KeptScene, dressed

FRAMES_A_S, _MOST_FRAMES = 30, 9_000
"""what is between two frames is interpolated; a motion of more than five minutes has fewer a second"""
LONGEST_S, MOST_STEPS = 1800.0, 2000
"""a file ends after this much of a program"""
_CHUNK = 300
_PATH, _PATH_POINTS = (240, 140, 0), 1500
_ASPECT, _VIEW, _SEEN, _ROOM = 1.1, 40 * DEGREE, 200, 0.1
"""width by height of the scene on most screens, upright angle of view, poses in view, and around them"""


def planned_for_file(robot: Robot, program: Program, q: FloatArray, opening: float | None) -> Rehearsal:
    """What of a program a file shows, from ``q`` (n,) [rad]; a ``ProgramError`` says why there is nothing."""
    if program.robot != robot.name:
        raise ProgramError(f"{program.name} is for the robot {program.robot!r}, this one is {robot.name!r}")
    if not program.steps:
        raise ProgramError(f"{program.name} has no steps, so there is no motion to show")
    return rehearse(
        robot,
        program,
        q,
        HALF_OPEN if opening is None else opening,
        longest_s=LONGEST_S,
        most_steps=MOST_STEPS,
        as_far=True,
    )


def program_file(
    robot: Robot,
    program: Program,
    plan: Rehearsal,
    findings: Sequence[Finding],
    progress: Callable[[float], object] | None = None,
) -> str:
    """The page of a program's plan, with the findings of ``check_program``; the rest as in ``twin_file``."""
    broken = plan.broken
    told = broken and any(one.step == broken.index and one.severity == "error" for one in findings)
    if broken and broken.error is not None and not told:
        why = Several((broken.place.within(broken.error.reason), ShownSoFar()))
        findings = [*findings, Finding(why, step=broken.index)]
    steps = [f"{step.title or step.kind} {step.describe()}" for step in program.steps]
    return twin_file(robot, program.name, plan, findings, steps, progress)


def twin_file(
    robot: Robot,
    title: str,
    plan: Rehearsal,
    findings: Sequence[Finding],
    steps: Sequence[str] = (),
    progress: Callable[[float], object] | None = None,
) -> str:
    """The page of a plan.

    ``findings``: of its pre-flight. ``steps``: of a program in words, empty for a plain motion.
    ``progress`` is called with the share that is done; what it raises ends the work.
    """
    frames = min(math.ceil(plan.duration * FRAMES_A_S), _MOST_FRAMES - 1) + 1
    time = np.linspace(0.0, plan.duration, frames)
    scene = KeptScene()
    figures = _draw(scene, robot, plan)
    tracks, columns = _columns(robot, plan, time, figures, progress or (lambda share: None))
    said = [
        (one.begins, f"Step {one.index + 1} of {len(steps)}: {one.place.words}{steps[one.index]}")
        for one in plan.steps
        if steps
    ]
    side = (
        f"<aside id='twin-side'><h1>{escape(title)}</h1>"
        f"<p class='soft'>{escape(robot.title)}, {plan.duration:.1f} s at full speed</p>"
        f"<p id='twin-step'></p>{_found(robot, plan, findings, linked=bool(steps))}"
        f"{_graphs(robot, time, columns)}"
        f"<p class='soft'>A plan, computed by armctl {escape(__version__)}. No arm moved for it.</p></aside>"
    )
    data = {
        "duration": plan.duration,
        "frames": frames,
        "root": ARM,
        "tracks": tracks,
        "steps": said,
        "tools": _shown((step.begins, figures[step.tool].root.name) for step in plan.steps),
        "parts": _shown(_parts(plan, figures)),
        **_packed(columns),
    }
    return _page(scene.html(), title, side, data)


def _draw(scene: KeptScene, robot: Robot, plan: Rehearsal) -> dict[str, ArmFigure]:
    """The stage, the tool's way, and the arm where the plan begins: a figure with each tool, by its name."""
    set_lights(scene.api)
    Stage(scene.api, robot)
    path = plan.tool_path(robot, _PATH_POINTS)
    Lines(scene.api, "/path", _PATH).show(segments(path))
    figures, state = dict[str, ArmFigure](), plan.sample(0.0)
    for tool in dict.fromkeys(step.tool for step in plan.steps):
        name = f"{ARM}{len(figures)}" if figures else ARM
        figures[tool] = figure = ArmFigure(scene.api, robot.with_tool(tool), name)
        figure.pose(state.q, state.opening)
        figure.root.visible = tool == state.tool
    scene.camera.fov = _VIEW
    way = plan.trajectory.sample(np.linspace(0.0, plan.duration, _SEEN)).q
    frames = robot.frames(way)[..., :3, 3].reshape(-1, 3)
    room = _ROOM * robot.chain.length
    points = np.vstack([frames - room, frames + room, path, [0.0, 0.0, robot.floor_z]])
    scene.camera.position, scene.camera.look_at = first_view(robot, points, _VIEW, _ASPECT)
    return figures


def _parts(plan: Rehearsal, figures: Mapping[str, ArmFigure]) -> Iterator[tuple[float, str]]:
    """Draw all that is carried. From when [s] which node is shown; "": nothing is carried."""
    nodes = dict[tuple[str, CarriedPart], str]()
    yield 0.0, ""
    for step in plan.steps:
        if step.part is not None and (step.tool, step.part) not in nodes:
            drawn = figures[step.tool].add_part(step.part, f"part{len(nodes)}")
            drawn.visible = False  # until the player shows it
            nodes[step.tool, step.part] = drawn.name
        yield step.begins, "" if step.part is None else nodes[step.tool, step.part]


def _shown(nodes: Iterable[tuple[float, str]]) -> list[tuple[float, str]]:
    """Without those that show what is shown already."""
    shown: list[tuple[float, str]] = []
    for begins, node in nodes:
        if not shown or node != shown[-1][1]:
            shown.append((begins, node))
    return shown


# The motion as numbers.


def _columns(
    robot: Robot,
    plan: Rehearsal,
    time: FloatArray,
    figures: Mapping[str, ArmFigure],
    progress: Callable[[float], object],
) -> tuple[list[tuple[str, int]], FloatArray]:
    """The first column of each part that moves, and (columns, k): parts, angles, speeds, the tool's speed.

    Angles and speeds in degrees and seconds, the tool's in mm/s.
    """
    parts: list[dict[str, FloatArray]] = []
    curves: list[FloatArray] = []
    trajectory = plan.trajectory
    for first in range(0, len(time), _CHUNK):
        progress(first / len(time))
        at = time[first : first + _CHUNK]
        state = trajectory.sample(at)
        opening = np.array([plan.sample(t).opening for t in at.tolist()], dtype=np.float64)
        parts.append({})
        for figure in figures.values():
            parts[-1] |= figure.tracks(state.q, opening)
        speed = np.empty(len(at))
        for arm, then in plan.by_tool(robot, at):
            tool = np.einsum("kij,kj->ki", arm.jacobian(state.q[then])[:, :3], state.velocity[then])
            speed[then] = 1000 * np.linalg.norm(tool, axis=1)
        curves.append(np.vstack([robot.shown(state.q).T, robot.shown(state.velocity).T, speed]))
    tracks = {name: np.concatenate([part[name] for part in parts]).T for name in parts[0]}
    moving = [name for name, track in tracks.items() if np.ptp(track, axis=1).max() > 1e-9]
    shown = [*(tracks[name] for name in moving), np.hstack(curves)]
    return [(name, 7 * i) for i, name in enumerate(moving)], np.vstack(shown)


def _packed(columns: FloatArray) -> dict[str, object]:
    """Columns (m, k) as whole numbers 0 … 65535 of each one's range; their differences, deflated."""
    low, high = columns.min(axis=1), columns.max(axis=1)
    step = (high - low) / 65535
    words = np.rint((columns - low[:, None]) / np.where(step > 0, step, 1.0)[:, None]).astype(np.uint16)
    difference = np.diff(words, axis=1, prepend=np.uint16(0))
    planes = np.stack([difference & 0xFF, difference >> 8], axis=1).astype(np.uint8)
    return {
        "ranges": np.stack([low, step], axis=1).tolist(),
        "columns": base64.b64encode(zlib.compress(planes.tobytes(), 9)).decode("ascii"),
    }


# The page.

# Nothing may be fetched, whatever viser's client or a program's texts may try.
_POLICY = (
    "default-src 'none'; script-src 'unsafe-inline' 'unsafe-eval' 'wasm-unsafe-eval' blob: data:; "
    "worker-src blob: data:; style-src 'unsafe-inline'; img-src data: blob:; font-src data:; "
    "connect-src data: blob:; base-uri 'none'; form-action 'none'"
)
_SPEEDS = ("0.25", "0.5", "1", "2", "4", "8")
_BAR = (
    "<div id='twin-bar'><button id='twin-play' type='button'>Play</button>"
    "<input id='twin-seek' type='range' min='0' max='{most}' step='0.01' value='0' aria-label='Time s'>"
    "<span id='twin-time'></span><select id='twin-speed' aria-label='Speed'>{speeds}</select></div>"
)


def _page(client: str, title: str, side: str, data: dict[str, Any]) -> str:
    here = resources.files("armctl.ui")
    script, style = (here.joinpath(f"twin_file.{kind}").read_text("utf-8") for kind in ("js", "css"))
    speeds = "".join(
        f"<option value='{one}'{' selected' if one == '1' else ''}>{one}×</option>" for one in _SPEEDS
    )
    packed = json.dumps(data, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")
    return dressed(
        client,
        ahead=f'<meta http-equiv="Content-Security-Policy" content="{_POLICY}">'
        f"<style>{style}{FILE_STYLE}</style><script>{SCRIPT}</script>",
        title=escape(title),
        behind=f"{side}{_BAR.format(most=data['duration'], speeds=speeds)}"
        f"<script id='twin-data' type='application/json'>{packed}</script><script>{script}</script>",
    )


def _found(robot: Robot, plan: Rehearsal, findings: Sequence[Finding], *, linked: bool) -> str:
    """The pre-flight's findings; ``linked``: that of a step leads to the time at which the step begins."""
    begins = {step.index: step.begins for step in reversed(plan.steps if linked else ())}
    rows: list[str] = []
    for finding in findings:
        text = f"{'✖' if finding.severity == 'error' else '⚠'} {escape(str(finding))}"
        if finding.step in begins:
            text = f"<button type='button' data-time='{begins[finding.step]}'>{text}</button>"
        rows.append(f"<li class='{finding.severity}'>{text}</li>")
    notes = [f"Not checked: {one.text}" for one in not_checked(robot)]
    if plan.cut:
        notes.append(f"Only the first {plan.duration:.0f} s are shown; there is more of the program.")
    listed = f"<ul>{''.join(rows)}</ul>" if rows else "<p>Nothing found.</p>"
    return f"<h2>Pre-flight</h2>{listed}" + "".join(f"<p class='soft'>{escape(note)}</p>" for note in notes)


# Graphs: SVG with a cursor that the player moves.

_WIDTH, _HEIGHT, _LEFT, _RIGHT, _TOP, _BOTTOM = 384, 128, 40, 6, 8, 18
_POINTS = 600


def _graphs(robot: Robot, time: FloatArray, columns: FloatArray) -> str:
    """Of the last ``2 n + 1`` columns, see ``_columns``."""
    titles, first = [joint.title for joint in robot.joints], len(columns) - 2 * robot.n - 1
    shown = (
        ("Joint angles", "°", titles, first),
        ("Joint speeds", "°/s", titles, first + robot.n),
        ("Tool speed", "mm/s", ["tool"], len(columns) - 1),
    )
    return "".join(
        _graph(time, title, unit, columns[at : at + len(names)], names, at)
        for title, unit, names, at in shown
    )


def _graph(
    time: FloatArray, title: str, unit: str, values: FloatArray, names: Sequence[str], column: int
) -> str:
    """Lines (m, k) over the time; the first one's values are the player's ``column``."""
    end = float(time[-1]) or 1.0
    low, high = min(float(values.min()), 0.0), max(float(values.max()), 0.0)
    high = high if high - low > 1e-6 else low + 1.0
    wide, tall = _WIDTH - _LEFT - _RIGHT, _HEIGHT - _TOP - _BOTTOM

    def x(at: Any) -> Any:
        return _LEFT + wide * at / end

    def y(value: Any) -> Any:
        return _TOP + tall * (high - value) / (high - low)

    keep = np.unique(np.linspace(0, len(time) - 1, min(len(time), _POINTS)).round().astype(np.intp))
    parts: list[str] = []
    for tick in _ticks(low, high, 4):
        parts.append(
            f"<path d='M{_LEFT} {y(tick):.1f}h{wide}' stroke='#e9ecef'/>"
            f"<text x='{_LEFT - 5}' y='{y(tick) + 4:.1f}' text-anchor='end'>{_number(tick)}</text>"
        )
    parts += [
        f"<text x='{x(tick):.1f}' y='{_HEIGHT - 4}' text-anchor='middle'>{_number(tick)}</text>"
        for tick in _ticks(0.0, end, 6)
    ]
    colors = [color_of(i, name) for i, name in enumerate(names)]
    for line, color in zip(values, colors, strict=True):
        points = " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(x(time[keep]), y(line[keep]), strict=True))
        parts.append(
            f"<polyline points='{points}' fill='none' stroke='{color}' stroke-width='1.5' "
            "stroke-linejoin='round'/>"
        )
    parts.append(
        f"<path class='now' d='M0 {_TOP}v{tall}' stroke='#212529' transform='translate({_LEFT} 0)'/>"
    )
    legend = "".join(
        f"<span><span style='color:{colors[i]}'>■</span> {escape(name)} "
        f"<b data-column='{column + i}'></b></span>"
        for i, name in enumerate(names)
    )
    return (
        f"<h2>{title} <small>({unit}, over s)</small></h2>"
        f"<svg viewBox='0 0 {_WIDTH} {_HEIGHT}' data-left='{_LEFT}' data-width='{wide}' role='img' "
        f"aria-label='{title} over the time'>{''.join(parts)}</svg><div class='values'>{legend}</div>"
    )


def _number(value: float) -> str:
    return f"{value + 0.0:.10g}".replace("-", "−")


def _ticks(low: float, high: float, most: int) -> list[float]:
    """Round numbers within a range, ``most`` steps at most."""
    rough = (high - low) / most
    power = 10.0 ** math.floor(math.log10(rough))
    step = next(power * one for one in (1, 2, 5, 10) if power * one >= rough * (1 - 1e-9))
    return [step * i for i in range(math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9) + 1)]
