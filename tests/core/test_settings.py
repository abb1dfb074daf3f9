"""Fields that carry unit, range and sentence. Needs no ROS."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum

import numpy as np
import pytest

from annik_core.collection.settings import CollectionSettings
from annik_core.errors import InvalidValue
from annik_core.safety import AcceptanceLimits, CommandSafety
from annik_core.settings import Setting, check_settings, setting, settings_of
from annik_core.simulation.imperfections import ImperfectionMagnitudes, Imperfections
from annik_core.solver.result import RefinementOptions
from annik_core.target_paths import TargetPath


class _Colour(Enum):
    RED = "red"
    BLUE = "blue"


@dataclass(frozen=True)
class _Example:
    other: int = 0
    switch: bool = setting(False, "A switch.")
    number: int = setting(3, "A number.", within=(1, 5))
    many: int = setting(3, "A number.", within=(1, 10_000_000))
    length: float = setting(0.5, "A length.", unit="m", within=(0.0, 1.0))
    share: float = setting(0.5, "A share.", greater_than=0.0, within=(None, 1.0))
    limit: float = setting(math.inf, "A limit.", greater_than=0.0, within=(None, math.inf))
    time: float = setting(1.0, "A time.", unit="s", within=(0.0, None))
    any: float = setting(1.0, "Any number.")
    colour: str = setting("red", "A colour.", choices=("red", "blue"))
    member: _Colour = setting(_Colour.RED, "A colour.")
    text: str = setting("", "A text.")
    place: tuple[float, ...] = setting((0.0, 0.0, 0.0), "A place.", unit="m")
    bound: tuple[float, ...] = setting(
        (math.inf, math.inf), "A bound.", within=(-math.inf, math.inf)
    )
    names: tuple[str, ...] = setting(("a",), "Names.")


EXAMPLE = {entry.name: entry for entry in settings_of(_Example)}


@pytest.mark.parametrize(
    ("name", "allowed"),
    [
        ("switch", "true or false"),
        ("number", "an integer from 1 to 5"),
        ("many", "an integer from 1 to 10000000"),
        ("length", "a number from 0 to 1 [m]"),
        ("share", "a number greater than 0, at most 1"),
        ("limit", "a number greater than 0"),
        ("time", "a finite number of at least 0 [s]"),
        ("any", "a finite number"),
        ("colour", "one of red, blue"),
        ("member", "one of red, blue"),
        ("text", "a string"),
        ("place", "3 finite numbers [m]"),
        ("bound", "2 numbers"),
        ("names", "a list of strings"),
    ],
)
def test_what_is_allowed_is_said_in_words(name: str, allowed: str) -> None:
    assert EXAMPLE[name].allowed == allowed


@pytest.mark.parametrize(
    ("name", "given", "value"),
    [
        ("switch", True, True),
        ("number", 5, 5),
        ("number", np.int64(5), 5),
        ("length", 1, 1.0),
        ("length", 0.25, 0.25),
        ("length", np.float64(0.25), 0.25),
        ("limit", math.inf, math.inf),
        ("colour", "blue", "blue"),
        ("member", "blue", _Colour.BLUE),
        ("member", _Colour.BLUE, _Colour.BLUE),
        ("place", [1, 2, 3], (1.0, 2.0, 3.0)),
        ("place", np.array([0.5, 1.5, 2.5]), (0.5, 1.5, 2.5)),
        ("bound", (-math.inf, 1), (-math.inf, 1.0)),
        ("names", ["b", "c"], ("b", "c")),
        ("names", [], ()),
    ],
)
def test_an_allowed_value_has_the_type_of_the_default(
    name: str, given: object, value: object
) -> None:
    checked = EXAMPLE[name].checked(given)
    assert checked == value
    assert type(checked) is type(value)


@pytest.mark.parametrize(
    ("name", "given"),
    [
        ("switch", 1),
        ("switch", "true"),
        ("number", 0),
        ("number", 6),
        ("number", 2.0),
        ("number", True),
        ("length", -0.1),
        ("length", math.nan),
        ("length", math.inf),
        ("length", "0.5"),
        ("length", False),
        ("length", None),
        ("share", 0.0),
        ("share", 1.1),
        ("limit", 0.0),
        ("limit", -math.inf),
        ("limit", math.nan),
        ("time", math.inf),
        ("any", -math.inf),
        ("colour", "green"),
        ("colour", 1),
        ("member", "green"),
        ("text", 1),
        ("place", [1.0, 2.0]),
        ("place", [1.0, 2.0, math.nan]),
        ("place", [1.0, 2.0, math.inf]),
        ("place", [True, 2.0, 3.0]),
        ("place", ["1", "2", "3"]),
        ("place", "abc"),
        ("place", 1.0),
        ("place", None),
        ("bound", (math.nan, 1.0)),
        ("names", "abc"),
        ("names", [1]),
    ],
)
def test_any_other_value_is_refused(name: str, given: object) -> None:
    with pytest.raises(InvalidValue) as caught:
        EXAMPLE[name].checked(given)
    assert caught.value.name == name
    assert caught.value.value is given
    assert caught.value.allowed == EXAMPLE[name].allowed


def test_the_first_setting_of_an_instance_that_is_not_allowed_is_named() -> None:
    check_settings(_Example())
    check_settings(_Example(other="not a setting"))  # type: ignore[arg-type]
    with pytest.raises(InvalidValue) as caught:
        check_settings(_Example(number=9, length=9.0))
    assert caught.value.name == "number"


SETTINGS = (
    AcceptanceLimits,
    CommandSafety,
    RefinementOptions,
    CollectionSettings,
    ImperfectionMagnitudes,
    Imperfections,
    TargetPath,
)


@pytest.mark.parametrize(
    "entry",
    [entry for settings in SETTINGS for entry in settings_of(settings)],
    ids=lambda entry: entry.name,
)
def test_every_setting_has_a_sentence_and_an_allowed_default(entry: Setting) -> None:
    assert entry.description.endswith(".")
    assert entry.allows(entry.default)
