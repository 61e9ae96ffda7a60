"""Arms from zip files and pages: what they bring is kept in folders of their own.

Nothing of a zip file is trusted: names that lead out of it and contents beyond the limits are refused, links
are left out.
"""

from __future__ import annotations

import hashlib
import io
import os
import re
import shutil
import stat
import tempfile
import zipfile
from collections.abc import Iterator, Mapping
from pathlib import Path, PurePosixPath

from platformdirs import user_cache_path

from armctl.apart import require_wanted
from armctl.documents import DocumentKind, not_written, write_atomically
from armctl.errors import ArmctlError, RobotFileError
from armctl.robot.body.meshes import SUFFIXES

ARM_SUFFIXES = (".urdf", ".xacro")
MOST_PACKED_BYTES = 64 << 20
"""of a zip file"""
MOST_FILES = 5000
"""of a zip file or a folder"""
_MOST_UNPACKED_BYTES = 256 << 20
_MOST_NAMESAKES = 1000
"""arms from pages whose files have the same name"""
_KEPT = 16
"""unpacked zip files that stay in the cache"""
_ZIPS = DocumentKind(RobotFileError, most_bytes=MOST_PACKED_BYTES)
UNPACKED = ".armctl-unpacked"
"""A folder with this file in it was unpacked: what lies outside is none of its arm's business."""
MESH_FILES = (*SUFFIXES, ".bin")
"""meshes, and what .gltf files keep beside themselves"""
_TAKEN = {*ARM_SUFFIXES, *MESH_FILES, ".gazebo", ".toml", ".trans", ".transmission", ".xml", ".yaml", ".yml"}
"""files of a zip file that are unpacked; others have no use here"""


def arm_stem(path: Path) -> str:
    """The name without its endings: ``arm`` of ``arm.urdf.xacro`` and of ``arm.armctl.toml``."""
    return re.sub(r"(\.urdf|\.xacro|\.zip|\.armctl\.toml)+\Z", "", path.name, flags=re.IGNORECASE)


def walk(folder: Path) -> Iterator[Path]:
    """The files of a folder and below, hidden ones left out; refuses too many."""
    count = 0
    for place, folders, names in os.walk(folder):
        folders[:] = sorted(name for name in folders if not name.startswith("."))
        for name in sorted(names):
            count += 1
            if count > MOST_FILES:
                error = RobotFileError(f"holds more than {MOST_FILES} files; name the URDF file")
                raise error.about(str(folder))
            if not name.startswith("."):
                yield Path(place) / name


def unpacked(path: Path) -> Path:
    """The folder of the user's cache in which the contents of a zip file lie."""
    content = _ZIPS.load(path, bytes)
    place = user_cache_path("armctl") / "urdf" / hashlib.sha256(content).hexdigest()[:24]
    if not (place / UNPACKED).is_file():
        try:
            write_folder(place, zip_files(content))
        except RobotFileError as refusal:
            raise refusal.about(str(path)) from refusal
    os.utime(place)
    _forget_old(place.parent)
    return place


def zip_files(content: bytes) -> dict[str, bytes]:
    """The files of a zip file that an arm has use for, by their names; refuses what is no honest one."""
    files: dict[str, bytes] = {}
    left = _MOST_UNPACKED_BYTES
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as packed:
            entries = packed.infolist()
            if len(entries) > MOST_FILES:
                raise RobotFileError(f"the zip file holds {len(entries)} files; {MOST_FILES} at most")
            for entry in entries:
                require_wanted()
                name = entry.filename.replace("\\", "/")
                require_inside(name)
                kind = stat.S_IFMT(entry.external_attr >> 16)
                if entry.is_dir() or kind not in (0, stat.S_IFREG) or not _is_taken(name):
                    continue
                if entry.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
                    raise RobotFileError(
                        f"{name} is packed in an uncommon way; pack it as zip programs do (deflate)"
                    )
                if entry.flag_bits & 1:
                    raise RobotFileError(f"the zip file is encrypted ({name}); unpack it first")
                with packed.open(entry) as stream:
                    files[name] = stream.read(left + 1)
                left -= len(files[name])
                if left < 0:
                    raise RobotFileError(
                        f"the zip file holds more than {_MOST_UNPACKED_BYTES >> 20} MiB; leave out what the "
                        "arm does not need, or unpack it and name the folder"
                    )
    except ArmctlError:
        raise
    except Exception as cause:  # zipfile raises many kinds; zlib, lzma and bz2 each have one of their own
        raise RobotFileError(f"is no zip file that can be read: {cause}") from cause
    return files


def require_inside(name: str) -> None:
    """Refuse the name of a packed file that leads out of its folder."""
    path = PurePosixPath(name)
    if path.is_absolute() or ".." in path.parts or "\0" in name or ":" in name:
        raise RobotFileError(f"the file name {name!r} leads out of the folder; such a zip file is not opened")


def _is_taken(name: str) -> bool:
    path = PurePosixPath(name)
    hidden = any(part.startswith(".") or part == "__MACOSX" for part in path.parts)
    return not hidden and path.suffix.lower() in _TAKEN


def write_folder(place: Path, files: Mapping[str, bytes]) -> None:
    """Write files into a new folder, which appears all at once; one that is there already stays as it is."""
    try:
        place.parent.mkdir(parents=True, exist_ok=True)
        building = Path(tempfile.mkdtemp(prefix=".armctl-", dir=place.parent))
        try:
            for name, content in files.items():
                require_wanted()
                require_inside(name)
                path = building / name
                path.parent.mkdir(parents=True, exist_ok=True)
                path.write_bytes(content)
            (building / UNPACKED).touch()
            building.chmod(0o755)
            building.rename(place)
        except BaseException:
            shutil.rmtree(building, ignore_errors=True)
            raise
    except OSError as cause:
        if not (place / UNPACKED).is_file():  # another program was faster
            raise RobotFileError(not_written(place, cause)) from cause


def install_package(name: str, content: bytes, folder: Path) -> Path:
    """Keep what came through a page, a zip file or a URDF file, in a new folder below ``folder``."""
    suffix = Path(name).suffix.lower()
    if suffix == ".zip":
        files = zip_files(content)
    elif suffix in ARM_SUFFIXES:
        files = {Path(name).name: content}
    else:
        raise RobotFileError(f"{name}: an arm is a .urdf or .xacro file, or a .zip file with one")
    stem = re.sub(r"[^A-Za-z0-9_-]+", "_", arm_stem(Path(name))).strip("_") or "arm"
    numbers = ("", *(f"_{k}" for k in range(2, _MOST_NAMESAKES)))
    places = (folder / (stem[:40] + k) for k in numbers)
    place = next((place for place in places if not place.exists()), None)
    if place is None:
        raise RobotFileError(f"{folder} holds {_MOST_NAMESAKES - 1} arms {stem[:40]!r}: delete some of them")
    write_folder(place, files)
    return place


def add_to_package(place: Path, name: str, content: bytes) -> None:
    """Put one more file, a mesh, into a folder that ``install_package`` made."""
    if Path(name).suffix.lower() not in MESH_FILES or not (place / UNPACKED).is_file():
        raise RobotFileError(f"{name}: only meshes ({', '.join(MESH_FILES)}) are added to an arm from a page")
    there = [path for path in walk(place) if path != place / "meshes" / Path(name).name]
    if (
        len(there) + 2 > MOST_FILES  # with this one, and the mark that it was unpacked
        or sum(path.stat().st_size for path in there) + len(content) > _MOST_UNPACKED_BYTES
    ):
        raise RobotFileError(
            f"{name}: an arm from a page has {MOST_FILES} files, {_MOST_UNPACKED_BYTES >> 20} MiB at most"
        )
    try:
        (place / "meshes").mkdir(exist_ok=True)
        write_atomically(place / "meshes" / Path(name).name, content)
    except OSError as cause:
        raise RobotFileError(not_written(place, cause)) from cause


def _forget_old(folder: Path) -> None:
    """Keep the newest few unpacked zip files."""
    places = sorted(folder.iterdir(), key=lambda place: place.stat().st_mtime, reverse=True)
    for place in places[_KEPT:]:
        shutil.rmtree(place, ignore_errors=True)
