"""Arms from URDF files: the file's tree, its tool, its meshes, and what is said beside it."""

from armctl.robot.urdf.arm import load_urdf
from armctl.robot.urdf.elements import read_urdf_file
from armctl.robot.urdf.package import UrdfSource, side_path
from armctl.robot.urdf.side_file import (
    SIDE_SUFFIX,
    SideFile,
    changed_side_file,
    decode_side_file,
    encode_side_file,
    read_side_file,
)
from armctl.robot.urdf.tool import AXES, Wanted, argument_texts
from armctl.robot.urdf.unpacking import ARM_SUFFIXES, MESH_FILES, add_to_package, install_package
from armctl.robot.urdf.xacro_properties import Argument

__all__ = [
    "ARM_SUFFIXES",
    "AXES",
    "MESH_FILES",
    "SIDE_SUFFIX",
    "Argument",
    "SideFile",
    "UrdfSource",
    "Wanted",
    "add_to_package",
    "argument_texts",
    "changed_side_file",
    "decode_side_file",
    "encode_side_file",
    "install_package",
    "load_urdf",
    "read_side_file",
    "read_urdf_file",
    "side_path",
]
