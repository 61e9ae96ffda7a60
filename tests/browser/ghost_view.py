"""What the page's scene draws."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from tests.browser.kit import Screen

from armctl.robot import Robot

NEXT, LOOKED_AT = "/ghost", "/looked_at"
"""the ghost of the next pose, and the one of what is only looked at"""


def ghost_tip_mm(screen: Screen, ghost: str = NEXT) -> NDArray[np.float64] | None:
    """Where the ghost's tool is drawn (3,) [mm]; None: it is not shown."""
    tip = screen.node(f"{ghost}/tool")
    return None if tip is None else 1000 * np.array(tip)


ARROW_M = 0.035
"""how far above the tool its upward arrow is taken"""

_ON_SCREEN = """([name, x, y, z]) => {
  const node = window.__viserMutable.nodeRefFromName[name];
  node.updateWorldMatrix(true, false);  // no frame may have come since it was put there
  const camera = window.__viserMutable.camera ?? window.__viserMutable.cameraControl.camera;
  const p = node.localToWorld(node.position.clone().set(x, y, z)).project(camera);
  const box = document.querySelector("#root canvas[data-engine]").getBoundingClientRect();
  return [box.left + (p.x + 1) / 2 * box.width, box.top + (1 - p.y) / 2 * box.height];
}"""


def arrow_px(screen: Screen, name: str, up_m: float) -> tuple[float, float]:
    """Where on the screen the upward arrow of a node is, so far above its middle [m]."""
    x, y = screen.page.evaluate(_ON_SCREEN, [name, 0, 0, up_m])
    return x, y


def drag_tool(screen: Screen, dx: float, dy: float) -> None:
    """Drag the upward arrow at the tool by so many pixels."""
    screen.page.evaluate("document.querySelector('#webgl-software-rendering button')?.click()")
    # those that have just come stand at the origin until a frame is drawn
    screen.wait_until(lambda: any(screen.node("/tool") or ()), "the arrows at the tool are drawn")
    x, y = arrow_px(screen, "/tool", ARROW_M)
    mouse = screen.page.mouse
    mouse.move(x, y)
    screen.pause(300)
    mouse.down()
    for step in range(1, 6):
        mouse.move(x + dx * step / 5, y + dy * step / 5)
        screen.pause(60)
    mouse.up()
    screen.pause(300)


def wait_for_ghost(screen: Screen, robot: Robot, q: NDArray[np.float64], ghost: str = NEXT) -> None:
    """Wait until the ghost's tool is where that of ``q`` (n,) [rad] is."""
    tip = 1000 * robot.forward(q)[:3, 3]

    def there() -> bool:
        shown = ghost_tip_mm(screen, ghost)
        return shown is not None and float(np.abs(shown - tip).max()) < 0.05

    screen.wait_until(there, f"the ghost's tool is at {tip.round(1).tolist()}")


def wait_for_no_ghost(screen: Screen, ghost: str = NEXT) -> None:
    screen.wait_until(lambda: ghost_tip_mm(screen, ghost) is None, "no ghost is shown")
