"""No part of armctl makes code of data: a walk through every file of the package."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

SOURCE = Path(__file__).parents[2] / "src/armctl"
BUILTINS = {"eval", "exec", "compile", "__import__"}
MODULES = {"cloudpickle", "code", "dill", "jsonpickle", "marshal", "pickle", "runpy", "shelve"}
"""what makes objects or code of bytes"""
SAFE_YAML = {
    "MappingNode",
    "MarkedYAMLError",
    "Node",
    "SafeLoader",
    "ScalarNode",
    "SequenceNode",
    "YAMLError",
}
"""all that may be used of PyYAML: its loader of plain data, and what that is given and raises"""
KNOWN = {
    ("kinematics/families/yaw_pitch_roll/closed_form.py", "compile"),  # of text that armctl itself writes
    ("kinematics/families/yaw_pitch_roll/closed_form.py", "exec"),
}


def makes_code(tree: ast.AST) -> Iterator[str]:
    """What in a file could make code or objects of data."""
    for node in ast.walk(tree):
        match node:
            case ast.Name(id=name) if name in BUILTINS:
                yield name
            case ast.Attribute(value=ast.Name(id="builtins"), attr=name) if name in BUILTINS:
                yield name
            case ast.Attribute(value=ast.Name(id="yaml"), attr=name) if name not in SAFE_YAML:
                yield f"yaml.{name}"
            case ast.Import(names=names):
                yield from (one.name for one in names if one.name.split(".")[0] in MODULES)
                yield from (f"{one.name} as" for one in names if one.name == "yaml" and one.asname)
            case ast.ImportFrom(module=str(module), level=0, names=names):
                if module.split(".")[0] in MODULES:
                    yield module
                if module.split(".")[0] in ("yaml", "builtins"):
                    yield from (f"{module}.{one.name}" for one in names)
            case ast.keyword(arg="allow_pickle" | "shell"):
                yield str(node.arg)
            case _:
                pass


def test_what_makes_code_of_data_appears_nowhere_else() -> None:
    found = {
        (path.relative_to(SOURCE).as_posix(), name)
        for path in SOURCE.rglob("*.py")
        for name in makes_code(ast.parse(path.read_text(encoding="utf-8")))
    }
    assert found <= KNOWN


@pytest.mark.parametrize(
    "text",
    [
        "eval('1')",
        "run = exec",
        "import builtins\nbuiltins.eval('1')",
        "from builtins import eval as run",
        "import pickle as p\np.load(stream)",
        "from pickle import loads",
        "import yaml\nyaml.load(text, Loader=yaml.Loader)",
        "import yaml\nyaml.unsafe_load(text)",
        "import yaml as y\ny.load(text)",
        "from yaml import load",
        "numpy.load(path, allow_pickle=True)",
        "subprocess.run(text, shell=True)",
    ],
)
def test_the_walk_finds_it(text: str) -> None:
    assert list(makes_code(ast.parse(text)))
