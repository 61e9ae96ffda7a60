"""What users install: the wheel that is built from the source archive, in an environment of its own."""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
import sys
import sysconfig
import zipfile
from pathlib import Path
from urllib.parse import urljoin
from urllib.request import HTTPCookieProcessor, build_opener

import pytest
from tests.browser.serving import serving
from tests.docs.pages import blocks

import armctl
from armctl.errors import DOCS
from armctl.ui.docs import ServedDocs, page_of
from armctl.ui.docs.where import source_of

ROOT = Path(__file__).parents[1]
NETWORK = "needs the network"
"""title of the blocks of docs/install.md that are carried out here, without the network"""
OTHERS = {
    "python": """case "$1 $2" in
        "-m build") exec "$PYTHON" "$@" --no-isolation --outdir "$DIST" ;;
        "-m pip") shift 2; exec "$PYTHON" -m pip --python "$TARGET" "$@" ;;
        esac; exit 2""",
    "pipx": '[ "$#" = 2 ] && [ "$1" = install ] && exec "$PYTHON" -m pip install --target pipx "$2"',
    "uvx": """[ "$#" = 3 ] && [ "$1" = --from ] && "$PYTHON" -m pip install --target uvx "$2" \\
        && PYTHONPATH=uvx exec "uvx/bin/$3" --version""",
}
"""what stands for programs that may be absent, or would download: pip installs, from files that are there"""
SHELVES = (".pyenv/versions/*/bin", ".local/share/uv/python/*/bin")


def interpreters() -> list[str]:
    """This Python; in a long run also the others that can be found, with all that armctl needs downloaded."""
    if not os.environ.get("ARMCTL_LONG"):
        return [sys.executable]
    names = [f"python3.{minor}" for minor in range(11, 20) if minor != sys.version_info.minor]
    shelves = [str(one) for place in SHELVES for one in Path.home().glob(place)]
    shelves += os.get_exec_path()  # last: pyenv's shims in it start nothing by themselves
    found = [shutil.which(name, path=os.pathsep.join(shelves)) for name in names]
    return [sys.executable, *(one for one in found if one is not None)]


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Built as it is released: the archive from the checkout, the wheel from the archive."""
    folder = tmp_path_factory.mktemp("release") / "dist"
    with_page(0, folder, ROOT, sys.executable)
    (archive,), (wheel,) = folder.glob("*.tar.gz"), folder.glob("*.whl")
    assert archive.name.endswith(f"-{armctl.__version__}.tar.gz")
    return wheel


def with_page(number: int, dist: Path, folder: Path, target: str, **settings: str) -> str:
    """Carry out a block of docs/install.md in a folder; gives what it prints."""
    block = [one for one in blocks(ROOT / "docs" / "install.md") if one.title == NETWORK][number]
    block = block._replace(text=block.text.replace("/path/to", str(dist)))
    known = {"PYTHON": sys.executable, "TARGET": target, "DIST": str(dist), "PIP_NO_INDEX": "1"}
    return block.run(dist.parent / "programs", OTHERS, folder, **known, **settings)


def done(*words: str, python: str | Path = sys.executable) -> str:
    """What a Python prints; it must end well. It finds nothing but what is installed where it is."""
    clean = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
    run = subprocess.run([python, *words], capture_output=True, text=True, env=clean, cwd="/", check=False)
    assert run.returncode == 0, run.stdout + run.stderr
    return run.stdout


def installed(wheel: Path, python: str, folder: Path) -> Path:
    """A new environment with the wheel and what it needs; this one's packages serve it, too."""
    own = python == sys.executable
    done("-m", "venv", *(["--without-pip"] if own else []), str(folder), python=python)
    new = folder / "bin" / "python"
    options = ["--no-deps", "--no-index"] if own else []
    done("-m", "pip", "--python", str(new), "install", "--quiet", *options, str(wheel))
    if own:
        (site,) = folder.glob("lib/python3*/site-packages")
        (site / "what-it-needs.pth").write_text(sysconfig.get_path("purelib"))
    return new


def test_the_commands_of_the_page_install_it(wheel: Path, tmp_path: Path) -> None:
    assert sum(one.title == NETWORK for one in blocks(ROOT / "docs" / "install.md")) == 3
    done("-m", "venv", "--without-pip", str(tmp_path / "env"))
    python = str(tmp_path / "env" / "bin" / "python")
    quick = {"PIP_NO_DEPS": "1", "PIP_NO_COMPILE": "1"}
    (tmp_path / "dist").symlink_to(wheel.parent)
    said = with_page(1, wheel.parent, tmp_path, python, **quick)
    assert f"armctl {armctl.__version__}\n" in said  # started by the line with uvx
    assert (tmp_path / "pipx" / "bin" / "armctl").is_file()
    with_page(2, wheel.parent, tmp_path, python, **quick)
    asked = "import importlib.metadata as m; print(m.metadata('armctl-console').get_all('Provides-Extra'))"
    assert "'urdf'" in done("-c", asked, python=python)


def test_pypi_is_shown_pictures_and_links_of_the_site(wheel: Path) -> None:
    with zipfile.ZipFile(wheel) as archive:
        (metadata,) = (name for name in archive.namelist() if name.endswith(".dist-info/METADATA"))
        page = archive.read(metadata).decode()
    assert f"]({DOCS}pictures/armctl.webp)" in page and f"]({DOCS}first-hour/)" in page
    assert [link for link in re.findall(r"\]\(([^)]*)\)", page) if not link.startswith("https://")] == []


def test_the_docs_that_the_console_serves_are_in_it_and_no_others(wheel: Path) -> None:
    served = {source_of(place) for place in ServedDocs().pages}
    with zipfile.ZipFile(wheel) as archive:
        names = {name.removeprefix("armctl/") for name in archive.namelist()}
        sizes = {one.filename: one.file_size for one in archive.infolist()}
    assert served <= names
    pages = {name for name in names if name.startswith("docs/") and name.endswith(".md")}
    assert pages == {source for source in served if source.startswith("docs/")}
    others = {name for name in names if name.startswith("docs/")} - pages
    assert {Path(name).suffix for name in others} == {".png", ".svg"}
    assert sum(size for name, size in sizes.items() if name.startswith("armctl/docs/")) < 2_250_000


@pytest.mark.parametrize("python", interpreters())
def test_it_starts_where_nothing_else_is(
    wheel: Path, python: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    new = installed(wheel, python, tmp_path / "env")
    for name in [name for name in os.environ if name.startswith("PYTHON")]:
        monkeypatch.delenv(name)
    found = done("-c", "import armctl; print(armctl.__file__, *armctl.shipped_robots())", python=new).split()
    assert Path(found[0]).is_relative_to(tmp_path) and tuple(found[1:]) == armctl.shipped_robots()
    command = new.with_name("armctl")
    assert done(str(command), "--version", python=new) == f"armctl {armctl.__version__}\n"
    assert '"count": ' in done(str(command), "ik", "uzuner", "220", "-196", "85", "--json", python=new)
    done(str(command), "firmware", str(tmp_path / "sketch"), python=new)
    assert (tmp_path / "sketch" / "encoder" / "encoder.ino").is_file()
    with serving(tmp_path, python=new, end=signal.SIGTERM) as link:
        browser = build_opener(HTTPCookieProcessor())  # the link gives a cookie and leads on to the page
        with browser.open(link, timeout=20) as page:
            assert page.status == 200 and b"armctl" in page.read()
        with browser.open(urljoin(link, page_of("inverse")), timeout=20) as page:
            assert page.status == 200 and b"Inverse</h1>" in page.read()
