"""The log of a page: which lines are shown, how, and as a file."""

from __future__ import annotations

import csv
from dataclasses import dataclass, field

from tests.ui.page_kit import FakePage

from armctl.protocol import TIMING, Event
from armctl.robot import load_robot
from armctl.ui.guard import GuardedServer
from armctl.ui.tabs.log import LogScreen, as_csv, lines_html

ROBOT = load_robot("uzuner")
DAY_S = 86_400
EVENTS = (
    Event(DAY_S, "info", "connected to <a board>"),
    Event(3 * DAY_S, "warning", "the controller was 80 ms late", TIMING),
    Event(3 * DAY_S + 1, "warning", "base by -3.0°"),
    Event(3 * DAY_S + 2, "error", "the line is gone"),
)


@dataclass
class LogPage(FakePage):
    server: GuardedServer
    files: dict[str, str] = field(default_factory=dict[str, str])

    def __post_init__(self) -> None:
        super().__init__(self.server, ROBOT, ROBOT.pose("home"))
        self.console.earlier, self.snapshot.events = EVENTS[:1], EVENTS[1:]
        self.log = LogScreen(self.session)
        self._handles["Show"] = self.log._which

    def download(self, name: str, content: str) -> None:
        self.files[name] = content

    def show(self, which: str | None = None) -> str:
        if which is not None:
            self._handles["Show"].value = which
        self.refresh(self.log)
        return self.html


def test_lateness_is_hidden_until_it_is_asked_for(server: GuardedServer) -> None:
    page = LogPage(server)
    usual = page.show()
    assert "80 ms late" not in usual and "1 line not shown" in usual
    assert usual.index("the line is gone") < usual.index("base by −3.0°") < usual.index("connected to")
    assert "80 ms late" in page.show("everything") and "not shown" not in page.html
    grave = page.show("warnings and errors")
    assert "80 ms late" in grave and "connected" not in grave


def test_words_are_escaped_and_each_day_has_its_date(server: GuardedServer) -> None:
    html = lines_html(EVENTS)
    assert "connected to &lt;a board&gt;" in html
    assert html.count("January") == 2  # of 1970
    assert "aria-label='error'" in html and lines_html(()).count("Nothing yet") == 1


def test_the_whole_log_is_a_table_oldest_first(server: GuardedServer) -> None:
    page = LogPage(server)
    page.press("Download log")
    rows = list(csv.DictReader(page.files["log.csv"].splitlines()))
    assert [row["text"] for row in rows] == [event.text for event in EVENTS]
    assert [row["about"] for row in rows] == ["", TIMING, "", ""]
    assert page.files["log.csv"] == as_csv(EVENTS)
