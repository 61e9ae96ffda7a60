"""Manual: each joint alone, jog, gripper, and serial motion."""

from __future__ import annotations

from armctl.protocol import Snapshot
from armctl.ui.session import Session
from armctl.ui.tabs.manual.jog import JogControl
from armctl.ui.tabs.manual.joints import JointControl
from armctl.ui.tabs.manual.live_readout import LiveReadout
from armctl.ui.tabs.manual.serial_motion import SerialMotion


class ManualScreen:
    """Three inner tabs, so that each fits a laptop's screen."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self._readout = LiveReadout(session.console.robot)
        tabs = session.gui.add_tab_group()
        with tabs.add_tab("Joints"):
            self._readout.add_to(session.gui)
            self._joints = JointControl(session)
        with tabs.add_tab("Jog" if session.console.robot.gripper is None else "Jog & gripper"):
            self._readout.add_to(session.gui)
            self._jog = JogControl(session)
        with tabs.add_tab("Serial motion"):
            self._serial = SerialMotion(session)

    def refresh(self, snapshot: Snapshot) -> None:
        """Draw a snapshot."""
        if self._session.sees("Manual"):
            self._readout.refresh(snapshot)
        self._joints.refresh(snapshot)
        self._jog.refresh(snapshot)
        self._serial.refresh(snapshot)
