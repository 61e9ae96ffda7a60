"""What an arm is, and the robot files that say so."""

from armctl.robot.body.arm_body import CarriedPart
from armctl.robot.deflection import Deflection
from armctl.robot.load import (
    hidden_robots,
    is_urdf,
    load_robot,
    robot_path,
    robot_title,
    robots_folder,
    says_no_board,
    shipped_robots,
    urdf_path,
    user_robots,
    user_robots_folder,
    with_argument,
)
from armctl.robot.outputs import FLATTEST_PER_DEG, OutputMap
from armctl.robot.parts import Gripper, Joint
from armctl.robot.robot import Robot

__all__ = [
    "FLATTEST_PER_DEG",
    "CarriedPart",
    "Deflection",
    "Gripper",
    "Joint",
    "OutputMap",
    "Robot",
    "hidden_robots",
    "is_urdf",
    "load_robot",
    "robot_path",
    "robot_title",
    "robots_folder",
    "says_no_board",
    "shipped_robots",
    "urdf_path",
    "user_robots",
    "user_robots_folder",
    "with_argument",
]
