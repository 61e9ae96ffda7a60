from __future__ import annotations

from armctl.program import (
    ArcStep,
    CommentStep,
    EndStep,
    GripperStep,
    LineStep,
    MoveStep,
    PointStep,
    RepeatStep,
    SpeedStep,
    Step,
    WaitStep,
)


def words(step: Step) -> tuple[str, str]:
    return step.title or step.kind, step.describe()


def test_steps_in_words() -> None:
    assert words(MoveStep(joints_deg=(0.0, 90.0, -80.256, -40.0, 0.0))) == ("pose", "0, 90, −80.26, −40, 0 °")
    assert words(MoveStep(joints_deg=(1.0,), duration_s=2)) == ("pose", "1 ° in 2 s")
    assert words(PointStep(x_mm=200.0, y_mm=-10.5, z_mm=100.0, pitch_deg=-30.0)) == (
        "point",
        "(200, −10.5, 100) mm, pitch −30°",
    )
    assert words(WaitStep(seconds=1.5)) == ("wait", "1.5 s")
    assert words(GripperStep(open_percent=40)) == ("gripper", "40 % open")
    quick = PointStep(x_mm=1, y_mm=2, z_mm=3, roll_deg=5, profile="s-curve", blend_mm=4, duration_s=2)
    assert words(quick) == ("point", "(1, 2, 3) mm, roll 5° in 2 s, s-curve, blend 4 mm")
    line = LineStep(x_mm=1, y_mm=2, z_mm=3, pitch="interpolated", pitch_deg=-45, speed_mm_s=20)
    assert words(line) == ("line", "(1, 2, 3) mm, pitch interpolated to −45°, 20 mm/s")
    arc = ArcStep(via_x_mm=4, via_y_mm=5, via_z_mm=6, x_mm=1, y_mm=2, z_mm=3, blend_mm=1)
    assert words(arc) == ("arc", "(1, 2, 3) mm via (4, 5, 6) mm, blend 1 mm")
    assert words(SpeedStep(percent=50)) == ("speed", "50 % from here on")
    assert words(RepeatStep(times=3)) == ("repeat", "3 times")
    assert words(EndStep()) == ("end", "of the repeat")
    assert words(CommentStep(note="x")) == ("#", "")
