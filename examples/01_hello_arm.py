"""Hello arm: enable the simulated board, put the tool on a point, ask where it is."""

import armctl

with armctl.Arm.open("uzuner") as arm:  # without a port: the simulated board
    arm.enable()
    print("joints [°]:", *arm.joints_deg.round(1))
    arm.go(x_mm=200, y_mm=0, z_mm=100)
    x, y, z = arm.position_mm
    print(f"tool at x {x:z.1f}, y {y:z.1f}, z {z:z.1f} mm")
    arm.go_pose("home")
    print("joints [°]:", *arm.joints_deg.round(1))
