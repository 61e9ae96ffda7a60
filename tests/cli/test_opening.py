"""What the command line says while an arm with meshes is opened."""

from __future__ import annotations

import pytest

from armctl.cli.options import MeshProgress
from armctl.errors import StoppedError


def test_work_on_meshes_is_told_from_a_third_of_a_second_on(capsys: pytest.CaptureFixture[str]) -> None:
    clock = iter([5.0, 5.1, 5.2, 5.29, 5.31, 5.4, 6.0])
    progress = MeshProgress("KR 3", now=lambda: next(clock))
    for _ in range(3):
        progress(0, 9)
    assert capsys.readouterr() == ("", "")
    for _ in range(3):
        progress(3, 9)
    progress.end()
    out, err = capsys.readouterr()
    assert out == ""
    assert err.count("reading the meshes of KR 3") == err.count("\n") == 1


def test_it_ends_when_nobody_waits_any_more() -> None:
    over = False
    progress = MeshProgress("KR 3", lambda: over)
    progress(0, 9)
    over = True
    with pytest.raises(StoppedError, match="KR 3 is not opened"):
        progress(1, 9)
