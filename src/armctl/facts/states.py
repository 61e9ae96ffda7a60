"""The states of an arm, and what a command needs of them."""

from __future__ import annotations

from enum import Enum


class State(Enum):
    """The controller's states."""

    DISCONNECTED = "disconnected"
    OFF = "off"  # connected; nothing is sent, and where the arm is counts for nothing
    HOLDING = "holding"
    MOVING = "moving"
    PAUSED = "paused"
    FAULT = "fault"


class Need(Enum):
    """What a command needs of the arm; the controller and the buttons of the pages ask the same rule."""

    HOLDING = "holding"
    JOG = "holding, or jogged"
    PAUSE = "moving"
    GRIPPER = "enabled"
    OFF = "off"
    OFF_OR_HOLDING = "off or holding"
