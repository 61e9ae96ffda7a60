"""Simulation: the motion drawn while it runs, and rehearsed without the arm."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

import viser

from armctl.runtime import Snapshot
from armctl.ui.scene.cloud import COLOURINGS, CloudFigure
from armctl.ui.scene.trail import TrailLine
from armctl.ui.screens.twin_control import TwinControl
from armctl.ui.widgets.joint_graph import ALL, JointGraph
from armctl.ui.widgets.text import LiveHtml

if TYPE_CHECKING:
    from armctl.ui.session import Session

_LEGEND = "Solid: commanded. Dotted: as the board tells it."


class SimulationScreen:
    """Twin, tool trail, joint graphs and workspace cloud; each page has its own."""

    label: ClassVar[str] = "Simulation"
    icon: ClassVar[viser.IconName | None] = None

    def __init__(self, session: Session) -> None:
        self._session = session
        self._robot = session.console.robot
        gui = session.gui
        with gui.add_folder("Twin"):
            self._twin = TwinControl(session)
        with gui.add_folder("Joint graph"):
            titles = tuple(joint.title for joint in self._robot.joints)
            self._joint = gui.add_dropdown("Show", (ALL, *titles), initial_value=ALL)
            LiveHtml(gui, _LEGEND)
            self._graph_box = gui.add_folder(None)
            with self._graph_box:
                self._graph = JointGraph(gui, self._robot)
        with gui.add_folder("In the 3D view"):
            self._add_view()
        session.on(self._joint.on_update, self._on_joint)

    def refresh(self, snapshot: Snapshot) -> None:
        """Draw a snapshot."""
        self._twin.refresh(snapshot)
        self._graph.add(snapshot)
        self._line.show(self._trail.value)
        if self._trail.value:
            self._line.draw()

    def _add_view(self) -> None:
        gui, session = self._session.gui, self._session
        self._trail = gui.add_checkbox("Tool trail", initial_value=True)
        self._clear = gui.add_button_group("Trail so far", ("Clear trail",))
        self._line = TrailLine(session.client.scene, session.console.trail)
        self._cloud = gui.add_checkbox(
            "Workspace", initial_value=False, hint="Where the tool point can be: a cloud of reachable points."
        )
        self._colour = gui.add_dropdown("Coloured by", COLOURINGS, initial_value=COLOURINGS[0], visible=False)
        self._cloud_text = LiveHtml(gui)
        self._cloud_text.visible = False
        self._cloud_figure = CloudFigure(session.client.scene)
        session.on(self._clear.on_click, self._on_clear)
        session.on(self._cloud.on_update, self._on_cloud)
        session.on(self._colour.on_update, self._on_cloud)

    async def _on_joint(self) -> None:
        titles = [joint.title for joint in self._robot.joints]
        chosen = self._joint.value
        with self._graph_box:
            self._graph.choose(None if chosen == ALL else titles.index(chosen))

    async def _on_clear(self) -> None:
        self._line.clear()

    async def _on_cloud(self) -> None:
        shown = self._cloud.value
        self._colour.visible = self._cloud_text.visible = shown
        if not shown:
            self._cloud_figure.hide()
            return
        self._cloud_text.show("Computing …")
        cloud = await self._session.console.clouds.get(self._robot)
        if self._cloud.value:  # not switched off meanwhile
            self._cloud_figure.show(cloud, self._colour.value)
            self._cloud_text.show(
                f"{len(cloud.points)} tool points of random poses inside the joint limits and above the "
                f"floor. {_KEYS[self._colour.value]}"
            )


_KEYS = {
    "height": "Dark is low, yellow is high.",
    "manipulability": "Yellow: the tool moves freely. Dark: near a singularity.",
}
