"""What is wrong with a file that was decoded strictly: which key, its value and what is allowed."""

from __future__ import annotations

import re
from collections.abc import Sequence

import msgspec
from msgspec import inspect

_NO_CHOICE = re.compile(r"Invalid enum value (?P<value>.*) - at `\$\.(?P<key>.*)`", re.DOTALL)
_INDEX = re.compile(r"\[[^]]*\]")


def decoding_words(error: msgspec.DecodeError, model: type) -> str:
    """The words of ``error``, in which a value that is no choice of its key is answered with the choices.

    Args:
        error: of decoding into ``model``.
        model: the struct of the whole file.
    """
    found = _NO_CHOICE.fullmatch(str(error))
    choices = None if found is None else _choices(inspect.type_info(model), found["key"])
    if found is None or choices is None:
        return str(error)
    return f"{found['key']} = {found['value']}: {must_be(choices)}"


def must_be(choices: Sequence[object]) -> str:
    """What may stand where only some values may: "must be one of 'a', 'b'"."""
    allowed = ", ".join(repr(choice) for choice in choices)
    return f"must be {'one of ' if len(choices) > 1 else ''}{allowed}"


def _choices(node: inspect.Type, key: str) -> tuple[object, ...] | None:
    """The literals that may stand under ``key`` below ``node``; None where there is more than literals."""
    for name in _INDEX.sub(".[]", key).split("."):
        node = _without_none(node)
        if name == "[]":
            match node:
                case inspect.VarTupleType() | inspect.ListType():
                    node = node.item_type
                case inspect.DictType():
                    node = node.value_type
                case _:
                    return None
        elif isinstance(node, inspect.StructType):
            node = next(field.type for field in node.fields if field.encode_name == name)
        else:
            return None
    node = _without_none(node)
    return tuple(node.values) if isinstance(node, inspect.LiteralType) else None


def _without_none(node: inspect.Type) -> inspect.Type:
    if not isinstance(node, inspect.UnionType):
        return node
    others = [one for one in node.types if not isinstance(one, inspect.NoneType)]
    return others[0] if len(others) == 1 else node
