"""Which arms count as a spherical shoulder with an elbow, whatever their rows look like."""

from __future__ import annotations

import math

import numpy as np
import pytest
from tests.kinematics.kit import plain_forward, random_q
from tests.kinematics.spherical_kit import HUMANOID, HUMANOID_LIMITS, random_arm, spherical_solver

from armctl.kinematics import Chain, DHRow
from armctl.kinematics.families.spherical_shoulder.geometry import recognise_spherical
from armctl.kinematics.subproblems import turned


def test_the_humanoid_is_recognised() -> None:
    geometry = recognise_spherical(HUMANOID)
    assert geometry is not None
    assert geometry.links == pytest.approx((0.35, 0.29, 0.0))
    assert geometry.reach == pytest.approx((0.06, 0.64))
    assert geometry.offset == pytest.approx(0.0)
    pose = HUMANOID.forward(np.radians([45, 0, 30, 50, 0]))
    assert 100 * pose[:3, 3] == pytest.approx([32.5689, 32.5689, -35.3467], abs=1e-4)
    ik = spherical_solver(HUMANOID, HUMANOID_LIMITS)
    assert ik.family == "spherical shoulder, elbow, roll"
    assert (ik.pitch_joints, ik.free_joint) == ((), 0)


def test_the_geometry_of_random_arms_gives_their_poses() -> None:
    rng = np.random.default_rng(80)
    conventions: set[str] = set()
    for _ in range(60):
        chain, limits = random_arm(rng)
        geometry = recognise_spherical(chain)
        assert geometry is not None
        conventions.add(chain.convention)
        q = random_q(rng, limits)
        T = plain_forward(chain, q)
        hand, approach = geometry.hand(q[3]), geometry.beyond(q[3], q[-1]) @ geometry.tool[:, 2]
        for axis, angle in zip(geometry.axes[2::-1], q[2::-1], strict=True):
            hand, approach = turned(hand, axis, angle), turned(approach, axis, angle)
        assert geometry.centre + hand == pytest.approx(T[:3, 3], abs=1e-12)
        assert approach == pytest.approx(T[:3, 2], abs=1e-12)
        assert np.linalg.norm(hand) == pytest.approx(
            math.hypot(
                geometry.links[0] + geometry.links[1] * math.cos(q[3] + geometry.offset),
                geometry.links[1] * math.sin(q[3] + geometry.offset),
                geometry.links[2],
            )
        )
    assert conventions == {"standard", "modified"}


def rows(**changed: DHRow) -> Chain:
    table = dict(zip(("one", "two", "three", "four", "five"), HUMANOID.rows, strict=True)) | changed
    return Chain.from_dh(list(table.values()), "standard")


@pytest.mark.parametrize(
    "changed",
    [
        {"one": DHRow(0.05, math.pi / 2, 0.0)},  # the second axis passes the first
        {"two": DHRow(0.0, -math.pi / 2, 0.02)},  # the third axis passes the shoulder
        {"two": DHRow(0.0, 0.0, 0.0)},  # second and third axis are one
        {"three": DHRow(0.0, math.pi / 2, 0.0)},  # the elbow axis passes through the shoulder
        {"five": DHRow(0.03, 0.0, 0.29)},  # the tip lies beside the roll axis
        {"five": DHRow(0.0, 0.0, 0.0)},  # the tip lies on the elbow axis
    ],
)
def test_what_is_nearly_one_is_not_taken_for_one(changed: dict[str, DHRow]) -> None:
    assert recognise_spherical(rows()) is not None
    assert recognise_spherical(rows(**changed)) is None
