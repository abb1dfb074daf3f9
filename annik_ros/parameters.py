"""Node parameters as one table: the fields of a dataclass that know unit, range and meaning.

The nodes declare these tables, and the documentation is generated from them. Needs no ROS.
"""

from __future__ import annotations

import math
from dataclasses import Field, dataclass, field, fields
from typing import Any, TypeVar, cast

from annik_core.errors import AnnikError

Value = TypeVar("Value")
ParameterValue = bool | int | float | str | tuple[float, ...] | tuple[str, ...]

#: The least limit that can be set: a limit must be greater than 0.
SMALLEST_LIMIT = 1e-12

_METADATA_KEY = "parameter"
_TYPE_NAMES: dict[type, str] = {
    bool: "bool",
    int: "integer",
    float: "double",
    str: "string",
    tuple: "double array",
}


class InvalidParameter(AnnikError):
    """A parameter has a value of the wrong type, or one that is not allowed."""

    def __init__(self, name: str, value: object, allowed: str) -> None:
        self.name = name
        self.value = value
        self.allowed = allowed
        super().__init__(f"parameter {name} is {value!r}; it must be {allowed}")


@dataclass(frozen=True)
class Parameter:
    """One row of a node's parameter table.

    Attributes:
        name: as ROS sees it.
        default: the value if none is given; an array is a tuple, of numbers (whose count is then
            fixed) or of strings (any number of them).
        unit: of the value, or of each number of an array; empty if it has none.
        minimum: least value allowed, or None.
        maximum: greatest value allowed, or None. Infinity is a value only where it is infinity.
        choices: the strings allowed; empty means any.
        description: one sentence.
        read_only: whether it keeps its value while the node runs.
    """

    name: str
    default: ParameterValue
    unit: str
    minimum: float | None
    maximum: float | None
    choices: tuple[str, ...]
    description: str
    read_only: bool

    @property
    def type_name(self) -> str:
        """What ROS calls the type, such as integer or double array."""
        if self._holds_strings:
            return "string array"
        return _TYPE_NAMES[type(self.default)]

    @property
    def allowed(self) -> str:
        """The allowed values in words, with the unit."""
        unit = f" [{self.unit}]" if self.unit else ""
        if self.choices:
            return f"one of {', '.join(self.choices)}"
        if self._holds_strings:
            return "strings"
        if isinstance(self.default, tuple):
            kind = "numbers" if self._may_be_infinite else "finite numbers"
            return f"{len(self.default)} {kind}{unit}"
        article = "an" if self.type_name[0] in "aeiou" else "a"
        if self.minimum is None and self.maximum is None:
            return f"{article} {self.type_name}{unit}"
        low = "-inf" if self.minimum is None else f"{self.minimum:g}"
        high = "inf" if self.maximum is None else f"{self.maximum:g}"
        return f"{article} {self.type_name} from {low} to {high}{unit}"

    def checked(self, value: object) -> ParameterValue:
        """The value if it is allowed, with an integer taken for the double that it means.

        ``-p rate:=50`` is an integer to ROS; to refuse it for a rate would only be tiresome.

        Raises:
            InvalidParameter: if the type, the range, the choice or the array's length is wrong.
        """
        refusal = InvalidParameter(self.name, value, self.allowed)
        if self._holds_strings:
            return _checked_strings(value, refusal)
        if isinstance(self.default, tuple):
            return self._checked_array(value, refusal)
        if isinstance(self.default, float) and type(value) is int:
            value = float(value)
        if type(value) is not type(self.default):
            raise refusal
        if isinstance(value, str) and self.choices and value not in self.choices:
            raise refusal
        if isinstance(value, (int, float)) and not self._in_range(value):
            raise refusal
        return value

    @property
    def _holds_strings(self) -> bool:
        return isinstance(self.default, tuple) and isinstance(next(iter(self.default), 0.0), str)

    @property
    def _may_be_infinite(self) -> bool:
        return self.maximum == math.inf

    def _in_range(self, value: float) -> bool:
        low = -math.inf if self.minimum is None else self.minimum
        high = math.inf if self.maximum is None else self.maximum
        if math.isinf(value) and not self._may_be_infinite:
            return False
        return low <= value <= high

    def _checked_array(self, value: object, refusal: InvalidParameter) -> tuple[float, ...]:
        try:
            given = tuple(cast("list[object]", value))
        except TypeError as error:
            raise refusal from error
        if not all(type(number) in (int, float) for number in given):
            raise refusal
        numbers = tuple(float(cast("float", number)) for number in given)
        if len(numbers) != len(cast("tuple[object, ...]", self.default)):
            raise refusal
        for number in numbers:
            if math.isnan(number) or (math.isinf(number) and not self._may_be_infinite):
                raise refusal
        return numbers


def _checked_strings(value: object, refusal: InvalidParameter) -> tuple[str, ...]:
    if not isinstance(value, (list, tuple)) or not all(isinstance(text, str) for text in value):
        raise refusal
    return tuple(value)


def parameter(
    default: Value,
    description: str,
    *,
    unit: str = "",
    minimum: float | None = None,
    maximum: float | None = None,
    choices: tuple[str, ...] = (),
    read_only: bool = True,
) -> Value:
    """A dataclass field that is a node parameter; see :class:`Parameter` for the arguments."""
    row = {
        "unit": unit,
        "minimum": minimum,
        "maximum": maximum,
        "choices": choices,
        "description": description,
        "read_only": read_only,
    }
    # The type checker is to see a field of the default's type, as with dataclasses.field itself.
    declared: Any = field(default=default, metadata={_METADATA_KEY: row})
    return cast("Value", declared)


def parameter_table(parameters: type) -> tuple[Parameter, ...]:
    """The table of a dataclass whose fields were made by :func:`parameter`, in their order."""
    return tuple(_row(entry) for entry in fields(parameters) if _METADATA_KEY in entry.metadata)


def _row(entry: Field[Any]) -> Parameter:
    default: Any = entry.default
    return Parameter(name=entry.name, default=default, **entry.metadata[_METADATA_KEY])
