"""`armctl serve` in a process of its own: what it prints, and who gets in by it."""

from __future__ import annotations

import http.client
from pathlib import Path
from urllib.parse import urlsplit

import pytest
from tests.browser.serving import serving

from armctl.cli.main import REFUSED, WRONG_USAGE, run
from armctl.cli.serve import stored_token


@pytest.mark.parametrize(
    ("words", "warnings"), [((), 0), (("--host", "0.0.0.0", "--allow-host", "arm.lab"), 1)]
)
def test_the_printed_link_lets_in_and_is_shown_again(
    tmp_path: Path,
    words: tuple[str, ...],
    warnings: int,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    (tmp_path / "run").mkdir()
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path / "run"))
    with serving(tmp_path, *words) as link:
        address = urlsplit(link)
        assert address.port is not None
        statuses: list[int] = []
        for path in ("/", f"/?{address.query}"):
            connection = http.client.HTTPConnection("127.0.0.1", address.port, timeout=10)
            connection.request("GET", path, headers={"Host": address.netloc})
            statuses.append(connection.getresponse().status)
            connection.close()
        assert statuses == [401, 302]
        assert ("arm.lab" in link) is ("arm.lab" in words)
        if not words:  # started once more: the link is shown again, to this user alone
            monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
            (file,) = (tmp_path / "armctl").glob("link-*")
            assert file.stat().st_mode & 0o777 == 0o600
            assert run(("serve", "--no-browser", "--http-port", str(address.port))) == REFUSED
            assert "is in use by another program (another armctl?)" in (err := capsys.readouterr().err)
            assert f"The armctl that runs there is at {link} " in err
    assert list((tmp_path / "armctl").glob("link-*")) == []
    assert list((tmp_path / "run" / "armctl").iterdir()) == []  # no arm process is left
    assert (tmp_path / "stderr").read_text().count("the connection is not encrypted") == warnings


def test_a_stored_token_is_used_where_nobody_else_can_have_read_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    (folder := tmp_path / "armctl").mkdir()
    file, kept = folder / "token-8080", "k" * 32
    assert stored_token(8080, new=False) != stored_token(8080, new=False)  # nothing is stored
    file.write_text(kept)
    file.chmod(0o600)
    assert stored_token(8080, new=False) == kept
    assert kept not in (stored_token(8081, new=False), stored_token(8080, new=True))
    file.chmod(0o640)
    assert stored_token(8080, new=False) != kept
    file.chmod(0o600)
    for useless in ("short", "k" * 20 + " ", "é" * 32):
        file.write_text(useless)
        assert stored_token(8080, new=False) != useless
    file.unlink()
    (folder / "elsewhere").write_text(kept)
    file.symlink_to(folder / "elsewhere")
    assert stored_token(8080, new=False) != kept


def test_a_new_link_without_token_is_a_contradiction() -> None:
    assert run(("serve", "--no-token", "--new-link")) == WRONG_USAGE
