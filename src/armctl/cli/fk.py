"""``armctl fk``: the tool's pose at joint angles."""

from __future__ import annotations

import click
import numpy as np

from armctl.cli.options import NUMBER, QUERY_SETTINGS, json_option, print_json, rounded
from armctl.errors import ArmctlError
from armctl.kinematics import roll_pitch_yaw
from armctl.robot import Robot, load_robot


@click.command(context_settings=QUERY_SETTINGS)
@click.argument("robot")
@click.argument("q", nargs=-1, type=NUMBER)
@json_option
def fk(robot: str, q: tuple[float, ...], as_json: bool) -> None:
    """Compute the pose of ROBOT's tool at joint angles Q… (degrees).

    Position in mm in the base frame; roll, pitch, yaw as Rz(yaw)·Ry(pitch)·Rx(roll).
    """
    arm = load_robot(robot)
    if len(q) != arm.n:
        names = ", ".join(arm.joint_names)
        raise click.UsageError(f"{arm.name} needs {arm.n} joint angles in degrees, got {len(q)}: {names}")
    configuration = np.radians(arm.chain.checked(q))
    T = arm.forward(configuration)
    rpy = np.degrees(roll_pitch_yaw(T[:3, :3]))
    matrix = T.copy()
    matrix[:3, 3] *= 1000
    outside = _outside(arm, configuration)
    if as_json:
        print_json({
            "position_mm": rounded(matrix[:3, 3]),
            "rpy_deg": rounded(rpy),
            "matrix": [rounded(row, 12) for row in matrix],
            "outside_limits": outside,
        })  # fmt: skip
    else:
        x, y, z = matrix[:3, 3] + 0.0
        roll, pitch, yaw = (round(float(angle), 4) + 0.0 for angle in rpy)  # no -0.0000
        click.echo(f"position   x {x:10.4f}   y {y:10.4f}   z {z:10.4f}  mm")
        click.echo(f"rotation   roll {roll:9.4f}   pitch {pitch:9.4f}   yaw {yaw:9.4f}  degrees")
        for row in matrix:
            click.echo("           " + "  ".join(f"{value + 0.0:11.6f}" for value in row))
    if outside is not None:
        click.echo(f"armctl: warning: the arm cannot stand there: {outside}", err=True)


def _outside(arm: Robot, q: np.ndarray[tuple[int, ...], np.dtype[np.float64]]) -> str | None:
    """Which joints are outside their limits, in words; None when all are inside."""
    try:
        arm.check_limits(q)
    except ArmctlError as refusal:
        return str(refusal)
    return None
