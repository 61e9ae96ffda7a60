"""Masses of an arm from its look: motors by their make, other parts by material and volume. An estimate."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from armctl.arrays import FloatArray
from armctl.kinematics import Body, Chain
from armctl.robot.look.pieces import Piece
from armctl.robot.look.rows import AnyRow, Motor
from armctl.robot.look.stock import DENSITIES, MAKES, Material
from armctl.robot.solids import Solid

MASSES_ASSUMED = (
    "masses of the links: from the look, motors by their make and other parts by material and volume"
)


def masses(
    chain: Chain, rows: Sequence[AnyRow], pieces: Sequence[Piece], material: Material
) -> tuple[Body, ...]:
    """A body for each piece that joints move.

    Hidden volume counts where solids overlap, and a hollow part has the density that its walls leave. A rod
    is taken to move with the link that it hangs on: level pieces of a parallelogram weigh on its joints as
    if they were at their pins.
    """
    return tuple(_bodies(chain, rows, pieces, material))


def _bodies(
    chain: Chain, rows: Sequence[AnyRow], pieces: Sequence[Piece], material: Material
) -> Iterator[Body]:
    for row in dict.fromkeys(piece.row for piece in pieces):
        said, own = rows[row], [piece for piece in pieces if piece.row == row]
        link = max(own[0].mount.hangs, own[0].mount.turns)
        if link < 0:
            continue
        # a row and its mirror image; the colours of one motor are pieces of their own
        volumes, centres = zip(*(_volume(part.solid) for piece in own for part in piece.parts), strict=True)
        volume, images = float(np.sum(volumes)), 1 if said.mirror is None else 2
        density = 1000.0 * DENSITIES[said.material or material]
        mass = images * MAKES[said.make].mass_kg if isinstance(said, Motor) else density * volume
        centre = np.average(np.array(centres), axis=0, weights=np.array(volumes))
        place = np.linalg.inv(chain.places[chain.joint_rows[link] + 1].T_link_frame)
        x, y, z = (place[:3, :3] @ centre + place[:3, 3]).tolist()
        yield Body(link, mass, (x, y, z))


def _volume(solid: Solid) -> tuple[float, FloatArray]:
    """Of a closed solid [m³], and its centre (3,) [m]: Gauss' theorem over its triangles."""
    a, b, c = solid.vertices[solid.faces].transpose(1, 0, 2)
    six = np.einsum("ij,ij->i", a, np.cross(b, c))
    volume = float(six.sum()) / 6
    return volume, (six[:, None] * (a + b + c)).sum(axis=0) / 24 / volume
