"""What an arm is, and the robot files that say so."""

from armctl.robot.load import load_robot, robots_folder, shipped_robots
from armctl.robot.robot import Gripper, Joint, Robot
from armctl.robot.servo_map import ServoMap

__all__ = ["Gripper", "Joint", "Robot", "ServoMap", "load_robot", "robots_folder", "shipped_robots"]
