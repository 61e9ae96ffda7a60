"""The example in JavaScript moves the arm that ``armctl serve`` serves; and the API under TLS."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import pytest
from tests.avr.building import NODE
from tests.browser.serving import serving
from tests.ui.tls_files import CERTIFICATE, KEY

import armctl
from armctl.runtime import State

EXAMPLE = Path(__file__).parent.parent / "examples/api_client.js"


def test_the_example_in_javascript_moves_the_arm(tmp_path: Path) -> None:
    with serving(tmp_path, "--port", "sim") as link:
        words = [NODE, str(EXAMPLE), link]
        done = subprocess.run(words, capture_output=True, text=True, timeout=60, check=False)
        assert done.returncode == 0, done.stderr
        at, state = done.stdout.splitlines()
        assert state == "holding"
        with armctl.Arm.connect(link) as arm:
            assert arm.snapshot.state is State.HOLDING
            joints = [0.0, *map(float, at.split()[2:])]
            assert arm.joints_deg.tolist() == pytest.approx(joints, abs=0.01)
        wrong = [*words[:-1], re.sub("token=.*", "token=wrong", link)]
        done = subprocess.run(wrong, capture_output=True, text=True, timeout=60, check=False)
        assert done.returncode == 1
        assert "Traceback" not in done.stderr


def test_under_tls_records_are_relayed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    certificate, key = tmp_path / "cert.pem", tmp_path / "key.pem"
    certificate.write_text(CERTIFICATE)
    key.write_text(KEY)
    monkeypatch.setenv("SSL_CERT_FILE", str(certificate))
    words = ("--port", "sim", "--tls-cert", str(certificate), "--tls-key", str(key))
    with serving(tmp_path, *words) as link, armctl.Arm.connect(link, name="far") as arm:
        arm.enable()
        arm.go_joints([2, 110, -80, -70, 0])
        assert arm.joints_deg[0] == pytest.approx(2)
        assert arm.snapshot.control.operator is not None
        assert arm.snapshot.control.operator.name == "far"
