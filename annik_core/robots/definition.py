"""Checks of the values in a robot definition."""

import math
import re
from collections.abc import Mapping
from typing import Any

import numpy as np

from annik_core.pose import FloatArray
from annik_core.robots.errors import InvalidRobotDefinition

#: Greatest number allowed: beyond it results overflow.
_LARGEST = 1e6
#: Least divisor allowed.
_SMALLEST = 1e-9
#: Units of a joint position, in rad or m.
ANGLE_UNITS = {"": 1.0, "rad": 1.0, "deg": math.pi / 180.0, "\N{DEGREE SIGN}": math.pi / 180.0}
LENGTH_UNITS = {"": 1.0, "m": 1.0, "cm": 0.01, "mm": 0.001}


def checked_name(value: object, what: str, source: str) -> str:
    """A name or a frame of a definition; errors call the entry ``what``.

    Raises:
        InvalidRobotDefinition: if it is not text, is blank, or can't be printed.
    """
    if not isinstance(value, str) or not value.strip() or not value.isprintable():
        raise InvalidRobotDefinition(source, f"{what} is {value!r}: not a name")
    return value


def checked_numbers(value: object, what: str, source: str) -> FloatArray:
    """A number of a definition, or nested lists of numbers, as an array.

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


def checked_interval(
    value: object, joint_type: str, joint: str, source: str
) -> tuple[float, float]:
    """Two numbers [rad or m], or texts with a unit, such as 90deg or 150mm.

    Raises:
        InvalidRobotDefinition: if it is anything else, or not finite, or empty.
    """
    what = f"joint_box of {joint}"
    units = LENGTH_UNITS if joint_type == "prismatic" else ANGLE_UNITS
    bounds = [math.nan, math.nan]
    if isinstance(value, (list, tuple)) and len(value) == 2:
        bounds = [
            _position(bound, units)
            if isinstance(bound, str)
            else float(checked_numbers(bound, what, source))
            for bound in value
        ]
    if not all(map(math.isfinite, bounds)) or bounds[0] > bounds[1]:
        known = ", ".join(filter(None, units))
        raise InvalidRobotDefinition(
            source, f"{what} is {value}, not [lower, upper], finite, in numbers or in {known}"
        )
    return bounds[0], bounds[1]


def _position(text: str, units: Mapping[str, float]) -> float:
    """A number with a unit in rad or m, or NaN."""
    parts = re.fullmatch(r"\s*([-+.\de]*[\d.])\s*([a-z\N{DEGREE SIGN}]*)\s*", text.lower())
    try:
        return float(parts[1]) * units[parts[2]] if parts else math.nan
    except (ValueError, KeyError):
        return math.nan


def number_text(number: float) -> str:
    """A number in as few digits as give the same double when it is read again."""
    return repr(float(number)).removesuffix(".0")


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
    """Refuse an array of another shape."""
    if array.shape != shape:
        raise InvalidRobotDefinition(source, f"{what} has shape {array.shape}, not {shape}")


def check_positive(array: FloatArray, what: str, source: str) -> None:
    """Refuse numbers below the least divisor."""
    if not (array > 0.0).all():
        raise InvalidRobotDefinition(source, f"{what} is not positive")
    if not (array >= _SMALLEST).all():
        raise InvalidRobotDefinition(source, f"{what} is below {_SMALLEST:g}")
