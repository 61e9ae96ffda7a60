"""The example in JavaScript moves the arm that ``armctl serve`` serves; and the API under TLS."""

from __future__ import annotations

import os
import re
import signal
import subprocess
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from tests.avr.building import NODE
from tests.browser.serving import serving
from tests.ui.tls_files import CERTIFICATE, KEY

import armctl
from armctl.errors import ArmctlError
from armctl.facts import State
from armctl.process import Link, registry
from armctl.process.lines import RemoteLine
from armctl.protocol import Connect, Enable, MoveJoints

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


@pytest.mark.parametrize("encrypted", [False, True], ids=["handed over", "relayed"])
def test_whoever_says_hello_starts_an_arm_process_again_that_was_killed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, encrypted: bool
) -> None:
    (tmp_path / "run").mkdir()
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path / "run"))
    words = ["--port", "sim"]
    if encrypted:
        certificate, key = tmp_path / "cert.pem", tmp_path / "key.pem"
        certificate.write_text(CERTIFICATE)
        key.write_text(KEY)
        monkeypatch.setenv("SSL_CERT_FILE", str(certificate))
        words += ["--tls-cert", str(certificate), "--tls-key", str(key)]
    folder = registry.runtime_folder()
    assert folder is not None
    with serving(tmp_path, *words) as link:
        with armctl.Arm.connect(link, name="before") as arm:
            arm.enable()
            ((_, note),) = registry.running(folder)
            os.kill(note.pid, signal.SIGKILL)
            with pytest.raises(ArmctlError):
                arm.go_joints([2, 110, -80, -70, 0])
        with closing(Link(RemoteLine(link, None), "after")) as after:
            assert after.snapshot.state is State.DISCONNECTED
            assert not after.snapshot.powered
            (other,) = [one.pid for _, one in registry.running(folder)]
            assert other != note.pid
            turned = after.robot.pose("rest") + np.radians([2, 0, 0, 0, 0])
            for command in (Connect("sim"), Enable(), MoveJoints(turned)):
                after.submit(command).result(20)
            assert after.snapshot.q_command == pytest.approx(turned)
        with armctl.Arm.connect(link, name="one more", watch=True) as arm:
            assert arm.snapshot.state is State.HOLDING
