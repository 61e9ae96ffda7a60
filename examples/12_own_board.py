"""A board of your own, here simulated. Its package comes first: `pip install ./examples/extending`."""

from pathlib import Path

import armctl

with armctl.Arm.open(Path(__file__).parent / "extending" / "toy_arm.toml") as arm:
    arm.enable()
    arm.go_joints([30, 45])
    print("board:", arm.snapshot.board.kind)
    print("measured [°]:", *arm.measured_deg.round(1))
