"""Settings: dataclass fields that carry a default, a range, a unit and a sentence.

Checks, parameters of the nodes, ``config/*.yaml`` and tables of the docs are made of them.
"""

import math
from dataclasses import dataclass, field, fields
from enum import Enum
from numbers import Integral, Real
from typing import Any, TypeVar, cast

from annik_core.errors import InvalidValue

Value = TypeVar("Value")

_KEY = "setting"


@dataclass(frozen=True)
class Setting:
    """A field of a dataclass that may be set.

    Attributes:
        default: bool, int, float, str, a member of an Enum, a tuple of numbers (whose length is
            then fixed), or a tuple of strings (of any length).
        unit: of the value, or of each number of a tuple; empty if it has none.
        minimum: least value allowed; None: no least value.
        greater_than: what the value must exceed; None: nothing.
        maximum: greatest value allowed; None: any finite one; infinity: any.
    """

    name: str
    default: Any
    description: str
    unit: str = ""
    minimum: float | None = None
    greater_than: float | None = None
    maximum: float | None = None
    choices: tuple[str, ...] = ()

    @property
    def allowed(self) -> str:
        """The allowed values in words, with the unit."""
        choices = self.choices
        if isinstance(self.default, Enum):
            choices = tuple(member.value for member in type(self.default))
        if choices:
            return f"one of {', '.join(choices)}"
        if isinstance(self.default, bool):
            return "true or false"
        if isinstance(self.default, str):
            return "a string"
        if self._is_tuple_of_strings:
            return "a list of strings"
        unit = f" [{self.unit}]" if self.unit else ""
        return f"{self._numbers_in_words}{self._range_in_words}{unit}"

    def allows(self, value: object) -> bool:
        """Whether a value is allowed."""
        return self._converted(value) is not None

    def checked(self, value: object) -> Any:
        """The value in the type of the default, such as an integer as a float.

        Raises:
            InvalidValue: if its type, its length or its range is wrong, or it is no choice.
        """
        converted = self._converted(value)
        if converted is None:
            raise InvalidValue(self.name, value, self.allowed)
        return converted

    @property
    def allows_infinity(self) -> bool:
        """Whether infinity is allowed; if so, it is no limit."""
        return self.maximum == math.inf

    @property
    def _is_tuple_of_strings(self) -> bool:
        return isinstance(self.default, tuple) and isinstance(next(iter(self.default), 0.0), str)

    @property
    def _numbers_in_words(self) -> str:
        finite = "" if self.maximum is not None else "finite "
        if isinstance(self.default, tuple):
            return f"{len(self.default)} {finite}numbers"
        if isinstance(self.default, int):
            return "an integer"
        return f"a {finite}number"

    @property
    def _range_in_words(self) -> str:
        highest = None if self.allows_infinity else self.maximum
        if self.greater_than is not None:
            at_most = "" if highest is None else f", at most {_in_words(highest)}"
            return f" greater than {_in_words(self.greater_than)}{at_most}"
        lowest = None if self.minimum == -math.inf else self.minimum
        if lowest is None:
            return "" if highest is None else f" of at most {_in_words(highest)}"
        if highest is None:
            return f" of at least {_in_words(lowest)}"
        return f" from {_in_words(lowest)} to {_in_words(highest)}"

    def _converted(self, value: object) -> Any:
        """The value in the type of the default; None if it is not allowed."""
        if isinstance(self.default, Enum):
            members: Any = type(self.default)
            return next((item for item in members if value in (item, item.value)), None)
        if isinstance(self.default, tuple):
            return self._converted_tuple(value)
        if isinstance(self.default, str):
            is_choice = isinstance(value, str) and (not self.choices or value in self.choices)
            return value if is_choice else None
        if isinstance(self.default, bool):
            return value if isinstance(value, bool) else None
        return self._converted_number(value)

    def _converted_tuple(self, value: object) -> tuple[Any, ...] | None:
        try:
            given = tuple(cast("list[object]", value))
        except TypeError:
            return None
        if self._is_tuple_of_strings:
            is_allowed = not isinstance(value, str) and all(isinstance(x, str) for x in given)
            return given if is_allowed else None
        numbers = tuple(self._converted_number(number) for number in given)
        return None if None in numbers or len(numbers) != len(self.default) else numbers

    def _converted_number(self, value: object) -> int | float | None:
        # True and False are integers to Python.
        if isinstance(value, bool):
            return None
        number: int | float | None = None
        if isinstance(self.default, int):
            number = int(value) if isinstance(value, Integral) else None
        elif isinstance(value, Real):
            number = float(value)
        return number if number is not None and self._is_in_range(number) else None

    def _is_in_range(self, number: float) -> bool:
        if math.isinf(number) and not self.allows_infinity:
            return False
        # Comparisons with NaN are false.
        return (
            (-math.inf if self.minimum is None else self.minimum)
            <= number
            <= (math.inf if self.maximum is None else self.maximum)
        ) and (self.greater_than is None or number > self.greater_than)


def _in_words(bound: float) -> str:
    return str(bound) if isinstance(bound, int) else f"{bound:g}"


def setting(
    default: Value,
    description: str,
    *,
    unit: str = "",
    within: tuple[float | None, float | None] = (None, None),
    greater_than: float | None = None,
    choices: tuple[str, ...] = (),
    **metadata: object,
) -> Value:
    """A field of a dataclass that may be set; for the arguments see :class:`Setting`.

    ``within`` are its minimum and maximum. Other keyword arguments are further metadata.
    """
    described = {
        "description": description,
        "unit": unit,
        "minimum": within[0],
        "greater_than": greater_than,
        "maximum": within[1],
        "choices": choices,
    }
    # For type checkers the field has the type of its default, as with dataclasses.field.
    declared: Any = field(default=default, metadata={_KEY: described, **metadata})
    return cast("Value", declared)


def upper_limit(default: float, description: str, unit: str) -> float:
    """A setting of more than 0; infinity: no limit."""
    return setting(default, description, unit=unit, greater_than=0.0, within=(None, math.inf))


def settings_of(settings: type) -> tuple[Setting, ...]:
    """The fields of a dataclass that :func:`setting` made, in their order."""
    return tuple(
        Setting(entry.name, entry.default, **entry.metadata[_KEY])
        for entry in fields(settings)
        if _KEY in entry.metadata
    )


def check_settings(settings: object) -> None:
    """Check every setting of an instance.

    Raises:
        InvalidValue: naming the first that is not allowed.
    """
    for entry in settings_of(type(settings)):
        entry.checked(getattr(settings, entry.name))


class CheckedSettings:
    """Base of a dataclass of settings that is checked when it is made; raises InvalidValue."""

    def __post_init__(self) -> None:
        check_settings(self)
