"""Parameters of the nodes, made from settings. Needs no ROS.

The nodes declare the table of a dataclass of parameters; ``config/*.yaml`` and the documentation
are generated from it.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from enum import Enum
from typing import Any, TypeVar, cast

from annik_core.errors import InvalidValue
from annik_core.settings import Setting, setting, settings_of

Value = TypeVar("Value")
Settings = TypeVar("Settings")
ParameterValue = bool | int | float | str | tuple[float, ...] | tuple[str, ...]

#: The bounds of arrays that stand for infinity: ROS tools can't restore an infinite number.
NO_BOUND = 1000.0

_READ_ONLY = "read_only"
_INCLUDED = "included settings"
_NAMES = "names of their parameters"


class ExecutorChoice(Enum):
    """The executor of rclpy that runs the callbacks of a node."""

    EVENTS = "events"
    SINGLE_THREADED = "single_threaded"


@dataclass(frozen=True)
class Parameter:
    """A setting as ROS holds it: in values that survive ``ros2 param dump`` and ``load``.

    ``ros2 param load`` turns infinity, and numbers such as 5e-07, into strings. A default of this
    kind is 0 as a parameter, where the setting itself does not allow 0; the infinite bounds of an
    array are -1000 and 1000.
    """

    setting: Setting
    read_only: bool

    @property
    def name(self) -> str:
        """The name of the parameter."""
        return self.setting.name

    @property
    def default(self) -> ParameterValue:
        """The default as ROS holds it."""
        return self._held(self.setting.default)

    @property
    def zero_is_default(self) -> bool:
        """Whether 0 stands for the default of the setting."""
        default = self.setting.default
        return (
            isinstance(default, float)
            and "." not in repr(default)
            and not self.setting.allows(0.0)
        )

    @property
    def description(self) -> str:
        """What the value means, in sentences."""
        if self.zero_is_default:
            default = self.setting.default
            zero = "no limit" if math.isinf(default) else f"the default, {default:g}"
            return f"{self.setting.description} 0: {zero}."
        if self._has_infinite_bounds:
            bound = self.default[0]  # type: ignore[index]
            return f"{self.setting.description} {bound:g}: no bound."
        return self.setting.description

    @property
    def allowed(self) -> str:
        """The allowed values in words, with the unit."""
        return f"{self.setting.allowed}{', or 0' if self.zero_is_default else ''}"

    def setting_value(self, value: object) -> Any:
        """The value of the setting that a value of the parameter stands for.

        Raises:
            InvalidValue: if the type, the range, the choice or the length is wrong.
        """
        is_number = isinstance(value, (int, float)) and not isinstance(value, bool)
        if self.zero_is_default and is_number and value == 0:
            return self.setting.default
        if not self.setting.allows(value):
            raise InvalidValue(self.name, value, self.allowed)
        allowed = self.setting.checked(value)
        if self._has_infinite_bounds:
            return tuple(
                math.copysign(math.inf, number) if abs(number) >= NO_BOUND else number
                for number in allowed
            )
        return allowed

    def checked(self, value: object) -> ParameterValue:
        """:meth:`setting_value` as ROS holds it, such as an integer as the double it means."""
        return self._held(self.setting_value(value))

    @property
    def _has_infinite_bounds(self) -> bool:
        return isinstance(self.setting.default, tuple) and self.setting.allows_infinity

    def _held(self, value: Any) -> ParameterValue:
        """A value of the setting as ROS holds it."""
        if isinstance(value, Enum):
            return cast("str", value.value)
        if self._has_infinite_bounds:
            return tuple(min(max(number, -NO_BOUND), NO_BOUND) for number in value)
        if self.zero_is_default and value == self.setting.default:
            return 0.0
        return cast("ParameterValue", value)


def number_meant(text: object) -> object:
    """The number that ``ros2 param load`` turned into a string; anything else as it is.

    It hands 5e-05 on as ``"5e-05"`` and infinity as ``"inf"``. Other strings, such as ``"0.1"``,
    come from whoever wrote a string, and are no numbers.
    """
    if isinstance(text, str) and "." not in text:
        try:
            number = float(text)
        except ValueError:
            return text
        if repr(number) == text:
            return number
    return text


def parameter(default: Value, description: str, *, read_only: bool = True, **how: Any) -> Value:
    """A field of a dataclass that is a parameter; further arguments as :func:`setting`."""
    return setting(default, description, read_only=read_only, **how)


def changeable(default: Value, description: str, **how: Any) -> Value:
    """A :func:`parameter` that may be set while the node runs."""
    return setting(default, description, read_only=False, **how)


def parameters_of(
    settings: type[Settings], *, read_only: bool = True, names: Mapping[str, str] | None = None
) -> Settings:
    """A field of a dataclass that is a dataclass of settings, all of which are parameters.

    ``names`` has the names of parameters that differ from those of the settings.
    """
    included: Any = field(
        default_factory=settings,
        metadata={_INCLUDED: settings, _READ_ONLY: read_only, _NAMES: names or {}},
    )
    return cast("Settings", included)


def parameter_table(parameters: type) -> tuple[Parameter, ...]:
    """The parameters of a dataclass, in their order."""
    own = {entry.name: entry for entry in settings_of(parameters)}
    table: list[Parameter] = []
    for entry in fields(parameters):
        found = (own[entry.name],) if entry.name in own else _included(entry.metadata)
        table += (Parameter(one, entry.metadata[_READ_ONLY]) for one in found)
    return tuple(table)


def from_values(parameters: type[Settings], values: Mapping[str, object]) -> Settings:
    """The dataclass for values of its parameters, one each.

    Raises:
        AnnikError: if a value is not allowed, or contradicts another.
    """
    meant = {row.name: row.setting_value(values[row.name]) for row in parameter_table(parameters)}
    arguments: dict[str, Any] = {}
    for entry in fields(parameters):  # type: ignore[arg-type]
        if _INCLUDED not in entry.metadata:
            arguments[entry.name] = meant[entry.name]
            continue
        settings, names = entry.metadata[_INCLUDED], entry.metadata[_NAMES]
        arguments[entry.name] = settings(
            **{one.name: meant[names.get(one.name, one.name)] for one in settings_of(settings)}
        )
    return parameters(**arguments)


def _included(metadata: Mapping[str, Any]) -> tuple[Setting, ...]:
    return tuple(
        replace(one, name=metadata[_NAMES].get(one.name, one.name))
        for one in settings_of(metadata[_INCLUDED])
    )
