"""The gripper's own motion: straight to its goal at its own speed."""

from __future__ import annotations

from armctl.errors import ArmctlError, StateError
from armctl.robot import Gripper
from armctl.runtime.ticket import Ticket


class GripperMover:
    """Opening towards a goal; a gripper whose opening is not known yet goes there in one step."""

    def __init__(self, gripper: Gripper | None) -> None:
        self._gripper = gripper
        self._opening: float | None = None
        self._goal: float | None = None
        self._ticket: Ticket | None = None
        self.held = False
        """stands still for as long as this is set (pause)"""

    @property
    def opening(self) -> float | None:
        """Last opening 0..1; None: not known."""
        return self._opening

    @property
    def moving(self) -> bool:
        """It has not arrived yet."""
        return self._goal is not None

    def set(self, opening: float | None) -> None:
        """It stands here (None: nobody knows)."""
        self._opening = opening
        self._goal = None

    def move_to(self, goal: float, ticket: Ticket | None = None) -> None:
        """Go to ``goal`` 0..1 instead of wherever it was going; ``ticket`` hears of the end."""
        self._refuse(StateError("a newer gripper command took its place"))
        self._goal, self._ticket = goal, ticket

    def stop(self, error: ArmctlError) -> None:
        """Stand where it is; ``error`` says why to whoever sent it."""
        self._goal = None
        self.held = False
        self._refuse(error)

    def settle(self) -> None:
        """Tell whoever sent it that it has arrived."""
        if self._ticket is not None and not self.moving:
            self._ticket.finish()
            self._ticket = None

    def advance(self, dt: float, speed: float) -> float | None:
        """Opening after ``dt`` seconds at a speed override; None where it stands."""
        goal = self._goal
        if goal is None or self._gripper is None or self.held:
            return None
        if self._opening is None:
            self._opening = goal
        else:
            most = self._gripper.speed * speed * dt
            self._opening += min(max(goal - self._opening, -most), most)
        if self._opening == goal:
            self._goal = None
        return self._opening

    def _refuse(self, error: ArmctlError) -> None:
        if self._ticket is not None:
            self._ticket.refuse(error)
            self._ticket = None
