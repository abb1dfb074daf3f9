"""The evaluation that a model carries says whether it is poor, ambiguous or redundant."""

from __future__ import annotations

import math
from typing import Any

import pytest

from annik_core.model.artifact import load_model, packaged_models
from annik_core.model.metadata import Quality, quality_of


def refined(success: float, same: float, **others: Any) -> Quality:
    return quality_of({"refined": {"success": success, "same_solution": same}, **others})


@pytest.mark.parametrize("name", packaged_models())
def test_packaged_models_are_of_no_concern(name: str) -> None:
    quality = load_model(name).quality
    assert quality.concerns == []
    assert quality.summary.startswith("100 % of random poses solved")


@pytest.mark.parametrize(
    ("success", "same", "words"),
    [
        (1.0, 1.0, []),
        (0.995, 0.95, []),
        (0.9949, 0.97, ["poor: "]),
        (0.996, 0.9499, ["ambiguous: "]),
        (0.96, 0.03, ["poor: ", "ambiguous: "]),
        (0.0, 0.0, ["poor: ", "ambiguous: "]),
    ],
)
def test_thresholds(success: float, same: float, words: list[str]) -> None:
    concerns = refined(success, same).concerns
    assert len(concerns) == len(words)
    for concern, start in zip(concerns, words, strict=True):
        assert concern.startswith(start)


def test_a_network_that_is_a_rough_start_is_said() -> None:
    """Such as one of a single unit, whose poses are all solved by the refinement."""
    evaluation = {"success": 1.0, "same_solution": 1.0, "mean_steps": 3.4}
    assert quality_of({"refined": evaluation}).concerns[0].startswith("rough: ")
    assert quality_of({"refined": {**evaluation, "mean_steps": 3.0}}).concerns == []


def test_percentages_are_rounded_down() -> None:
    assert refined(0.99999, 0.99999).summary.startswith("99.99 % of random poses solved, 99.99 %")
    assert refined(0.57, 0.29).summary.startswith("57 % of random poses solved, 29 %")


def test_redundant_joints_are_named() -> None:
    concern = refined(1.0, 1.0, redundant_joints=["lift", "slide"]).concerns
    assert concern[0].startswith("redundant: lift, slide; ")
    assert refined(1.0, 1.0, redundant_joints=[]).concerns == []


def test_of_a_network_alone() -> None:
    assert quality_of({"accepted": 0.999}).concerns == []
    assert quality_of({"accepted": 0.4}).concerns[0].startswith("poor: ")


def test_of_an_older_file() -> None:
    """It has percentiles only."""
    errors = {"position_error_m": {"max": 1e-6}, "orientation_error_rad": {"max": 1e-5}}
    assert quality_of(errors) == Quality("100 % of random poses solved", [])
    errors["position_error_m"]["max"] = 2e-3
    assert quality_of(errors) == Quality("unknown", [])


@pytest.mark.parametrize(
    "evaluation",
    [
        {},
        {"refined": None},
        {"refined": []},
        {"refined": {}},
        {"refined": {"success": "all", "same_solution": [1]}},
        {"accepted": None, "position_error_m": 3, "orientation_error_rad": "x"},
        {"redundant_joints": "abc"},
        {"redundant_joints": {"a": 1}},
    ],
)
def test_of_anything_else_nothing_is_said(evaluation: dict[str, Any]) -> None:
    assert quality_of(evaluation) == Quality("unknown", [])


def test_a_list_without_end_is_cut() -> None:
    assert len(str(quality_of({"redundant_joints": ["joint"] * 100_000}))) < 1000


@pytest.mark.parametrize("number", [1e305, -1e305, 7.0, -0.5])
def test_numbers_that_are_no_part_are_told_all_the_same(number: float) -> None:
    assert refined(number, number).summary


@pytest.mark.parametrize(
    ("answered", "concerns"), [(1.0, []), (0.995, []), (0.9949, ["poor: "]), (0.0, ["poor: "])]
)
def test_of_a_whole_robot(answered: float, concerns: list[str]) -> None:
    """Neither a joint box nor redundant joints concern it."""
    whole = {"answered": answered, "right": answered}
    quality = quality_of({"whole_robot": whole, "redundant_joints": ["lift", "slide"]})
    assert quality.summary.startswith(f"{math.floor(1e4 * answered) / 100:g} % of random poses")
    assert [concern[:6] for concern in quality.concerns] == concerns
    assert quality_of({"whole_robot": {"answered": "all"}}) == Quality("unknown", [])
