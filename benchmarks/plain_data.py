"""Dataclasses from the plain data that JSON gives back."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields, is_dataclass
from typing import Any, get_args, get_origin, get_type_hints


def built(kind: Any, data: Any) -> Any:
    """A value of a type, from what :func:`dataclasses.asdict` and JSON made of it.

    Args:
        kind: a dataclass, a sequence or a mapping of what this function builds, or a plain type.
        data: the data; keys that are not of a field are left out.
    """
    arguments = get_args(kind)
    if is_dataclass(kind) and isinstance(kind, type):
        hints = get_type_hints(kind)
        names = [field.name for field in fields(kind) if field.name in data]
        return kind(**{name: built(hints[name], data[name]) for name in names})
    if get_origin(kind) in (tuple, Sequence):
        return tuple(built(arguments[0], entry) for entry in data)
    if get_origin(kind) in (dict, Mapping):
        key, value = arguments
        return {built(key, name): built(value, entry) for name, entry in data.items()}
    return int(data) if kind is int else data
