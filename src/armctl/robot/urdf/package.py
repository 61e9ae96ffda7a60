"""Where the files of a URDF arm are: a file, a folder, a zip file, ROS packages, and the side file beside.

An arm from an unpacked folder sees no file outside of that folder.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import field, replace
from pathlib import Path, PurePosixPath
from urllib.parse import unquote
from xml.etree import ElementTree

from armctl.documents import DocumentKind
from armctl.errors import RobotFileError, UnclearArmError
from armctl.lazy_dataclass import dataclass
from armctl.robot.body.meshes import SUFFIXES
from armctl.robot.file import ROBOT_FILES
from armctl.robot.urdf.side_file import SIDE_SUFFIX, decode_side_file
from armctl.robot.urdf.unpacking import ARM_SUFFIXES, MOST_FILES, UNPACKED, arm_stem, unpacked, walk

_SMALL_TEXTS = DocumentKind(RobotFileError, most_bytes=1 << 20)
_URI = re.compile(r"(?P<scheme>[a-z]{2,}):/{1,2}(?P<rest>.*)", re.IGNORECASE | re.DOTALL)
_INCLUDED = re.compile(rb"""<xacro:include\s[^<>]*?\bfilename\s*=\s*["'](?:[^"'<>]*/)?([^"'/<>]+)["']""")
_LEVELS = 8
"""folders above the file in which packages are looked for"""
_MOST_NEAR = 4
"""files that are named instead of one that is not there"""
_PACKAGE_LEVELS = 3
"""folders between a file and that of its own package, at most"""
_PACKAGE = re.compile(r"[A-Za-z0-9][\w.-]*")
_PARTS = {"description", "model", "models", "robot", "robots", "urdf", "xacro"}
"""folders of a package in which a xacro file lies"""


@dataclass(frozen=True, slots=True)
class UrdfSource:
    """The files of one arm."""

    file: Path
    """the URDF or xacro file"""
    side_path: Path | None = None
    """the side file"""
    folder: Path | None = None
    """the unpacked folder that it may not look out of; None: it may"""
    _files: list[Path] = field(default_factory=list[Path], repr=False, compare=False)
    """meshes of the folder or the clone, once they were looked for"""

    @classmethod
    def at(cls, path: Path) -> UrdfSource:
        """The arm at a path as the user names it: one of the files, a folder, a zip file, or inside of it."""
        if path.name.lower().endswith(SIDE_SUFFIX):
            return cls._of_side_file(path)
        for outer in path.parents:
            if outer.suffix.lower() == ".zip" and outer.is_file():
                return cls.at(unpacked(outer) / path.relative_to(outer))
        if path.suffix.lower() == ".zip" and not path.is_dir():
            found = cls.at(unpacked(path))
            return replace(found, side_path=_beside(path) or found.side_path)
        if path.is_dir():
            path = _only_arm(path)
            if path.name.lower().endswith(SIDE_SUFFIX):
                return cls.at(path)
        return cls(path, _beside(path), _unpacked_folder(path))

    @classmethod
    def _of_side_file(cls, side: Path) -> UrdfSource:
        path, folder = _named_by(side), _unpacked_folder(side)
        named = os.path.relpath(path, side.parent)
        if folder is not None and not path.resolve().is_relative_to(folder.resolve()):
            error = RobotFileError(f'urdf = "{named}" leads out of the folder that it came in')
            raise error.about(str(side))
        if path.name.lower().endswith(SIDE_SUFFIX) or (
            path.is_dir() and _only_arm(path).name.lower().endswith(SIDE_SUFFIX)
        ):
            raise RobotFileError(f'urdf = "{named}" names a side file; name the URDF file').about(str(side))
        found = cls.at(path)
        return replace(found, side_path=side, folder=folder or found.folder)

    def find(self, uri: str) -> Path | None:
        """The file that a mesh's ``filename`` means; None: there is none, or it is out of bounds.

        Letters of another case and backslashes stand for those that are there. What ``package://`` names is
        found by the end of its path, too, as the folder of a clone is rarely called as the package.
        """
        places = self._places(uri)
        for place in places:
            if place.is_file() and self._allowed(place):
                return place
        for place in places:
            near = _in_any_case(place.absolute())
            if near is not None and near.is_file() and self._allowed(near):
                return near
        return self._of_that_name(uri) if places else None

    def near(self, uri: str) -> str:
        """What is there instead of a mesh that ``find`` does not find: files of its name, of any kind."""
        wanted = PurePosixPath(uri.replace("\\", "/"))
        found: list[str] = []
        for folder in {place.parent: None for place in self._places(uri)}:
            names = _names_in(_in_any_case(folder.absolute()) or folder)
            alike = [name for name in names if PurePosixPath(name).stem.lower() == wanted.stem.lower()]
            found += [name for name in alike if PurePosixPath(name).suffix.lower() in SUFFIXES]
        return ", ".join(sorted(dict.fromkeys(found))[:_MOST_NEAR])

    def _places(self, uri: str) -> list[Path]:
        """Where the file of a mesh may be, the likeliest first."""
        match = _URI.fullmatch(uri.strip())
        scheme = match["scheme"].lower() if match else ""
        rest = match["rest"] if match else uri.strip()
        if "\0" in rest or scheme not in ("", "file", "package", "model"):
            return []
        if scheme in ("package", "model"):
            package, _, inner = rest.lstrip("/").partition("/")
            places = [place / inner for place in self._packages(package)]
        else:
            inner = rest
            places = [self.file.parent / rest]
        places += [place / inner.lstrip("/") for place in self._above()]
        parts = [part for part in re.split(r"[/\\]", inner) if part]
        for k in range(1, min(len(parts) - 1, _LEVELS)):  # a folder and a name, at least
            places += [place.joinpath(*parts[k:]) for place in self._above()]
        if "\\" in inner:
            places += [Path(str(place).replace("\\", "/")) for place in places]
        return places + [Path(unquote(str(place))) for place in places if "%" in inner]

    @property
    def roots(self) -> list[Path]:
        """The folders below which the files lie that a xacro file of the arm may read."""
        if self.folder is not None:
            return [self.folder.resolve()]
        return [_own_package(self.file.absolute()).resolve(), _own_package(self.file.resolve())]

    def package(self, name: str) -> Path | None:
        """The folder of a ROS package, with a package.xml unless it is of this arm; None where there is none.

        Any folder above may be called as a file wants it to be, and is no package for that.
        """
        roots = self.roots
        for place in self._packages(name) if _PACKAGE.fullmatch(name) else ():
            own = any(place.resolve().is_relative_to(root) for root in roots)
            if place.is_dir() and self._allowed(place) and (own or (place / "package.xml").is_file()):
                return place
        return None

    def callers(self, macros: Sequence[str]) -> list[str]:
        """The xacro files of the package that call one of these macros, seen from the file's folder."""
        call = re.compile(rb"<xacro:(?:%s)[\s/>]" % b"|".join(re.escape(name.encode()) for name in macros))
        found: list[Path] = []
        with suppress(RobotFileError):  # a folder of very many files
            for path in walk(self.roots[0]):
                if (
                    path.suffix.lower() in ARM_SUFFIXES
                    and not path.samefile(self.file)
                    and self._allowed(path)
                ):
                    with suppress(RobotFileError):
                        found += [path] * bool(call.search(_SMALL_TEXTS.read(path)))
        here, others = self.file.parent.resolve(), [path.resolve() for path in found]
        others = [path for path in others if path != self.file.resolve()]
        return [os.path.relpath(path, here) for path in _whole_arms(others)]

    def _above(self) -> list[Path]:
        above = list(self.file.absolute().parents)[:_LEVELS]
        return above if self.folder is None else [one for one in above if one.is_relative_to(self.folder)]

    def _packages(self, name: str) -> Iterator[Path]:
        for place in self._above():
            if place.name == name or _package_name(place / "package.xml") == name:
                yield place
            yield place / name
            yield place / "share" / name
        for place in self._above():
            if place.name == "src":  # of a ROS workspace, whose repositories hold packages
                yield from sorted(place.glob(f"*/{name}"))
        for place in self._above():
            if name.startswith(f"{place.name}_"):  # a copy whose folder lost the end of its name
                yield place
        if self.folder is not None:
            return
        for entry in os.environ.get("ROS_PACKAGE_PATH", "").split(os.pathsep):
            if entry:
                yield Path(entry) / name
                if Path(entry).name == name:
                    yield Path(entry)
        for entry in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep):
            if entry:
                yield Path(entry) / "share" / name

    def _allowed(self, path: Path) -> bool:
        return self.folder is None or path.resolve().is_relative_to(self.folder.resolve())

    def _of_that_name(self, uri: str) -> Path | None:
        """A file that counts wherever it is, as it is the only one of its name.

        That is so in an unpacked folder; in a clone or a package the folder that it lies in must be as named.
        """
        parts = re.split(r"[/\\]", unquote(uri).casefold())
        root = self.folder or self._clone()
        if root is None or not parts[-1]:
            return None
        count = 1 if self.folder is not None else 2
        if not self._files:
            with suppress(RobotFileError):  # a folder of very many files
                self._files.extend(path for path in walk(root) if path.suffix.lower() in SUFFIXES)
        alike = [
            path
            for path in self._files
            if [part.casefold() for part in path.parts[-count:]] == parts[-count:] and self._allowed(path)
        ]
        named = [path for path in alike if path.name == PurePosixPath(uri).name]
        found = named if len(named) == 1 else alike
        return found[0] if len(found) == 1 else None

    def _clone(self) -> Path | None:
        """The folder above that was cloned, or that is a package."""
        marks = (".git", "package.xml")
        return next((one for mark in marks for one in self._above() if (one / mark).exists()), None)


def _in_any_case(path: Path) -> Path | None:
    """A path whose letters may be of another case; None where nothing or several are alike."""
    found = Path(path.anchor)
    for part in path.parts[1:]:
        if not (found / part).exists():
            alike = [name for name in _names_in(found) if name.casefold() == part.casefold()]
            if len(alike) != 1:
                return None
            part = alike[0]
        found /= part
    return found


def _names_in(folder: Path) -> list[str]:
    try:
        with os.scandir(folder) as entries:
            return [entry.name for _, entry in zip(range(MOST_FILES), entries, strict=False)]
    except (OSError, ValueError):
        return []


def _own_package(file: Path) -> Path:
    """The folder of the package that a file belongs to, as far as can be told."""
    folder, *above = file.parents[: _PACKAGE_LEVELS + 1]
    found = next((place for place in (folder, *above) if (place / "package.xml").is_file()), None)
    return found or (above[0] if above and folder.name in _PARTS else folder)


def _package_name(path: Path) -> str | None:
    if not path.is_file():
        return None
    try:
        found = ElementTree.fromstring(_SMALL_TEXTS.read(path)).findtext("name")
    except (RobotFileError, ElementTree.ParseError, ValueError, LookupError):
        return None  # then it names nothing
    return found and found.strip()


def side_path(path: Path) -> Path:
    """Where the side file of an arm lies that is named by this path, if beside it."""
    if path.name.lower().endswith(SIDE_SUFFIX):
        return path
    return path.with_name(arm_stem(path) + SIDE_SUFFIX)


def _unpacked_folder(path: Path) -> Path | None:
    """The folder that a file was unpacked into, if it was."""
    return next((one for one in path.absolute().parents if (one / UNPACKED).is_file()), None)


def _beside(path: Path) -> Path | None:
    side = side_path(path)
    return side if side.is_file() else None


def _named_by(side: Path) -> Path:
    """The file that a side file is about."""
    urdf = ROBOT_FILES.load(side, decode_side_file)[0].urdf
    if urdf is not None:
        return side.parent / urdf
    for ending in (".urdf", ".urdf.xacro", ".xacro", ".zip"):
        path = side.with_name(arm_stem(side) + ending)
        if path.is_file():
            return path
    missing = f"there is no {arm_stem(side)}.urdf beside it; put it there, or name the file"
    raise RobotFileError(f'{missing}: urdf = "folder/arm.urdf"').about(str(side))


def _only_arm(folder: Path) -> Path:
    """The one arm of a folder: a side file, a URDF file, a xacro file, in this order."""
    files = list(walk(folder))
    for ending in (SIDE_SUFFIX, ".urdf", ".urdf.xacro", ".xacro"):
        found = _whole_arms([path for path in files if path.name.lower().endswith(ending)])
        if len(found) == 1:
            return found[0]
        if found:
            names = [path.relative_to(folder).as_posix() for path in found]
            some = ", ".join(names[:12]) + ", …" * (len(names) > 12)
            error = UnclearArmError(f"holds several arms: {some}; name one: {found[0]}")
            error.arms = names
            raise error.about(str(folder))
    raise RobotFileError("holds no .urdf and no .xacro file").about(str(folder))


def _whole_arms(found: list[Path]) -> list[Path]:
    """Those that no other one includes, as parts of an arm are; all of them where that leaves none."""
    parts: set[bytes] = set()
    for path in found if len(found) > 1 else ():
        with suppress(RobotFileError):  # what cannot be read names no parts, and is refused when it is loaded
            first, *rest = _SMALL_TEXTS.read(path).split(b"<!--")
            text = b"".join([first, *(after.partition(b"-->")[2] for after in rest)])
            parts.update(set(_INCLUDED.findall(text)) - {os.fsencode(path.name)})
    return [path for path in found if os.fsencode(path.name) not in parts] or found
