"""The body of an arm at each opening of its gripper, worked out once for all arms that have the same."""

from __future__ import annotations

from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np

from armctl.arrays import ArrayRecord, FloatArray
from armctl.kinematics.chain import Chain
from armctl.lazy_dataclass import dataclass
from armctl.robot.body.arm_body import ANY_OPENING, ArmBody, Capsule, CarriedPart, Openings
from armctl.robot.body.collision import CollisionModel, SolidPairs
from armctl.robot.look.pieces import Drawing, Piece
from armctl.robot.parts import Look, Obstacle, Shape

if TYPE_CHECKING:
    from armctl.robot.body.of_look import LookBody
from collections.abc import Callable, Sequence

from armctl.kinematics.samples import joint_samples
from armctl.robot.look.pieces import link_name, of_joints

MOST_OPENINGS = 8
"""of the gripper, with what it carries, for which the body is kept"""
_Held = tuple[Openings, CarriedPart | None]
_MOST_ARMS = 24
"""for which bodies are kept: what a calibration or another speed limit changes has the same"""


@dataclass(frozen=True, eq=False, repr=False)
class Bodies(ArrayRecord):
    """What an arm's body depends on, and the body: see ``shared``."""

    chain: Chain
    names: tuple[str, ...]
    """of its links, from the base to the tool"""
    titles: tuple[str, ...]
    look: Look
    given: tuple[Capsule, ...] | None
    """pieces that are kept apart; None: the solids of the look"""
    limits: FloatArray
    """(n, 2) [rad]"""
    resting: FloatArray
    """(k, n) poses in which it rests [rad]"""
    obstacles: tuple[Obstacle, ...]

    def shared(self) -> Bodies:
        """The first one that is equal to this, with all that was worked out for it."""
        return _first(self)

    @cached_property
    def drawing(self) -> Drawing:
        """The arm as it stands while its look is described."""
        pose = np.array(self.look.pose or np.zeros(len(self.limits)), dtype=np.float64)
        return Drawing(self.chain, self.names, self.titles, pose)

    @cached_property
    def pieces(self) -> tuple[Piece, ...]:
        """What the look says, to draw and to keep apart."""
        rows = enumerate(self.look.rows)
        return tuple(piece for i, row in rows for piece in self.drawing.pieces(i, row))

    @cached_property
    def opens(self) -> bool:
        """Whether the body depends on the opening of the gripper."""
        return self._solids is not None and self._solids.opens

    def at(self, openings: Openings) -> ArmBody:
        """The pieces that are kept apart, with jaws where they are at the openings, and all between."""
        return ArmBody(self.given or ()) if self._solids is None else self._solids.at(openings)

    def collision(self, openings: Openings = ANY_OPENING, part: CarriedPart | None = None) -> CollisionModel:
        """The same, and a part that is carried, as a model of which of them may touch."""
        openings = openings if self.opens else ANY_OPENING
        known = self._models
        if (openings, part) not in known:
            leave_room(known)
            known[openings, part] = (
                self._model(openings, self._always if self.opens else None)
                if part is None
                else self.collision(openings).carrying(part.hung(self.chain), self.limits)
            )
        return known[openings, part]

    def undersides(
        self, openings: Openings = ANY_OPENING, part: CarriedPart | None = None
    ) -> tuple[Underside, ...]:
        """What comes nearest to the floor, from the base to the tool; without what no joint lifts."""
        openings = openings if self.opens else ANY_OPENING
        known = self._undersides
        if (openings, part) not in known:
            leave_room(known)
            known[openings, part] = undersides(
                self.collision(openings),
                self.titles,
                self.limits,
                self.resting,
                None if part is None else part.hung(self.chain),
                with_points=self.given is not None,
            )
        return known[openings, part]

    @cached_property
    def _solids(self) -> LookBody | None:
        if self.given is not None:
            return None
        from armctl.robot.body.of_look import LookBody

        return LookBody(self.pieces, len(self.chain.segments))

    @cached_property
    def _models(self) -> dict[_Held, CollisionModel]:
        return {}

    @cached_property
    def _undersides(self) -> dict[_Held, tuple[Underside, ...]]:
        return {}

    @cached_property
    def _always(self) -> SolidPairs:
        """Solids that touch each other in all configurations, with the gripper closed, half open and open."""
        found = self._model((0.0, 0.0)).touching_solids
        for one in (0.5, 1.0):  # only jaws are elsewhere then
            jaws = frozenset(pair for pair in found if self._solids is not None and self._solids.moves(*pair))
            if jaws:
                found = found - jaws | self._model((one, one), among=jaws).touching_solids
        return found

    def _model(
        self, openings: Openings, always: SolidPairs | None = None, among: SolidPairs | None = None
    ) -> CollisionModel:
        body = self.at(openings)
        return CollisionModel.build(
            self.chain,
            body.capsules,
            self.limits,
            self.resting if len(self.resting) else self.limits.mean(axis=1)[None],
            self.obstacles,
            mounts=body.mounts,
            solids=body.solids,
            always=always,
            among=among,
        )


def body_of_shapes(
    arm: Bodies, shapes: Sequence[Shape], progress: Callable[[int, int], None] | None = None
) -> ArmBody:
    """The hulls of the shapes of an arm, and what its look says of links without any; kept on disk."""
    from armctl.robot.body.meshes import keep

    def fit() -> ArmBody:
        from armctl.robot.body.fitting import fitted_body  # scipy, and seconds of work

        drawn = [one for one in arm.at(ANY_OPENING).capsules if one.link >= 0]
        return fitted_body(arm.chain, shapes, arm.titles, drawn, progress)

    return keep(ArmBody, shapes, arm.chain.made_of(), arm.titles, arm.look, make=fit)


def kept_body_of_shapes(arm: Bodies, shapes: Sequence[Shape]) -> ArmBody | None:
    """The same, where it is kept already: it takes no time then."""
    from armctl.robot.body.meshes import kept

    return kept(ArmBody, shapes, arm.chain.made_of(), arm.titles, arm.look)


@lru_cache(_MOST_ARMS)
def _first(bodies: Bodies) -> Bodies:
    return bodies


def leave_room(known: dict[_Held, Any]) -> None:
    """Forget the oldest of what is kept by openings and parts, so that one more has room."""
    while len(known) >= MOST_OPENINGS:
        known.pop(next(iter(known)), None)


_PROBES = 24


@dataclass(frozen=True, slots=True, eq=False)
class Underside:
    """An end of a capsule, or the corners of a hull, to be kept above the floor."""

    link: int
    """index of its link"""
    points: FloatArray
    """(k, 3) in the link's frame [m]"""
    radius: float
    """how far below them the piece reaches [m]"""
    thickness: float
    """how far it may be below the floor where it lies on it in the home or the rest pose [m]"""
    rests: float
    """how high its lowest place is in the home or the rest pose, whichever is lower [m]; inf: in neither"""
    part: str
    """what a user calls the part that it belongs to"""
    levers: FloatArray
    """(n,) how far it rises or sinks a radian of each joint, at most [m/rad]"""


def undersides(
    model: CollisionModel,
    titles: Sequence[str],
    limits: FloatArray,
    resting: FloatArray,
    carried: Capsule | None = None,
    *,
    with_points: bool = True,
) -> tuple[Underside, ...]:
    """What joints raise or lower within limits (n, 2) [rad], of an arm that rests in poses (m, n) [rad].

    Over a plane a capsule is lowest below one of its ends, and a hull below one of its corners. The ends of
    DH rows that no capsule ends at count without thickness (``with_points``), and so do a ``carried`` part
    beside those of ``model`` and the tool point, which comes last.
    """
    chain = model.chain
    probes, rests = model.frames(joint_samples(limits, _PROBES)), model.frames(resting)
    upright = abs(chain.segments[0][2, 2]) > 1 - 1e-12  # then the first joint changes no height
    pieces = [
        (c.link, points, c.as_hull.margin, c.radius if c.hull is None else c.hull.thickness, c.part)
        for c in model.capsules
        for points in (c.corners[:, None] if c.hull is None else c.corners[None])
    ]
    link, T = chain.places[-1]
    tool = (link, T[None, :3, 3], 0.0, 0.0, "the tool")
    ends = [(c.link, end) for c in model.capsules if c.hull is None for end in c.corners] + [(link, T[:3, 3])]
    for link, place in chain.places if with_points else ():
        point = place[:3, 3]
        known = (end for its_link, end in ends if its_link == link)
        if not any(np.allclose(point, end, atol=1e-9) for end in known):
            ends.append((link, point))
            pieces.append((link, point[None], 0.0, 0.0, link_name(link, titles)))
    if carried is not None:  # lying on the floor at rest is no reason to be below it
        pieces.append((carried.link, carried.corners, 0.0, 0.0, carried.part))
    pieces.append(tool)
    found: list[Underside] = []
    for link, points, radius, thickness, part in pieces:
        if link >= 0 and np.ptp(probes.place(link, points)[2].min(axis=0)) > 1e-9:
            levers = model.levers_of(link, points)
            levers[0] *= not upright
            lowest = float(rests.place(link, points)[2].min(initial=np.inf)) - radius
            levers = of_joints(chain, levers)
            found.append(Underside(link, points, radius, thickness, lowest, part, levers))
    return tuple(found)
