"""Whether a look is sound: nothing floats, it stands, rods keep their length, the tool is reached."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import ArrayLike

from armctl.arrays import FloatArray
from armctl.documents import Document
from armctl.errors import Errors
from armctl.kinematics.frames import LinkFrames
from armctl.kinematics.samples import joint_samples
from armctl.lazy_dataclass import dataclass
from armctl.robot.body.hulls import nearing, padded
from armctl.robot.look.pieces import Jaw, Mount
from armctl.robot.look.rows import called
from armctl.robot.robot import Robot

JOINED_M = 1.5e-3
"""What is no farther apart is taken to be fixed to each other."""
STANDS_M = 3e-3
"""How far the foot may be above the floor, and anything below it in a named pose."""
REACHED_M = 15e-3
"""How far the tool point may be from the nearest solid."""
STRETCHED_M = 5e-4
"""By how much a rod may change its length."""
_HIDDEN_M = 1e-6
_SAMPLES, _AT_ONCE = 64, 20_000


@dataclass(frozen=True, slots=True)
class LookFault:
    """One thing that is wrong with a look."""

    row: int | None
    """index of the row; None: it is a matter of all of them"""
    what: str
    mend: str


def check_look(robot: Robot, document: Document, errors: Errors) -> None:
    """Find what cannot be in the rows of a robot's look, and name them."""
    if len(robot.look.pose) not in (0, robot.n):
        with errors:
            what = f"look.pose_deg: {robot.n} joints, but {len(robot.look.pose)} angles"
            raise document.error(what, ("look", "pose_deg"))
        return
    for i, row in enumerate(robot.look.rows):
        for key, what in robot.drawing.wrong(row):
            with errors:
                raise document.error(f"{called(i, row)}: {key}: {what}", ("look", "solids", i, key))


def faults(robot: Robot, samples: int = 6) -> Iterator[LookFault]:
    """What is wrong with the look of an arm; nothing where it has none.

    Besides home and rest it looks for what floats at some configurations over the limits (``samples``).
    """
    if not robot.look.rows:
        return
    solids = Solids(robot)
    poses = {name: robot.pose(name) for name in ("home", "rest")}
    many = np.vstack([*poses.values(), joint_samples(robot.limits, samples)])
    spread = np.arange(samples) / max(samples - 1, 1)
    adrift = solids.floating(many, np.concatenate([[0.0, 0.3], spread]))
    for row in sorted({row for rows in adrift for row in rows}):
        at = next(k for k, rows in enumerate(adrift) if row in rows)
        where = f"in the pose {tuple(poses)[at]}" if at < len(poses) else f"at {_degrees(many[at])}"
        yield LookFault(
            row, f"floats: {where} it touches nothing that stands on the base", "move it, or make it longer"
        )
    yield from _standing(robot, solids, poses)
    for row, other in solids.hidden(np.stack(list(poses.values()))):
        yield LookFault(row, f"is inside row {other + 1} altogether, where nobody sees it", "take it out")
    yield from _opening(robot, solids, poses["home"])
    for row, link in solids.unpinned(poses["home"]):
        what = f"its pin at {link} is in the air: no solid that moves with it is there"
        yield LookFault(row, what, "move it, add one there, or correct the turns_with of one that is")
    for row, change in stretched(robot, joint_samples(robot.limits, _SAMPLES)).items():
        if change > STRETCHED_M:
            yield LookFault(
                row,
                f"the rod changes its length by {1000 * change:.1f} mm over the joint limits",
                "its pins must make a parallelogram with the joints, or it hangs on another link",
            )
    tool = robot.forward(poses["home"])[None, :3, 3]
    away = min(float(_apart([one], [tool])[0]) for one in solids.placed(poses["home"][None], [0.0])[0])
    if away > REACHED_M:
        yield LookFault(
            None,
            f"no solid comes nearer to the tool point than {1000 * away:.0f} mm",
            f"a hand or a tip goes on to it ({1000 * REACHED_M:.0f} mm or nearer)",
        )


def _standing(robot: Robot, solids: Solids, poses: dict[str, FloatArray]) -> Iterator[LookFault]:
    """How the foot stands, and what reaches below the floor."""
    below: dict[int, tuple[float, str]] = {}
    foot = np.inf
    for name, q in poses.items():
        for opening in (0.0, 1.0):
            for row, link, corners in zip(
                solids.rows, solids.carriers, solids.placed(q[None], [opening])[0], strict=True
            ):
                height = float(corners[:, 2].min()) - robot.floor_z
                foot = min(foot, height if link < 0 else np.inf)
                if height < below.get(row, (-STANDS_M, ""))[0]:
                    below[row] = height, name
    for row, (height, name) in sorted(below.items()):
        yield LookFault(row, f"is {-1000 * height:.1f} mm below the floor in the pose {name}", "lift it")
    if foot == np.inf:
        yield LookFault(None, "nothing stands still with the base", "give the foot rows without joint")
    elif foot > STANDS_M:
        yield LookFault(
            None,
            f"the arm stands {1000 * foot:.1f} mm above the floor",
            "let the foot reach down to it, or say in [floor] where the floor is",
        )


def _opening(robot: Robot, solids: Solids, q: FloatArray) -> Iterator[LookFault]:
    """Jaws that nothing opens, and pairs that close while the gripper opens."""
    if robot.gripper is None:
        for row in dict.fromkeys(solids.rows[k] for k in solids.jaws):
            yield LookFault(row, "opens with a gripper, but the arm has none", "add a table [gripper]")
        return
    closed, half = solids.placed(np.stack([q, q]), [0.0, 0.5])
    for row in dict.fromkeys(solids.rows[k] for k in solids.jaws):
        pair = [k for k in solids.jaws if solids.rows[k] == row]
        sides = dict.fromkeys(solids.sides[k] for k in pair)
        if len(sides) == 2:  # a jaw and its mirror image
            one, other = ([k for k in pair if solids.sides[k] == side] for side in sides)
            before, after = (
                np.vstack([at[k] for k in one]).mean(0) - np.vstack([at[k] for k in other]).mean(0)
                for at in (closed, half)
            )
            if after @ before < before @ before:  # nearer, or already past each other
                yield LookFault(
                    row, "closes while the gripper opens", "change the sign of open_mm or open_deg"
                )


def stretched(robot: Robot, q: FloatArray) -> dict[int, float]:
    """By how much each rod changes its length [m] over configurations (m, n) [rad], by its row."""
    links, found = LinkFrames.at(robot.chain, q), dict[int, float]()
    for piece in robot.pieces:
        if (pins := piece.mount.pins) is not None:
            here = Mount(piece.mount.hangs, piece.mount.turns).at(links)
            near = np.einsum("ijm,j->im", here[0], pins.near) + here[1]
            far = links.place(pins.link, pins.far[None])[:, 0]
            found[piece.row] = max(
                found.get(piece.row, 0.0), float(np.ptp(np.linalg.norm(far - near, axis=0)))
            )
    return found


class Solids:
    """The convex solids of an arm's look."""

    def __init__(self, robot: Robot) -> None:
        self._robot = robot
        listed = [
            (piece, corners) for piece in robot.pieces for part in piece.parts for corners in part.corners
        ]
        self.rows = [piece.row for piece, _ in listed]
        self.carriers = [max(piece.mount.links) for piece, _ in listed]
        """the last link that moves each; -1: the base"""
        self._corners = [corners for _, corners in listed]
        self._jaws: list[Jaw | None] = [piece.jaw for piece, _ in listed]
        self.jaws = [k for k, jaw in enumerate(self._jaws) if jaw is not None]
        """which of them open"""
        self.sides = [piece.part for piece, _ in listed]
        """what a user calls each: mirror images that open have two names"""
        self._mounts = [piece.mount for piece, _ in listed]
        keys = list(zip(self._mounts, self._jaws, strict=True))
        numbers = {key: k for k, key in enumerate(dict.fromkeys(keys))}
        self._rigid = np.array([numbers[key] for key in keys], dtype=np.intp)
        i, j = np.triu_indices(len(listed), 1)
        same = self._rigid[i] == self._rigid[j]
        self._across = i[~same], j[~same]
        i, j = i[same], j[same]
        held = _apart([self._corners[k] for k in i], [self._corners[k] for k in j]) < JOINED_M
        self._fixed = list(zip(i[held].tolist(), j[held].tolist(), strict=True))

    def placed(self, q: FloatArray, openings: ArrayLike) -> list[list[FloatArray]]:
        """Corners (k, 3) [m] of each solid, base frame, at each of (m, n) [rad] and openings 0..1 (m,)."""
        links = LinkFrames.at(self._robot.chain, q)
        frames = {mount: mount.at(links) for mount in dict.fromkeys(self._mounts)}
        found: list[list[FloatArray]] = []
        for at, opening in enumerate(np.asarray(openings, dtype=np.float64).tolist()):
            here: list[FloatArray] = []
            for mount, jaw, corners in zip(self._mounts, self._jaws, self._corners, strict=True):
                if jaw is not None:
                    turn, way = jaw.at(opening)
                    corners = corners @ turn.T + way
                R, o = frames[mount]
                here.append(corners @ R[:, :, at].T + o[:, at])
            found.append(here)
        return found

    def floating(self, q: FloatArray, openings: ArrayLike) -> list[set[int]]:
        """Rows that do not hang together with the base, at each of (m, n) [rad] and openings (m,)."""
        placed = self.placed(q, openings)
        low, high = (
            np.array([[end(corners, axis=0) for corners in here] for here in placed])
            for end in (np.min, np.max)
        )
        i, j = self._across
        near = (np.maximum(low[:, i], low[:, j]) - np.minimum(high[:, i], high[:, j])).max(axis=2) < JOINED_M
        at, pair = np.nonzero(near)
        i, j = i[pair], j[pair]
        joined = np.concatenate([np.empty(0)] + [
            _apart(
                [placed[m][a] for m, a in zip(at[k : k + _AT_ONCE], i[k : k + _AT_ONCE], strict=True)],
                [placed[m][b] for m, b in zip(at[k : k + _AT_ONCE], j[k : k + _AT_ONCE], strict=True)],
            )
            for k in range(0, len(at), _AT_ONCE)
        ]) < JOINED_M  # fmt: skip
        found: list[set[int]] = []
        for m in range(len(placed)):
            here = joined & (at == m)
            beside = _beside(
                len(self.rows), [*self._fixed, *zip(i[here].tolist(), j[here].tolist(), strict=True)]
            )
            still = [k for k, link in enumerate(self.carriers) if link < 0]
            reached = _reached(beside, min(still, key=lambda k: low[m, k, 2]) if still else None)
            found.append({row for k, row in enumerate(self.rows) if k not in reached})
        return found

    def hidden(self, q: FloatArray) -> Iterator[tuple[int, int]]:
        """Rows whose solids are all inside one solid of another row, at each of (m, n) [rad], and it."""
        from scipy.spatial import ConvexHull  # 0.1 s

        placed, rows = self.placed(q, np.zeros(len(q))), np.array(self.rows)
        planes = [[ConvexHull(one, qhull_options="QJ").equations for one in here] for here in placed]
        for row in dict.fromkeys(self.rows):
            own = np.flatnonzero(rows == row)
            vertices = [np.concatenate([here[k] for k in own]) for here in placed]
            for k in np.flatnonzero(rows != row):
                inside = (
                    (points @ faces[k][:, :3].T + faces[k][:, 3]).max() < -_HIDDEN_M
                    for points, faces in zip(vertices, planes, strict=True)
                )
                if all(inside):
                    yield row, int(rows[k])
                    break

    def unpinned(self, q: FloatArray) -> Iterator[tuple[int, str]]:
        """Rods of which no solid is at one of their pins at ``q`` (n,) [rad], and the link of that pin."""
        [here], links = self.placed(q[None], [0.0]), LinkFrames.at(self._robot.chain, q[None])
        for row, mount in dict.fromkeys(zip(self.rows, self._mounts, strict=True)):
            if mount.pins is None:
                continue
            R, origin = (array[..., 0] for array in mount.at(links))
            far = links.place(mount.pins.link, mount.pins.far[None])[:, 0, 0]
            rod = np.vstack([corners for k, corners in enumerate(here) if self._mounts[k] == mount])
            along = (rod - origin) @ R[:, 0]
            wide = 2 * float(np.abs((rod - origin) @ R[:, 1:]).max())
            length = float((far - origin) @ R[:, 0])
            for at, moving, end in (
                (mount.hangs, {mount.hangs, mount.turns}, along < wide),
                (mount.pins.link, {mount.pins.link}, along > length - wide),
            ):
                others = [
                    corners
                    for k, corners in enumerate(here)
                    if self.rows[k] != row and moving & self._mounts[k].links
                ]
                if _apart([rod[end]] * len(others), others).min(initial=np.inf) > STANDS_M:
                    yield row, "the base" if at < 0 else self._robot.link_names[at]


def _apart(one: list[FloatArray], other: list[FloatArray]) -> FloatArray:
    """Between the hulls of points (k, 3) [m] each, at least; beyond ``REACHED_M`` no more exact."""
    if not one:
        return np.empty(0)
    nothing = np.zeros((1, 3))
    return nearing(padded(one, nothing), padded(other, nothing), np.full(len(one), REACHED_M))[0]


def _beside(count: int, pairs: list[tuple[int, int]]) -> list[set[int]]:
    found: list[set[int]] = [set() for _ in range(count)]
    for a, b in pairs:
        found[a].add(b)
        found[b].add(a)
    return found


def _reached(beside: list[set[int]], start: int | None) -> set[int]:
    reached = set[int]() if start is None else {start}
    todo = list(reached)
    while todo:
        fresh = beside[todo.pop()] - reached
        reached |= fresh
        todo += fresh
    return reached


def _degrees(q: FloatArray) -> str:
    return ", ".join(f"{angle:.0f}°" for angle in np.degrees(q).tolist())
