"""Simulation: the motion drawn while it runs, and rehearsed without the arm."""

from __future__ import annotations

from armctl.runtime import Snapshot
from armctl.ui.session import Session
from armctl.ui.tabs.simulation.joint_graph import ALL, JointGraph
from armctl.ui.tabs.simulation.live_target import LiveTarget
from armctl.ui.tabs.simulation.trail import Trail, TrailLine
from armctl.ui.tabs.simulation.twin import TwinControl
from armctl.ui.tabs.simulation.workspace import WorkspaceView


class SimulationScreen:
    """Live target, twin, tool trail, joint graphs and workspace cloud; each page has its own."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self._robot = session.console.robot
        gui = session.gui
        with gui.add_folder("Live target"):
            self._live = LiveTarget(session)
        with gui.add_folder("Twin"):
            self._twin = TwinControl(session)
        with gui.add_folder("Joint graph"):
            titles = tuple(joint.title for joint in self._robot.joints)
            self._joint = gui.add_dropdown("Show", (ALL, *titles), initial_value=ALL)
            self._graph_box = gui.add_folder(None)
            with self._graph_box:
                self._graph = JointGraph(gui, self._robot)
        with gui.add_folder("In the 3D view"):
            self._add_view()
        session.on(self._joint.on_update, self._on_joint)

    def refresh(self, snapshot: Snapshot) -> None:
        """Draw a snapshot."""
        self._live.refresh(snapshot)
        self._twin.refresh(snapshot)
        self._graph.add(snapshot, self._session.console.last_known.standing(snapshot))
        self._line.show(self._trail.value)
        if self._trail.value:
            self._line.draw()
        self._workspace.refresh(snapshot)

    def _add_view(self) -> None:
        gui, session = self._session.gui, self._session
        self._trail = gui.add_checkbox("Tool trail", initial_value=True)
        self._clear = gui.add_button_group("Trail so far", ("Clear trail",))
        self._line = TrailLine(session.client.scene, session.shared(Trail))
        self._workspace = WorkspaceView(session)
        session.on(self._clear.on_click, self._on_clear)

    async def _on_joint(self) -> None:
        titles = [joint.title for joint in self._robot.joints]
        chosen = self._joint.value
        with self._graph_box:
            self._graph.choose(None if chosen == ALL else titles.index(chosen))

    async def _on_clear(self) -> None:
        self._line.clear()
