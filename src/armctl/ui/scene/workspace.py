"""The workspace as a cloud: where the tool point can be, and how freely it moves there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import viser
from numpy.typing import NDArray

from armctl.kinematics import quaternion_wxyz
from armctl.kinematics.section import Section
from armctl.kinematics.workspace import Extent, sample_workspace, workspace_extent
from armctl.robot import Robot

FloatArray = NDArray[np.float64]
Colouring = Literal["height", "manipulability"]
COLOURINGS: tuple[Colouring, ...] = ("height", "manipulability")
_POINTS = 14_000
_POINT_SIZE = 0.004
"""of the reach: small enough to see the arm through the cloud"""
_LOW, _MIDDLE, _HIGH = (
    np.array([68.0, 1.0, 84.0]),
    np.array([33.0, 145.0, 140.0]),
    np.array([253.0, 231.0, 37.0]),
)


@dataclass(frozen=True, slots=True)
class WorkspaceCloud:
    """Tool points inside the joint limits and above the floor, and the workspace cut open."""

    points: FloatArray
    """(k, 3) [m]"""
    manipulability: FloatArray
    """(k,) √det(J Jᵀ) of the tool point's velocity [m³]; 0 at a singularity"""
    extent: Extent
    """of all tool points, also those below the floor"""
    section: Section

    def colors(self, colouring: Colouring) -> NDArray[np.uint8]:
        """(k, 3) RGB: dark where the value is low, yellow where it is high."""
        values = self.points[:, 2] if colouring == "height" else self.manipulability
        low, high = np.percentile(values, (1, 99)) if len(values) else (0.0, 1.0)
        u = np.clip((values - low) / max(high - low, 1e-12), 0.0, 1.0)[:, None]
        below = _LOW + 2 * u * (_MIDDLE - _LOW)
        above = _MIDDLE + (2 * u - 1) * (_HIGH - _MIDDLE)
        return np.where(u < 0.5, below, above).round().astype(np.uint8)


def workspace_cloud(robot: Robot, count: int = _POINTS) -> WorkspaceCloud:
    """Sample the workspace; the same points every time.

    Args:
        robot: the arm.
        count: about how many points; those with the tool point below the floor are left out.
    """
    samples = sample_workspace(robot.chain, robot.limits, count)
    above = samples.points[:, 2] >= robot.floor_z
    return WorkspaceCloud(
        samples.points[above],
        samples.manipulability[above],
        workspace_extent(robot.chain, robot.limits),
        robot.inverse_kinematics.section(),
    )


class CloudFigure:
    """One page's drawing of the cloud."""

    def __init__(self, scene: viser.SceneApi, name: str = "/workspace") -> None:
        self._scene, self._name = scene, name
        self._handle: viser.PointCloudHandle | None = None

    def show(self, cloud: WorkspaceCloud, colouring: Colouring) -> None:
        """Draw the cloud."""
        self.hide()
        self._handle = self._scene.add_point_cloud(
            self._name,
            cloud.points,
            cloud.colors(colouring),
            point_size=_POINT_SIZE * cloud.extent.reach,
            point_shape="circle",
            point_shading="flat",
            precision="float32",
        )

    def hide(self) -> None:
        """Draw nothing."""
        if self._handle is not None:
            self._handle.remove()
            self._handle = None


# The section of the workspace as lines in the 3D view, in the plane that turns with the arm.

_COLOR = (224, 49, 49)


class SectionLines:
    """One page's drawing of the section."""

    def __init__(self, scene: viser.SceneApi, name: str = "/section") -> None:
        self._scene, self._name = scene, name
        self._lines: viser.LineSegmentsHandle | None = None
        self._pose = np.eye(4)

    def show(self, outline: Sequence[FloatArray]) -> None:
        """Draw closed lines (k, 2), given in x and z of the plane [m]."""
        self.hide()
        if not outline:
            return
        ends = np.concatenate([np.stack([line[:-1], line[1:]], axis=1) for line in outline])
        segments = np.insert(ends, 1, 0.0, axis=2)
        self._lines = self._scene.add_line_segments(
            self._name, segments, _COLOR, thickness=2.5, thickness_units="screen"
        )
        self._place(self._lines)

    def place(self, T_base_plane: FloatArray) -> None:
        """Move the plane (4, 4), metres."""
        if not np.array_equal(T_base_plane, self._pose):
            self._pose = T_base_plane
            if self._lines is not None:
                self._place(self._lines)

    def hide(self) -> None:
        """Draw nothing."""
        if self._lines is not None:
            self._lines.remove()
            self._lines = None

    def _place(self, lines: viser.LineSegmentsHandle) -> None:
        lines.wxyz = quaternion_wxyz(self._pose[:3, :3])
        lines.position = self._pose[:3, 3]
