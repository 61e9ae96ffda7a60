"""For processes that tests start: a busy machine may stand still, and no arm stops for that there.

Python imports this module when it starts. It waits for the runtime's monitor, and loads nothing itself.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from importlib.machinery import ModuleSpec, PathFinder
from types import ModuleType

_MONITOR = "armctl.runtime.monitor"
PATIENT_S = 30.0


class PatientMonitor:
    """Finds the monitor once, and gives it patience."""

    def find_spec(
        self, name: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        if name != _MONITOR or (spec := PathFinder.find_spec(name, path, target)) is None:
            return None
        assert spec.loader is not None
        run = spec.loader.exec_module

        def run_patiently(module: ModuleType) -> None:
            run(module)
            module.GAP_S = PATIENT_S  # type: ignore[attr-defined]

        spec.loader.exec_module = run_patiently  # type: ignore[method-assign]
        return spec


if "ARMCTL_REAL_GAP" not in os.environ:
    sys.meta_path.insert(0, PatientMonitor())  # type: ignore[arg-type]
