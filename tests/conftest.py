from __future__ import annotations

import gc
import logging
import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from hypothesis import HealthCheck, settings
from tests.long import examples

from armctl.runtime import monitor

if TYPE_CHECKING:
    from collections.abc import Iterator

    from xdist.remote import Producer
    from xdist.scheduler import LoadScopeScheduling
    from xdist.workermanage import WorkerController

# The same examples in every run, and no time limit for them: a busy computer proves nothing wrong.
settings.register_profile(
    "suite",
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.too_slow],
    max_examples=examples(100),
)
settings.load_profile("suite")

REAL_GAP_S = monitor.GAP_S


ON_REAL_TIME = (
    *("browser", "process", "cli", "avr", "examples"),
    *("test_api_example.py", "test_blocks.py", "test_wheel.py"),
    *("test_kill.py", "test_page.py", "test_tab.py"),
)
"""tests that other processes and a real clock take part in: on a machine that is busy, one may come late"""


BROWSER = "tests/browser/"
SHARED_OUT = ("faults/test_table.py",)
"""files of which one worker would have work for minutes"""
LONG_WAITS = ("test_wheel.py", "test_notebooks.py")
"""tests that wait for long while the processor is free: they do not come last, when nothing else is left"""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """What fails on real time is tried once more, and told at the end; what fails twice, fails."""
    items.sort(key=lambda item: item.path.name not in LONG_WAITS)
    for item in items:
        if set(ON_REAL_TIME) & set(item.path.relative_to(Path(__file__).parent).parts):
            item.add_marker(pytest.mark.flaky(reruns=1))


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Say why each test was tried again: a rerun hides a race."""
    for report in terminalreporter.stats.get("rerun", []):
        why = [line for line in report.longreprtext.splitlines() if line.startswith("E  ")][:3]
        terminalreporter.write_line(f"why {report.nodeid.rpartition('::')[2]} was tried again:")
        terminalreporter.write_line("\n".join(why) or report.longreprtext[-300:])


def pytest_collection_finish() -> None:
    """What is there now stays: the collector does not look through thousands of tests again and again."""
    gc.collect()
    gc.freeze()


@pytest.hookimpl(optionalhook=True)  # only where tests are shared out among workers
def pytest_xdist_make_scheduler(config: pytest.Config, log: Producer) -> LoadScopeScheduling:
    """Two workers drive a browser each and mostly wait for it; the others do the rest, and all what is left.

    The tests of a file stay together: what they share is made once. Those of a long file are shared out.
    """
    from xdist.scheduler import LoadScopeScheduling

    config.option.loadscopereorder = False  # they come as they were sorted

    class TwoBrowsers(LoadScopeScheduling):
        def _split_scope(self, nodeid: str) -> str:
            file = nodeid.partition("::")[0]
            return nodeid if file.endswith(SHARED_OUT) else file

        def _assign_work_unit(self, node: WorkerController) -> None:
            browses = node in self.nodes[:2]
            mine = next((one for one in self.workqueue if one.startswith(BROWSER) == browses), None)
            if mine is not None:  # else nothing else is left
                self.workqueue.move_to_end(mine, last=False)
            super()._assign_work_unit(node)

        def mark_test_complete(self, node: WorkerController, item_index: int, duration: float = 0) -> None:
            super().mark_test_complete(node, item_index, duration)
            done = self.assigned_work[node]
            for scope in [scope for scope, tests in done.items() if all(tests.values())]:
                del done[scope]  # else thousands are counted again after each test

    return TwoBrowsers(config, log)


@pytest.fixture(scope="session", autouse=True)
def nobodys_settings(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Whatever the user of this computer has calibrated is left alone, and changes no test."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CONFIG_HOME", str(tmp_path_factory.mktemp("settings")))
        patch.setenv("XDG_STATE_HOME", str(tmp_path_factory.mktemp("state")))
        patch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.mktemp("cache")))
        patch.setenv("LC_ALL", "C.UTF-8")
        yield


@pytest.fixture(scope="session", autouse=True)
def a_busy_machine_may_stand_still() -> Iterator[None]:
    """Three workers on two cores stand still for half a second now and then; no arm stops for that here.

    This holds for controllers in the tests' own process, and in those that they start (``tests/patient``).
    The tests of the runtime and of faults keep the real limit: their clock is a manual one (``real_gap``).
    """
    patient = str(Path(__file__).with_name("patient"))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(monitor, "GAP_S", 30.0)
        patch.setattr(sys, "path", [*sys.path, patient])  # an arm process looks where we look
        patch.setenv("PYTHONPATH", patient, prepend=os.pathsep)
        yield


class _Defects(logging.Handler):
    def __init__(self) -> None:
        super().__init__(logging.ERROR)
        self.logged: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        if record.exc_info and record.name.startswith("armctl"):
            self.logged.append(logging.Formatter().format(record))


@pytest.fixture(autouse=True)
def no_defect_is_only_logged(request: pytest.FixtureRequest) -> Iterator[None]:
    """What is caught so that the arm and its pages go on is a defect all the same, and no test misses it."""
    defects = _Defects()
    logging.getLogger().addHandler(defects)
    yield
    logging.getLogger().removeHandler(defects)
    expected = request.node.get_closest_marker("logs_a_defect") is not None
    assert expected or not defects.logged, defects.logged[0]


@pytest.fixture
def real_gap(monkeypatch: pytest.MonkeyPatch) -> None:
    """The time without a tick after which nothing goes on by itself, as it is in the product."""
    monkeypatch.setattr(monitor, "GAP_S", REAL_GAP_S)
