"""From where a page sees the arm."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Coroutine, Sequence
from typing import Any, Protocol

import numpy as np
import viser

from armctl.arrays import FloatArray
from armctl.robot import Robot
from armctl.ui.scene.arm_model import arm_model
from armctl.ui.scene.stage import front

_IN_FRONT, _BESIDE, _ABOVE = 0.62, 0.72, 0.32
"""the direction from the arm to the camera"""
_HIGHER = 0.4
"""by so much more above on a phone"""
_STRETCHED = 0.75
"""of the reach, to each side: the arm fills the picture, and mostly stays in it"""
_FILLED = 0.95
"""of the picture, by the arm and how far it reaches"""
_EDGE = 0.97
"""of the picture: what is nearer to its edge counts as outside"""
_SHEET = 0.6
"""of the picture of a phone, covered by the panels"""
_SMALL = 0.6
"""of an arm's reach, that of another one beside it"""
_LEAST_ASPECT = 0.5
"""where the panels leave the scene a narrower strip, the arm may go beyond it"""
_FOLLOWS_S, _FRAMES = 0.25, 10
"""so long the view takes to take something in, and in so many pictures"""
_AS_LEFT = 0.01
"""of its distance: a camera that is no farther from where the program put it was turned by nobody"""

Place = tuple[FloatArray, FloatArray]
"""where a camera stands, and what it looks at (3,) [m]"""


def framed(points: FloatArray, away: FloatArray, fov: float, aspect: float, filled: float) -> Place:
    """Where a camera stands, and the middle of its picture (3,) [m], with points (k, 3) [m] in view; z is up.

    ``away`` (3,): the direction to it, not along z; ``fov`` [rad] upright; ``aspect`` width by height;
    ``filled``: the part of the shorter of them that the points may take (0 … 1).
    """
    back = away / np.linalg.norm(away)
    right = np.cross([0.0, 0.0, 1.0], back)
    right /= np.linalg.norm(right)
    axes = np.stack([right, np.cross(back, right), back])  # to the right, up, towards the camera
    seen = points @ axes.T
    middle = 0.5 * (seen.min(axis=0) + seen.max(axis=0))
    x, y, nearer = (seen - middle).T
    high = filled * math.tan(0.5 * fov)
    distance = float((nearer + np.maximum(np.abs(x) / (high * aspect), np.abs(y) / high)).max())
    centre: FloatArray = middle @ axes
    return centre + distance * back, centre


VIEWS: dict[str, tuple[float, float, float]] = {
    "Reset": (_IN_FRONT, _BESIDE, _ABOVE),
    "Front": (1.0, 0.0, 0.12),
    "Side": (0.0, 1.0, 0.12),
    "Top": (0.02, 0.0, 1.0),
}
"""the directions to the camera: ahead of the home pose, to its right, up"""


def look_at_arm(
    client: viser.ClientHandle,
    robot: Robot,
    view: str = "Reset",
    *,
    beside: tuple[Robot, float] | None = None,
    shown: Sequence[FloatArray] = (),
    picture: tuple[int, int] | None = None,
    sheet: bool = False,
) -> None:
    """See the arm by one of ``VIEWS``, at once; the rest as ``place_for``."""
    camera = client.camera
    camera.up_direction = np.array([0.0, 0.0, 1.0])
    away = towards_camera(robot, view, sheet=sheet)
    camera.position, camera.look_at = place_for(
        camera, robot, away, beside=beside, shown=shown, picture=picture, sheet=sheet
    )


def place_for(
    camera: viser.CameraHandle,
    robot: Robot,
    away: FloatArray,
    *,
    beside: tuple[Robot, float] | None = None,
    shown: Sequence[FloatArray] = (),
    picture: tuple[int, int] | None = None,
    sheet: bool = False,
) -> Place:
    """Where the camera sees the arm from a direction (3,), and what it looks at.

    ``picture``: width and height that will be free; None: as they are.
    ``beside``: another arm that is seen, too, and how far along y it stands [m]; one that is much smaller is
    seen alone, or nothing could be made out of it, as on a phone. ``shown``: configurations
    (n,) [rad] of the arm, or of ghosts, that are not to be outside of the picture.
    ``sheet``: the panels lie over the lower part of the picture, so the arm is seen in the upper one.
    """
    width, height = (camera.image_width, camera.image_height) if picture is None else picture
    free = 1.0 - _SHEET if sheet else 1.0
    aspect = max(width / (free * height), _LEAST_ASPECT)
    high = math.tan(0.5 * camera.fov)
    fov = 2 * math.atan(free * high)
    points = in_view(robot, shown)
    if beside is not None:
        other, aside = beside
        others = in_view(other) + np.array([0.0, aside, 0.0])
        small = other.chain.length < _SMALL * robot.chain.length
        points = others if small or sheet else np.vstack([points, others])
    position, middle = framed(points, away, fov, aspect, _FILLED)
    away = position - middle
    right = np.cross([0.0, 0.0, 1.0], away)
    down = (1.0 - free) * high * np.cross(right, away) / np.linalg.norm(right)
    return position + down, middle + down


def in_picture(camera: viser.CameraHandle, robot: Robot, q: FloatArray, *, sheet: bool) -> bool:
    """Whether all joints and the tool at ``q`` (n,) [rad] are in view; ``sheet`` as in ``look_at_arm``."""
    points = np.vstack([robot.frames(q)[..., :3, 3].reshape(-1, 3), robot.forward(q)[:3, 3]])
    away = np.asarray(camera.position) - np.asarray(camera.look_at)
    right = np.cross([0.0, 0.0, 1.0], away)
    length = float(np.linalg.norm(right))
    if length == 0.0 or not camera.image_height:  # straight from above, or nobody has told yet
        return True
    back, right = away / np.linalg.norm(away), right / length
    axes = np.stack([right, np.cross(back, right), back])
    x, y, nearer = axes @ (points - np.asarray(camera.position)).T
    high = -nearer * math.tan(0.5 * camera.fov)
    wide = high * camera.image_width / camera.image_height
    low = 2 * _SHEET - 1 if sheet else -1.0
    high, wide = _EDGE * high, _EDGE * wide
    return bool(((np.abs(x) <= wide) & (y <= high) & (y >= low * high)).all())


def first_view(robot: Robot, points: FloatArray, fov: float, aspect: float, view: str = "Reset") -> Place:
    """Where the camera stands by one of ``VIEWS``, and what it looks at (3,) [m]; as ``framed``."""
    return framed(points, towards_camera(robot, view), fov, aspect, _FILLED)


def towards_camera(robot: Robot, view: str = "Reset", *, sheet: bool = False) -> FloatArray:
    """The direction (3,) from the arm to the camera in one of ``VIEWS``; of no length in particular.

    ``sheet``: from higher, as an arm above the middle of the picture is seen from lower than its middle is.
    """
    ahead = front(robot)
    side = np.array([ahead[1], -ahead[0]])
    forward, beside, above = VIEWS[view]
    return np.array([*(forward * ahead + beside * side), above + _HIGHER * sheet])


def in_view(robot: Robot, shown: Sequence[FloatArray] = ()) -> FloatArray:
    """Home and rest poses, the foot, and the arm stretched ahead, to both sides and upwards (k, 3) [m].

    ``shown``: other configurations (n,) [rad].
    """
    size, ahead = robot.chain.length, front(robot)
    shoulder = float(robot.chain.axes()[0][:2, 2][-1])
    level = size - abs(shoulder)  # the column below the shoulder reaches nowhere
    side = np.array([-ahead[1], ahead[0]])
    poses = arm_model(robot).bounds(np.stack([robot.pose("home"), robot.pose("rest"), *shown]))
    level *= _STRETCHED
    stretched = [[*(level * way), shoulder] for way in (ahead, side, -side)]
    return np.vstack([poses, stretched, [[0.0, 0.0, robot.floor_z], [0.0, 0.0, shoulder + level]]])


class ViewedPage(Protocol):
    """What a view asks of its page (``ui.session``)."""

    client: viser.ClientHandle
    closed: bool
    on_phone: bool
    other_arrows: list[viser.TransformControlsHandle]

    @property
    def on_stage(self) -> list[FloatArray]: ...  # noqa: D102
    def spawn(self, work: Coroutine[Any, Any, None]) -> None: ...  # noqa: D102


class View:
    """A page's view of the arm. It takes in what stands outside of it, until a person has turned it."""

    def __init__(self, page: ViewedPage, robot: Robot) -> None:
        """As the camera of the page stands now."""
        self._page, self._robot = page, robot
        self._camera = page.client.camera
        self._left_at: Place = self._camera.position, self._camera.look_at
        self._beside: tuple[Robot, float] | None = None
        self._outside: FloatArray | None = None
        """(n,) what stood outside when that was looked at last [rad]"""
        self._moves = False
        self.held = False
        """the tool or a link is dragged in the scene: nothing else may move under the hand"""

    def look(
        self,
        view: str = "Reset",
        beside: tuple[Robot, float] | None = None,
        picture: tuple[int, int] | None = None,
    ) -> None:
        """See the arm from one side, with all that stands beside it; the rest as ``place_for``."""
        page = self._page
        look_at_arm(
            page.client, self._robot, view,
            beside=beside, shown=page.on_stage, picture=picture, sheet=page.on_phone,
        )  # fmt: skip
        self._left_at, self._beside = (self._camera.position, self._camera.look_at), beside

    def misses(self, q: FloatArray | None) -> bool:
        """Whether a ghost at ``q`` (n,) [rad] is in part outside of a picture that a person chose.

        Any other picture takes it in, once it rests.
        """
        if q is None or in_picture(self._camera, self._robot, q, sheet=self._page.on_phone):
            self._outside = None
            return False
        if self._turned or self.held or any(arrows.visible for arrows in self._page.other_arrows):
            return True
        rests = self._outside is not None and np.array_equal(q, self._outside)
        self._outside = q.copy()
        if rests and not self._moves:
            self._moves = True
            self._page.spawn(self._take_in())
        return False

    @property
    def _turned(self) -> bool:
        """Whether a person has turned it, or moved nearer."""
        if self._moves:
            return False
        position, look_at = self._left_at
        off = max(
            float(np.abs(self._camera.position - position).max()),
            float(np.abs(self._camera.look_at - look_at).max()),
        )
        return off > _AS_LEFT * float(np.linalg.norm(position - look_at))

    async def _take_in(self) -> None:
        page, camera, left_at = self._page, self._camera, self._left_at
        position, look_at = left_at
        try:
            to = place_for(
                camera, self._robot, position - look_at,
                beside=self._beside, shown=page.on_stage, sheet=page.on_phone,
            )  # fmt: skip
            for i in range(1, _FRAMES + 1):
                part = i / _FRAMES * (2 - i / _FRAMES)  # it slows down
                if page.closed or self._left_at is not left_at:  # somebody looks from elsewhere
                    return
                with page.client.atomic():
                    camera.position = position + part * (to[0] - position)
                    camera.look_at = look_at + part * (to[1] - look_at)
                await asyncio.sleep(_FOLLOWS_S / _FRAMES)
            self._left_at = to
        finally:
            self._moves = False
