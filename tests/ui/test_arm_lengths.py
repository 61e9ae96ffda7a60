"""Where the lengths of an arm in the making are written."""

from __future__ import annotations

import numpy as np
import pytest

from armctl.kinematics.samples import joint_samples
from armctl.robot.draft import BUILDS, Build, Draft
from armctl.ui.guard import GuardedServer
from armctl.ui.tabs.main.arm_lengths import LengthLabels, length_spans


def lengths_of(build: Build, more_mm: float = 7.0) -> dict[str, float]:
    return {one.key: one.usual_mm + more_mm for one in build.lengths}


@pytest.mark.parametrize("build", BUILDS, ids=lambda build: build.name)
def test_each_length_lies_on_its_link_in_every_pose(build: Build) -> None:
    lengths = lengths_of(build)
    robot = Draft.of_build("mine", "Mine", build, lengths).robot()
    for q in joint_samples(robot.limits, 10):
        spans = length_spans(build, lengths, robot, q)
        assert set(spans) == {one.key for one in build.lengths}
        for key, (start, end) in spans.items():
            assert 1000 * np.linalg.norm(end - start) == pytest.approx(lengths[key]), key
        assert spans["height"][0] == pytest.approx(np.zeros(3))
        assert spans["upper"][0] == pytest.approx(spans["ahead"][1])


def test_labels_follow_the_arm_and_its_lengths_and_one_of_nothing_is_left_out(server: GuardedServer) -> None:
    build = BUILDS[0]
    labels, lengths = LengthLabels(server.scene, "/new-arm"), lengths_of(build, 0.0)  # "ahead" is 0

    def show() -> dict[str, tuple[str, list[float]]]:
        robot = Draft.of_build("mine", "Mine", build, lengths).robot()
        labels.show(build, lengths, robot, np.zeros(robot.n))
        shown = vars(labels)["_labels"]
        return {key: (one.text, np.round(one.position, 4).tolist()) for key, one in shown.items()}

    assert show() == {
        "height": ("Height 80 mm", [0.0, 0.0, 0.04]),
        "upper": ("Upper arm 120 mm", [0.06, 0.0, 0.08]),
        "fore": ("Forearm 110 mm", [0.175, 0.0, 0.08]),
        "hand": ("Hand 90 mm", [0.275, 0.0, 0.08]),
    }
    anchors = [one.anchor for one in vars(labels)["_labels"].values()]
    assert anchors == ["center-right", "bottom-center", "top-center", "bottom-center"]  # no two in a row
    lengths["height"], lengths["upper"] = 0.0, 100.5
    now = show()
    assert "height" not in now and now["upper"] == ("Upper arm 100.5 mm", [0.0503, 0.0, 0.0])
    assert now["fore"] == ("Forearm 110 mm", [0.1555, 0.0, 0.0])
    labels.clear()
    assert vars(labels)["_labels"] == {}
