"""``armctl robots``: the shipped robots."""

from __future__ import annotations

import click
import numpy as np

from armctl.cli.options import json_option, print_json, rounded
from armctl.robot import load_robot, shipped_robots


@click.command()
@json_option
def robots(as_json: bool) -> None:
    """List the shipped robots: joints, limits, source."""
    arms = [load_robot(name) for name in shipped_robots()]
    if as_json:
        print_json([
            {
                "name": arm.name,
                "title": arm.title,
                "source": arm.source,
                "family": arm.inverse_kinematics.family,
                "joints": list(arm.joint_names),
                "limits_deg": [rounded(row, 6) for row in np.degrees(arm.limits)],
                "assumed": list(arm.assumed),
            }
            for arm in arms
        ])  # fmt: skip
        return
    for arm in arms:
        click.echo(f"{arm.name:<12}{arm.title}: {arm.n} joints; {arm.inverse_kinematics.family}")
        for joint, (low, high) in zip(arm.joints, np.degrees(arm.limits), strict=True):
            click.echo(f"{'':<12}{joint.title:<14}{low:9.2f}° … {high:.2f}°")
