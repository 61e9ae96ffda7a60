"""The body of an arm at each opening of its gripper, worked out once for all arms that have the same."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np

from armctl.arrays import ArrayRecord, FloatArray
from armctl.kinematics.chain import Chain
from armctl.robot.body.arm_body import ANY_OPENING, ArmBody, Capsule, CarriedPart, Openings
from armctl.robot.body.collision import CollisionModel, SolidPairs, Underside, undersides
from armctl.robot.look.pieces import Drawing, Piece
from armctl.robot.parts import Look, Obstacle

if TYPE_CHECKING:
    from armctl.robot.body.of_look import LookBody

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

    @property
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
            _leave_room(known)
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
            _leave_room(known)
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


@lru_cache(_MOST_ARMS)
def _first(bodies: Bodies) -> Bodies:
    return bodies


def _leave_room(known: dict[_Held, Any]) -> None:
    while len(known) >= MOST_OPENINGS:
        known.pop(next(iter(known)), None)
