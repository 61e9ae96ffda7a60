"""What the page's scene draws."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from tests.browser.kit import Screen

from armctl.robot import Robot


def ghost_tip_mm(screen: Screen, robot: Robot) -> NDArray[np.float64] | None:
    """Where the ghost's tool is drawn (3,) [mm]; None: no ghost is shown."""
    tip = screen.node("/ghost/tool")
    return None if tip is None else 1000 * np.array(tip)


def wait_for_ghost(screen: Screen, robot: Robot, q: NDArray[np.float64]) -> None:
    """Wait until the ghost's tool is where that of ``q`` (n,) [rad] is."""
    tip = 1000 * robot.forward(q)[:3, 3]

    def there() -> bool:
        shown = ghost_tip_mm(screen, robot)
        return shown is not None and float(np.abs(shown - tip).max()) < 0.05

    screen.wait_until(there, f"the ghost's tool is at {tip.round(1).tolist()}")


def wait_for_no_ghost(screen: Screen, robot: Robot) -> None:
    screen.wait_until(lambda: ghost_tip_mm(screen, robot) is None, "no ghost is shown")
