"""Checks of the values in a robot definition."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from annik_core.pose import FloatArray
from annik_core.robots.errors import InvalidRobotDefinition

#: Greatest number allowed: beyond it results overflow.
_LARGEST = 1e6
#: Least divisor allowed.
_SMALLEST = 1e-9


def checked_name(value: object, what: str, source: str) -> str:
    """Check a name or a frame of a definition.

    Args:
        value: as read.
        what: what to call the entry in an error.
        source: what to call the definition in an error.

    Raises:
        InvalidRobotDefinition: if it is not text, is blank, or can't be printed.
    """
    if not isinstance(value, str) or not value.strip() or not value.isprintable():
        raise InvalidRobotDefinition(source, f"{what} is {value!r}: not a name")
    return value


def checked_numbers(value: object, what: str, source: str) -> FloatArray:
    """Convert a number of a definition, or nested lists of numbers, to an array.

    Args:
        value: as read.
        what: what to call the entry in an error.
        source: what to call the definition in an error.

    Raises:
        InvalidRobotDefinition: if it holds anything else, its rows differ in length, or a number
            does not fit into a double.
    """
    if not is_numeric(value):
        raise InvalidRobotDefinition(source, f"{what}: text, true, false or nothing for a number")
    try:
        return np.array(value, dtype=np.float64)
    except (OverflowError, ValueError) as error:
        raise InvalidRobotDefinition(source, f"{what}: malformed ({error})") from error


def is_numeric(value: object) -> bool:
    """Whether it is a number or nested lists of numbers; text and booleans are not.

    Without recursion, because a file may nest lists arbitrarily deep.
    """
    remaining = [value]
    while remaining:
        item = remaining.pop()
        if isinstance(item, (list, tuple)):
            remaining.extend(item)
        elif isinstance(item, bool) or not isinstance(item, (int, float)):
            return False
    return True


def checked_arrays(
    data: Any, names: tuple[str, ...], what: str, source: str
) -> dict[str, FloatArray]:
    """Convert a mapping with exactly these names to finite arrays.

    Raises:
        InvalidRobotDefinition: naming what is missing, unknown, not finite or too large.
    """
    if not isinstance(data, Mapping):
        raise InvalidRobotDefinition(source, f"{what} is not a mapping")
    for name in sorted(set(names) ^ set(data), key=str):
        state = "missing" if name in names else "unknown"
        raise InvalidRobotDefinition(source, f"{what}.{name} is {state}")
    arrays = {name: checked_numbers(data[name], f"{what}.{name}", source) for name in names}
    for name, array in arrays.items():
        if not np.isfinite(array).all():
            raise InvalidRobotDefinition(source, f"{what}.{name} is not finite")
        if np.abs(array).max(initial=0.0) > _LARGEST:
            raise InvalidRobotDefinition(source, f"{what}.{name} is beyond {_LARGEST:g}")
        array.flags.writeable = False
    return arrays


def check_shape(array: FloatArray, shape: tuple[int, ...], what: str, source: str) -> None:
    """Refuse an array of another shape.

    Raises:
        InvalidRobotDefinition: naming both.
    """
    if array.shape != shape:
        raise InvalidRobotDefinition(source, f"{what} has shape {array.shape}, not {shape}")


def check_positive(array: FloatArray, what: str, source: str) -> None:
    """Refuse numbers below the least divisor.

    Raises:
        InvalidRobotDefinition: naming the entry.
    """
    if not (array > 0.0).all():
        raise InvalidRobotDefinition(source, f"{what} is not positive")
    if not (array >= _SMALLEST).all():
        raise InvalidRobotDefinition(source, f"{what} is below {_SMALLEST:g}")
