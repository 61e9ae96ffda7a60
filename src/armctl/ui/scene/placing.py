"""Making sure that a page draws a new node where it is."""

from __future__ import annotations

import numpy as np
import viser


def send_pose(node: viser.SceneNodeHandle) -> None:
    """Send a new node's pose even where it is the one that nodes begin with.

    viser sends no pose that equals the present one, and a page keeps the pose of a node that is removed and
    made again under the same name in one go: the new node would stand where the old one stood.
    """
    position, wxyz = node.position.copy(), node.wxyz.copy()
    node.position, node.wxyz = position + 1.0, np.roll(wxyz, 1)
    node.position, node.wxyz = position, wxyz
