"""The Inverse screen as an operator uses it."""

from __future__ import annotations

import re
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import Locator, expect
from tests.browser.ghost_view import LOOKED_AT, wait_for_ghost, wait_for_no_ghost
from tests.browser.kit import Screen
from tests.browser.served_arm import HOME, ServedArm, served_arm

from armctl.kinematics import Target
from armctl.kinematics.frames import LinkFrames
from armctl.ui.tabs.inverse.answer import solve

pytestmark = pytest.mark.browser
TAB = "Inverse"
LEAST, SELECTED = "Go by least energy", "Go by the selected one"
POINT = [0.22, -0.196, 0.085]


@pytest.fixture
def solved(page: Screen) -> Screen:
    page.type_xyz("220", "-196", "85")
    page.click("Solve")
    page.wait_for_text("3520 solutions inside the limits")
    return page


def stands_at(page: Screen, served: ServedArm, q: np.ndarray) -> None:
    served.wait_for_deg(page, np.degrees(q).tolist(), within=1e-7)


def card(page: Screen, name: str) -> Locator:
    return page.page.get_by_role("option", name=name)


def is_chosen(page: Screen, name: str) -> bool:
    return card(page, name).get_attribute("aria-selected") == "true"


def test_another_way_is_one_click_or_one_key_away(solved: Screen, served: ServedArm) -> None:
    page, robot = solved, served.robot
    found = solve(robot, Target.of(POINT), "least-rotation", robot.pose("home"))
    up, down = (way.q for way in found.choices)
    assert is_chosen(page, "elbow up")
    page.screenshot("inverse-ways")
    card(page, "elbow down").click()
    page.wait_until(lambda: is_chosen(page, "elbow down"), "the card is chosen")
    wait_for_ghost(page, robot, down)
    page.page.keyboard.press("ArrowLeft")
    page.wait_until(lambda: is_chosen(page, "elbow up"), "the card before it is chosen")
    wait_for_ghost(page, robot, up)
    page.page.keyboard.press("End")
    page.wait_until(lambda: is_chosen(page, "elbow down"), "the last card is chosen")
    focused = page.page.evaluate("document.activeElement.dataset.key")
    assert focused.endswith(".1")  # the list was drawn anew, and the same card has the focus
    page.click(SELECTED)
    stands_at(page, served, down)


def test_go_in_the_line_is_the_first_step_that_leads_to_a_point(solved: Screen, served: ServedArm) -> None:
    page, robot = solved, served.robot
    step = page.page.locator(".armctl-first li", has_text="Inverse")
    page.click("Go")
    stands_at(page, served, solve(robot, Target.of(POINT), "least-rotation", robot.pose("home")).choices[0].q)
    page.open_tab("Main")
    expect(step).to_contain_text("✓")


def test_ways_come_back_with_a_page_that_is_loaded_again(solved: Screen, served: ServedArm) -> None:
    page = solved
    page.open(served.url, until="Enable")
    page.open_tab("Inverse")
    # nothing is solved yet, and no old way is shown
    expect(page.page.locator("armctl-part[name=ways]")).to_be_empty()
    page.type_xyz("220", "-196", "85")
    page.click("Solve")
    page.wait_until(lambda: card(page, "elbow down").count() == 1, "the ways are there")


def test_a_solution_is_selected_in_the_curve_or_the_list_and_gone_to(
    solved: Screen, served: ServedArm
) -> None:
    robot, page = served.robot, solved
    page.unfold("3520 solutions inside the limits", "Back to the least")
    for criterion, title in (
        ("least-rotation", "Sum of joint angles (°) as Shoulder turns"),
        ("least-travel", "Time that the joints turn (s) as Shoulder turns"),
    ):
        page.choose("Least energy is", criterion)
        page.wait_for_text(title)
    plot = page.page.locator("armctl-part[name=curve] .plot")
    plot.scroll_into_view_if_needed()
    page.screenshot("inverse-curve")
    expect(plot.locator("svg path:not(.grid, .mark)")).to_have_count(2)  # of two branches
    expect(plot.locator("svg .mark")).to_have_count(2)  # the least, and the selected one
    page.pause(300)  # the slider follows the graph
    least = page.number("On the curve °")
    box = plot.bounding_box()
    assert box is not None and box["width"] > 300
    plot.click(position={"x": box["width"] / 4, "y": 50})
    page.wait_for_text(re.compile("selected row [1-9]"))
    page.wait_until(
        lambda: abs(page.number("On the curve °") - least) > 1, "the click has selected another solution"
    )
    page.wait_for_text(re.compile(r"selected row (?!1:)"))
    page.click("Back to the least")
    page.wait_until(lambda: page.number("On the curve °") == least, "the least is selected again")
    page.choose("Least energy is", "least-rotation")
    page.wait_for_text("front elbow-up: 1760; front elbow-down: 1760")
    found = solve(robot, Target.of(POINT), "least-rotation", robot.pose("home"))
    assert found.best is not None
    wait_for_ghost(page, robot, found.best)
    page.screenshot("inverse-solved")
    page.wait_for_text(re.compile("page 1 of 235"))
    page.page.get_by_role("listbox", name="Solutions").get_by_role("option").nth(2).click()
    page.wait_for_text(re.compile("selected row 3: will go"))
    page.page.get_by_role("button", name="Shoulder °", exact=True).click()
    page.wait_for_text(re.compile("3520 solutions, by Shoulder"))
    page.page.get_by_role("button", name="#", exact=True).click()
    page.click("Back to the least")
    for button, shown in (("Next", 2), ("Last", 235), ("Next", 235), ("First", 1)):
        page.click(button)
        page.wait_for_text(re.compile(f"page {shown} of 235"))

    def wrist_is_drawn(row: int) -> bool:
        """Solutions of one point share the tool point, so the ghost's wrist is looked at."""
        shown = page.node("/ghost/link3")
        wrist = LinkFrames.at(robot.chain, found.q(row)[None]).origin[3][:, 0]
        return shown is not None and float(np.abs(np.array(shown) - wrist).max()) < 1e-5

    for row in (3520, 700, 3001):
        page.type_into("Row", str(row))
        page.wait_until(partial(wrist_is_drawn, row), f"the ghost shows row {row}")
    page.wait_for_text("selected row 3001: will go to θ = (")
    page.wait_for_text(re.compile("page 201 of 235"))
    assert served.commanded_deg == HOME  # nothing has moved the arm so far
    page.screenshot("inverse-selected")
    page.click(SELECTED)
    stands_at(page, served, found.q(3001))
    assert page.errors == []


def test_what_is_not_solved_or_not_listed_moves_nothing_and_what_is_solved_is_by_criterion_and_pitch(
    solved: Screen, served: ServedArm
) -> None:
    page = solved
    page.unfold("3520 solutions inside the limits", "Back to the least")
    for row in ("0", "-4", "3521", "99999999"):
        page.type_into("Row", row)
        page.wait_for_text("No row is selected; type a row from 1 to 3520.")
        page.wait_until(lambda: not page.is_enabled(SELECTED), "the button is off")
    for typed in ("", "nan", "inf", "abc", "1e300"):
        page.entry("Y mm").fill(typed)
        page.pause(300)
        page.click(LEAST)
        page.wait_for_notification(re.compile("Y mm"))
    page.type_into("Y mm", "-196")
    page.type_into("X mm", "200")
    page.wait_for_text("The fields have changed: press Solve. Go by least energy solves them first.")
    page.wait_until(lambda: not page.is_enabled(SELECTED), "the button is off")
    assert served.commanded_deg == HOME
    page.click(LEAST)  # uses what the fields show, not what was solved
    stands_at(page, served, served.robot.inverse([0.2, -0.196, 0.085]).best("least-rotation"))

    page.type_xyz("220", "-196", "85")
    page.choose("Least energy is", "published")
    page.wait_for_text(re.compile("tables of the Uzuner paper"))
    page.click("Solve")
    page.wait_for_text(re.compile("−42.402, 14.400, −45.909, −1.305"))
    page.click(LEAST)
    stands_at(page, served, served.robot.inverse(POINT).best("published"))
    wait_for_no_ghost(page)

    robot = served.robot
    pitch, _ = robot.inverse_kinematics.pitch_and_roll(robot.pose("rest"))
    assert pitch is not None
    x, y, z = (1000 * robot.forward(robot.pose("rest"))[:3, 3]).tolist()
    page.type_xyz(f"{x:.6f}", f"{y:.6f}", f"{z:.6f}")
    page.tick("Use pitch")
    page.tick("Use roll")
    page.type_into("Pitch °", f"{np.degrees(pitch):.6f}")
    page.type_into("Roll °", "12")
    page.click("Solve")
    page.wait_for_text("1 solution inside the limits")
    page.click(LEAST)
    served.wait_for_deg(page, [0.0, 110.0, -80.0, -70.0, 12.0])
    page.wait_for_text(re.compile("No joint is free here"))


def test_a_target_is_dragged_and_an_unreachable_one_says_why_and_offers_the_nearest(
    page: Screen, served: ServedArm
) -> None:
    page.dismiss_graphics_warning()
    page.click("present position")
    page.tick("Show target")
    page.type_xyz("200", "0", "150")
    page.wait_until(
        lambda: page.node("/inverse_target") == pytest.approx([0.2, 0.0, 0.15]),
        "the target has followed the fields",
    )
    page.pause(500)
    page.screenshot("inverse-target")
    drag_upwards(page)
    page.wait_until(lambda: page.number("Z mm") > 155, "the drag has filled Z")
    page.wait_for_text(re.compile(r"solutions inside the limits"))
    assert served.commanded_deg == HOME
    assert page.number("X mm") == 200
    page.tick("Show target", on=False)

    robot = served.robot
    page.type_xyz("300", "0", "600")
    page.click("Solve")
    page.wait_for_text("No solution")
    page.wait_for_text(re.compile(r"Too far by 200\.\d mm.*nearest reachable point is \("))
    nearest = robot.inverse([0.3, 0, 0.6])
    assert nearest.nearest_q is not None and nearest.nearest_m is not None
    wait_for_ghost(page, robot, nearest.nearest_q, LOOKED_AT)
    page.screenshot("inverse-unreachable")
    assert not page.is_enabled(SELECTED)
    page.wait_until(lambda: not page.is_enabled(LEAST), "nor can it go by least energy")
    assert served.commanded_deg == HOME
    page.click("Take nearest point")
    page.wait_for_text(re.compile(r"solutions? inside the limits"))
    assert page.number("X mm") == pytest.approx(1000 * nearest.nearest_m[0], abs=1e-3)
    page.click(LEAST)
    page.wait_until(
        lambda: bool(np.abs(robot.forward(served.now.q_command)[:3, 3] - nearest.nearest_m).max() < 1e-6),
        "the arm is at the nearest point",
    )


def drag_upwards(page: Screen) -> None:
    """Take the target's z arrow where the page draws it, and pull."""
    at = page.page.evaluate(
        """() => {
          const node = window.__viserMutable.nodeRefFromName['/inverse_target'];
          const camera = window.__viserMutable.camera, canvas = window.__viserMutable.canvas;
          const at = node.getWorldPosition(node.position.clone());
          const project = height => {
            const p = at.clone(); p.y += height;
            p.project(camera);
            const box = canvas.getBoundingClientRect();
            return [box.x + (p.x + 1) / 2 * box.width, box.y + (1 - p.y) / 2 * box.height];
          };
          return [project(0.06), project(0.12)];
        }"""
    )
    (x0, y0), (x1, y1) = at
    mouse = page.page.mouse
    mouse.move(x0, y0)
    page.pause(300)
    mouse.down()
    page.pause(100)
    for share in (0.25, 0.5, 0.75, 1.0):
        mouse.move(x0 + share * (x1 - x0), y0 + share * (y1 - y0))
        page.pause(120)
    mouse.up()
    page.pause()


def branch_tips_mm(page: Screen, served: ServedArm) -> np.ndarray:
    """Where the tools of the branch ghosts are drawn (k, 3) [mm]."""
    tips = (page.node(f"/branches/{i}/tool") for i in range(3))
    return 1000 * np.array([tip for tip in tips if tip is not None])


def two_ghosts_at(page: Screen, served: ServedArm, point_mm: list[float]) -> None:
    def there() -> bool:
        tips = branch_tips_mm(page, served)
        return len(tips) == 2 and float(np.abs(tips - point_mm).max()) < 1e-3

    page.wait_until(there, f"two branch ghosts reach {point_mm}")


def test_both_solutions_of_the_lab_sheet_side_by_side_and_why_one_is_refused(
    screen: Screen, tmp_path: Path
) -> None:
    with served_arm(tmp_path, "mico") as served:
        screen.open(served.url, until="Enable")
        screen.open_tab("Inverse")
        screen.type_xyz("0", "0", "700")
        screen.click("Solve")
        screen.unfold("Branches", "Solve")
        screen.wait_for_text("−131.63")
        screen.wait_for_text("−48.37")
        screen.wait_for_text("1 is chosen among the possible ones: the least energy by least-rotation.")
        screen.tick("Show as ghosts")
        screen.wait_for_text("In the 3D view green is the branch of least energy")
        two_ghosts_at(screen, served, [0, 0, 700])
        screen.screenshot("inverse-branches-mico")
        best = served.robot.inverse([0.0, 0.0, 0.7]).best("least-rotation")
        wait_for_ghost(screen, served.robot, best)  # the next pose is drawn beside them
        screen.type_xyz("300", "0", "100")
        screen.click("Solve")
        screen.wait_for_text("2 is refused: Shoulder needs 82.14°, its limits are −220.00° … 40.00°.")
        two_ghosts_at(screen, served, [300, 0, 100])
        screen.type_xyz("500", "0", "700")
        screen.click("Solve")
        screen.wait_for_text(re.compile("Too far by 82.6 mm"))
        screen.wait_until(lambda: len(branch_tips_mm(screen, served)) == 0, "no branch ghost is left")
        screen.wait_until(lambda: not screen.is_enabled(SELECTED), "nothing can be gone to")
