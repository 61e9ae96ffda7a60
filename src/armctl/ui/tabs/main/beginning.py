"""What the tabs that make an arm say before one is begun: what each is for, and how it goes."""

from __future__ import annotations

from armctl.ui.widgets.html import steps_html

OWN_ARM = steps_html(
    "An arm that no file describes yet. It is drawn beside the present one while you describe it.",
    {
        "Lengths": "begin with a usual build, a copy or a table, and type what you measure",
        "Joints": "turn each one to both ends of its range, and keep them",
        "Save": "it is in the list Robot then, simulated or on your board",
    },
)
URDF_ARM = steps_html(
    "An arm that a URDF or xacro file describes. It is kept on the computer that armctl runs on.",
    {
        "Upload": "a .zip file with the URDF file and its meshes, or the URDF file first and then each mesh",
        "Answer": "where the file leaves something open, such as which link is the tool, you are asked",
        "Complete": "once it is open, its tool, rest pose and floor are typed here",
    },
)
