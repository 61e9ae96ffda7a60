"""Calibration: which output is which angle, joint by joint, and how well known points are met."""

from __future__ import annotations

from armctl.runtime import Snapshot
from armctl.ui.session import Session
from armctl.ui.tabs.calibration.joint import CalibrationGripper, CalibrationJoint
from armctl.ui.tabs.calibration.points import CalibrationPoints
from armctl.ui.tabs.calibration.save import CalibrationSave
from armctl.ui.tabs.calibration.shared_calibration import SharedCalibration
from armctl.ui.widgets.calibration_text import in_force_html
from armctl.ui.widgets.html import LiveHtml, muted

_NOTHING = "The robot file gives neither servos nor encoders: there is no output to calibrate."


class CalibrationScreen:
    """The joint to move on top; below it marks, gripper, saving and known points as inner tabs."""

    def __init__(self, session: Session) -> None:
        gui, desk = session.gui, session.shared(SharedCalibration)
        gap = "<div style='height:6px'></div>"
        LiveHtml(gui, in_force_html(desk.in_force, desk.board) + gap)
        self._parts: list[CalibrationJoint | CalibrationGripper | CalibrationSave | CalibrationPoints] = []
        if desk.work.robot.output_map is None:
            LiveHtml(gui, muted(_NOTHING))
            return
        tabs = gui.add_tab_group()
        with tabs.add_tab("Joints"):
            self._parts.append(CalibrationJoint(session))
        if desk.work.map.gripper_channel is not None:
            with tabs.add_tab("Gripper"):
                self._parts.append(CalibrationGripper(session))
        with tabs.add_tab("Save & test"):
            self._parts.append(CalibrationSave(session))
        with tabs.add_tab("Known points"):
            self._parts.append(CalibrationPoints(session))

    def refresh(self, snapshot: Snapshot) -> None:
        """Draw a snapshot."""
        for part in self._parts:
            part.refresh(snapshot)
