"""The runtime: commands in, snapshots out."""

from armctl.runtime.board import channel_settings
from armctl.runtime.clock import Clock, ManualClock, MonotonicClock, wall_time
from armctl.runtime.commands import (
    ClearFault,
    Command,
    Connect,
    Disconnect,
    Enable,
    Follow,
    FollowTarget,
    HomeAxes,
    Jog,
    JogTool,
    MoveGripper,
    MoveJoints,
    MoveTo,
    Origin,
    Pause,
    Release,
    Resume,
    RunProgram,
    SetSpeed,
    UpdateProgram,
)
from armctl.runtime.controller import Controller
from armctl.runtime.planner import InlineExecutor
from armctl.runtime.snapshot import AxisHoming, Event, ProgramProgress, Snapshot, State
from armctl.runtime.ticket import Ticket

__all__ = [
    "AxisHoming",
    "ClearFault",
    "Clock",
    "Command",
    "Connect",
    "Controller",
    "Disconnect",
    "Enable",
    "Event",
    "Follow",
    "FollowTarget",
    "HomeAxes",
    "InlineExecutor",
    "Jog",
    "JogTool",
    "ManualClock",
    "MonotonicClock",
    "MoveGripper",
    "MoveJoints",
    "MoveTo",
    "Origin",
    "Pause",
    "ProgramProgress",
    "Release",
    "Resume",
    "RunProgram",
    "SetSpeed",
    "Snapshot",
    "State",
    "Ticket",
    "UpdateProgram",
    "channel_settings",
    "wall_time",
]
