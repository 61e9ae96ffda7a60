"""Plain code of its own for what sentences say: products of 4 x 4 matrices, small steps, many starts.

Nothing here calls armctl's kinematics, paths or pre-flight. Of a robot only its data is read.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from scipy.optimize import nnls
from scipy.spatial import ConvexHull

from armctl.arrays import FloatArray
from armctl.robot import Robot

ROUNDS = 8
"""of starts, where a goal is said to be within reach"""


def link_poses(robot: Robot, q: FloatArray) -> FloatArray:
    """(links, k, 4, 4) poses of the link frames at ``q`` (k, n) [rad], one product after the other."""
    chain = robot.chain
    turns = q if chain.coupling is None else q @ chain.coupling.T
    T, poses = np.broadcast_to(np.eye(4), (len(q), 4, 4)), []
    for k, segment in enumerate(chain.segments):
        c, s = np.cos(turns[:, k]), np.sin(turns[:, k])
        turn = np.zeros((len(q), 4, 4))
        turn[:, 0, 0] = turn[:, 1, 1] = c
        turn[:, 1, 0], turn[:, 0, 1] = s, -s
        turn[:, 2, 2] = turn[:, 3, 3] = 1.0
        T = T @ segment @ turn
        poses.append(T)
    return np.array(poses)


def tools(robot: Robot, q: FloatArray) -> FloatArray:
    """(k, 4, 4) tool poses."""
    return link_poses(robot, q)[-1] @ robot.chain.tail


def features(robot: Robot, q: FloatArray, *, pitched: bool = False, turned: bool = False) -> FloatArray:
    """(k, 3, 4 or 12) tool point [m], and the height of the approach axis, which is the sine of the pitch.

    Where it is ``turned``, all three axes of the tool instead.
    """
    T = tools(robot, q)
    if turned:
        return np.column_stack([T[:, :3, 3], T[:, :3, :3].reshape(-1, 9)])
    return np.column_stack([T[:, :3, 3], T[:, 2, 2]]) if pitched else T[:, :3, 3]


def slopes(function: Callable[[FloatArray], FloatArray], q: FloatArray, h: float = 1e-6) -> FloatArray:
    """(k, m, n) central differences of a function of configurations (k, n)."""
    k, n = q.shape
    steps = h * np.eye(n)[:, None]
    values = function(np.concatenate([q + steps, q - steps]).reshape(-1, n)).reshape(2, n, k, -1)
    return np.transpose((values[0] - values[1]) / (2 * h), (1, 2, 0))


def descended(
    function: Callable[[FloatArray], FloatArray],
    goal: FloatArray,
    q: FloatArray,
    limits: FloatArray,
    rounds: int,
) -> tuple[FloatArray, FloatArray]:
    """Where starts (k, n) come to inside limits (n, 2) on the way to a goal (m,), and how far off (k,)."""
    low, high = limits.T
    q, damping = np.clip(q, low, high), np.full(len(q), 1e-3)
    off = function(q) - goal
    cost = (off * off).sum(axis=1)
    for _ in range(rounds):
        J = slopes(function, q)
        g = np.einsum("kij,ki->kj", J, off)
        held = ((q <= low) & (g > 0)) | ((q >= high) & (g < 0))
        J = np.where(held[:, None, :], 0.0, J)
        A = np.einsum("kij,kil->kjl", J, J) + damping[:, None, None] * np.eye(q.shape[1])
        trial = np.clip(q - np.linalg.solve(A, np.where(held, 0.0, g)[:, :, None])[:, :, 0], low, high)
        off_there = function(trial) - goal
        there = (off_there * off_there).sum(axis=1)
        won = there < cost
        q[won], off[won], cost[won] = trial[won], off_there[won], there[won]
        damping = np.clip(np.where(won, 0.3 * damping, 4.0 * damping), 1e-14, 1e3)
        if cost.min() < 1e-22 or damping.min() >= 1e3:
            break  # there, or nowhere any nearer
    return q, np.sqrt(cost)


def nearest(
    robot: Robot, goal: FloatArray, limits: FloatArray, rng: np.random.Generator, *, pitched: bool = False,
    turned: bool = False, starts: int = 60, first: FloatArray | None = None,
    between: dict[int, tuple[float, float]] | None = None, until: float | None = None,
) -> float:  # fmt: skip
    """The least distance from a goal that many starts find inside limits (n, 2).

    ``between``: what each link may turn by, those of the robot where it is None; passing it costs as much as
    a far goal. ``until``: other starts are tried, a few times, while none has come so near.
    """
    if between is None:
        between = {one.link: (one.lower, one.upper) for one in robot.chain.turn_limits}
    low, high = limits.T

    def beyond(q: FloatArray) -> FloatArray:
        turns = q if robot.chain.coupling is None else q @ robot.chain.coupling.T
        over = [
            np.maximum(np.maximum(a - turns[:, k], turns[:, k] - b), 0.0) for k, (a, b) in between.items()
        ]
        return 100.0 * np.array(over).reshape(-1, len(q)).T

    def function(q: FloatArray) -> FloatArray:
        return np.column_stack([features(robot, q, pitched=pitched, turned=turned), beyond(q)])

    goal = np.append(goal, np.zeros(len(between)))
    least, given = math.inf, np.empty((0, robot.n)) if first is None else first
    for again in range(1 if until is None else ROUNDS):
        spread = rng.uniform(low, high, (3000, robot.n))
        off = np.linalg.norm(function(spread) - goal, axis=1)
        any_others = spread[: starts * bool(again)]  # the nearest may all lead to one place
        q = np.vstack([given, spread[np.argsort(off)[:starts]], any_others])
        least = min(least, float(descended(function, goal, q, limits, 60)[1].min()))
        if until is None or least < until:
            break
    return least


def followed(
    robot: Robot, q: FloatArray, points: FloatArray, sine: float | None, held: list[int]
) -> FloatArray | None:
    """(k, n) the branch of ``q`` along points (k, 3) [m], by small steps; None: it does not lead on.

    ``sine``: of the pitch that is kept, or None; the joints ``held`` stand. As many equations as joints.
    """
    moving = [k for k in range(robot.n) if k not in held]
    out = [q]
    before = q
    for point in points[1:]:
        goal = point if sine is None else np.append(point, sine)
        here, guess = out[-1], 2 * out[-1] - before
        for _ in range(12):
            off = features(robot, guess[None], pitched=sine is not None)[0] - goal
            if np.abs(off).max() < 1e-12:
                break
            J = slopes(lambda q: features(robot, q, pitched=sine is not None), guess[None])[0][:, moving]
            guess = guess.copy()
            guess[moving] -= np.linalg.lstsq(J, off, rcond=None)[0]
        if np.abs(off).max() > 1e-9 or np.abs(guess - here).max() > 0.5:
            return None
        before = here
        out.append(guess)
    return np.array(out)


def body_pieces(robot: Robot, q: FloatArray) -> list[tuple[FloatArray, float]]:
    """Corners (m, k, 3) [m] and the margin round their hull [m] of each piece of the body at ``q`` (m, n)."""
    links = [*link_poses(robot, q), np.broadcast_to(np.eye(4), (len(q), 4, 4))]  # the base, -1, comes last
    mounts: list[FloatArray] = []
    for mount in robot.collision.mounts:
        T = links[mount.turns].copy()
        T[:, :3, 3] = links[mount.hangs][:, :3, 3]
        if mount.pins is not None:  # a rod: its x from pin to pin
            pins = mount.pins
            near, far = T @ np.append(pins.near, 1.0), links[pins.link] @ np.append(pins.far, 1.0)
            x = (far - near)[:, :3]
            x /= np.linalg.norm(x, axis=1)[:, None]
            z = np.cross(x, T[:, :3, :3] @ pins.beside)
            z /= np.linalg.norm(z, axis=1)[:, None]
            T[:, :3] = np.stack([x, np.cross(z, x), z, near[:, :3]], axis=2)
        mounts.append(T)
    frames = [*links[:-1], *mounts, links[-1]]
    return [
        (
            piece.corners @ frames[piece.link][:, :3, :3].transpose(0, 2, 1)
            + frames[piece.link][:, None, :3, 3],
            piece.as_hull.margin,
        )
        for piece in robot.collision.capsules
    ]


def overlap(one: tuple[FloatArray, float], other: tuple[FloatArray, float]) -> float:
    """The least way on which two pieces, corners (k, 3), come apart [m]; negative: how far apart they are."""
    (a, near), (b, far) = one, other
    if len(a) == len(b) == 2:
        return near + far - apart((a[0], a[1]), (b[0], b[1]))
    between = (a[:, None] - b[None]).reshape(-1, 3)
    inside = -float(ConvexHull(between).equations[:, 3].max())
    if inside > 0.0:
        return near + far + inside
    size = float(np.abs(between).max())
    rows = np.vstack([between.T / size, np.full(len(between), 1e3)])
    shares, _ = nnls(rows, np.array([0.0, 0.0, 0.0, 1e3]), maxiter=100 * len(between))
    return near + far - float(np.linalg.norm(shares @ between / shares.sum()))


def apart(one: tuple[FloatArray, FloatArray], other: tuple[FloatArray, FloatArray]) -> float:
    """Distance of two segments [m]: the inside, else the ends of either from the other."""
    (a, b), (c, d) = one, other

    def to_segment(p: FloatArray, a: FloatArray, b: FloatArray) -> float:
        way = b - a
        size = float(way @ way)
        t = 0.0 if size == 0.0 else min(max(float((p - a) @ way) / size, 0.0), 1.0)
        return float(np.linalg.norm(a + t * way - p))

    found = [to_segment(a, c, d), to_segment(b, c, d), to_segment(c, a, b), to_segment(d, a, b)]
    A = np.column_stack([b - a, c - d])
    st, _, rank, _ = np.linalg.lstsq(A, c - a, rcond=None)
    if rank == 2 and (st >= 0).all() and (st <= 1).all():
        found.append(float(np.linalg.norm(A @ st - (c - a))))
    return min(found)


def gravity_torques(robot: Robot, q: FloatArray, payload_kg: float) -> FloatArray:
    """(n,) size of the static torques [N·m]: the slope of the potential energy."""

    def energy(q: FloatArray) -> FloatArray:
        poses = link_poses(robot, q)
        total = np.zeros(len(q))
        for body in robot.gravity.bodies:
            place = robot.chain.places[robot.chain.joint_rows[body.joint] + 1]
            centre = poses[body.joint] @ place.T_link_frame @ np.append(body.com_m, 1.0)
            total += 9.80665 * body.mass_kg * centre[:, 2]
        return (total + 9.80665 * payload_kg * tools(robot, q)[:, 2, 3])[:, None]

    return np.abs(slopes(energy, q[None], 1e-5)[0, 0])


def isotropy(robot: Robot, q: FloatArray) -> float:
    """Smallest over largest singular value of the tool point's slopes by the joints that may turn."""
    moving = robot.limits[:, 0] < robot.limits[:, 1]
    J = slopes(lambda q: features(robot, q, pitched=False), q[None])[0][:, moving]
    sizes = np.linalg.svd(J, compute_uv=False)
    return float(sizes[2] / sizes[0])


def degrees_near(said: float, angle: float, within: float = 0.006) -> bool:
    """Whether an angle [rad] is as said [°]."""
    return abs(said - math.degrees(angle)) <= within
