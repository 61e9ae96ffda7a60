"""Frames of the links against plain products, and the gravity torque that is built on them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.kinematics.kit import chain_of, plain_frames, random_planar_arm

from armctl.kinematics import Body, DHChain, GravityModel
from armctl.kinematics.energy import STANDARD_GRAVITY
from armctl.kinematics.link_frames import LinkFrames, row_in_link
from armctl.robot import load_robot, shipped_robots

CHAINS = [load_robot(name).chain for name in shipped_robots()]
for seed in range(4):
    rng = np.random.default_rng(seed)
    kind = ("standard", "modified")[seed % 2]
    CHAINS.append(chain_of(random_planar_arm(rng), kind, roll=seed > 1, rng=rng))


@pytest.mark.parametrize("chain", CHAINS)
def test_every_row_is_found_again_in_its_link(chain: DHChain) -> None:
    rng = np.random.default_rng(7)
    q = rng.uniform(-3, 3, (9, chain.n))
    links = LinkFrames.at(chain, q)
    places = row_in_link(chain)
    assert [link for link, _ in places] == [-1, *np.cumsum([row.joint for row in chain.rows]) - 1]
    for m, row in enumerate(q):
        for (link, T), frame in zip(places, plain_frames(chain.rows, chain.convention, row), strict=True):
            np.testing.assert_allclose(links.place(link, T[:3, 3][None])[:, 0, m], frame[:3, 3], atol=1e-12)
            tips = links.place(link, T[:3, 3] + T[:3, :3].T)[:, :, m]
            np.testing.assert_allclose(tips - frame[:3, 3:], frame[:3, :3], atol=1e-12)


@pytest.mark.parametrize("chain", CHAINS)
def test_joint_axes_are_the_z_of_the_links(chain: DHChain) -> None:
    q = np.linspace(-1, 1, chain.n)
    points, directions = chain.axes(q)
    links = LinkFrames.at(chain, q[None])
    for j in range(chain.n):
        np.testing.assert_allclose(links.rotation[j][:, 2, 0], directions[j], atol=1e-12)
        np.testing.assert_allclose(links.origin[j][:, 0], points[j], atol=1e-12)


@pytest.mark.parametrize("chain", CHAINS)
def test_gravity_torque_is_the_gradient_of_the_potential_energy(chain: DHChain) -> None:
    rng = np.random.default_rng(11)
    bodies = tuple(
        Body(int(j), float(rng.uniform(0.1, 1)), tuple(rng.uniform(-0.1, 0.1, 3).tolist()))  # type: ignore[arg-type]
        for j in rng.integers(0, chain.n, 5)
    )
    model = GravityModel(chain, bodies, 0.7)

    def energy(q: np.ndarray) -> float:
        frames = plain_frames(chain.rows, chain.convention, q)
        total = 0.7 * frames[-1][2, 3]
        for body in bodies:
            total += body.mass_kg * (frames[chain.joint_rows[body.joint] + 1] @ [*body.com_m, 1.0])[2]
        return float(STANDARD_GRAVITY * total)

    q = rng.uniform(-2, 2, chain.n)
    step = 1e-6 * np.eye(chain.n)
    gradient = [(energy(q + row) - energy(q - row)) / 2e-6 for row in step]
    np.testing.assert_allclose(model.torque(q), gradient, atol=1e-6)
    many = rng.uniform(-2, 2, (2, 3, chain.n))
    assert model.torque(many).shape == many.shape
    np.testing.assert_allclose(model.torque(many)[1, 2], model.torque(many[1, 2]), atol=1e-12)


def test_a_payload_put_in_later_counts() -> None:
    model = load_robot("uzuner").gravity
    q = np.radians([0, 10, 5, 5, 0])
    heavier = replace(model, payload_kg=model.payload_kg + 1.0)
    lever = load_robot("uzuner").forward(q)[0, 3]
    assert heavier.torque(q)[1] - model.torque(q)[1] == pytest.approx(STANDARD_GRAVITY * lever, rel=1e-9)
