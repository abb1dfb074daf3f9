"""results.json: the figures of the reproduction under stable names. Medians over the seeds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from annik_core.installation import annik_version
from annik_training.evaluation import ErrorSummary
from benchmarks.paper import paper_values as printed
from benchmarks.paper.efficiency_experiment import ACCURACIES, fewest_examples, least
from benchmarks.paper.example_sets import counts
from benchmarks.paper.function_experiment import FoldOutcome
from benchmarks.paper.interaction_experiment import (
    SEEDS_FACTOR,
    exact_ranks,
    median_errors,
    nonzero_examples,
)
from benchmarks.paper.reproduction import Measurements, PaperSettings
from benchmarks.paper.robot_experiment import RobotSetOutcome

#: Values of j for which the rank is computed: the paper's.
RANK_STEPS = (3, 6, 15, 18)


def results(measured: Measurements) -> dict[str, Any]:
    """Everything as plain data; see docs/paper.md for what the names mean."""
    return {
        "settings": _settings(measured.settings),
        "seconds": measured.seconds,
        "counts": {**counts(), "printed": printed.COUNTS},
        "table4": _table_4(measured.functions),
        "table9": _by_set(measured, _path_errors),
        "workspace": _by_set(measured, _workspace_errors),
        "training": _by_set(measured, _training_errors),
        "fewest": _fewest(measured),
        "blind": _blind(measured),
    }


def _settings(settings: PaperSettings) -> dict[str, Any]:
    return {
        "package_version": annik_version(),
        "seed": settings.seed,
        "seeds": settings.seeds,
        "max_evaluations": settings.max_evaluations,
        "training": "plain",
    }


def _table_4(functions: Mapping[str, Sequence[FoldOutcome]]) -> dict[str, Any]:
    table: dict[str, Any] = {
        method: {
            "mse": _median([fold.mean_square_error for fold in folds]),
            "range": _range([fold.mean_square_error for fold in folds]),
            "networks": len(folds),
            "training_mse_scaled": _median([fold.training_error for fold in folds]),
            "printed_mse": list(printed.TABLE_4[method]),
        }
        for method, folds in functions.items()
    }
    table["ratio"] = table["known"]["mse"] / table["thirty_phase"]["mse"]
    table["printed_ratio"] = float(
        np.median(printed.TABLE_4["known"]) / np.median(printed.TABLE_4["thirty_phase"])
    )
    return table


def _by_set(measured: Measurements, summary: Any) -> dict[str, Any]:
    return {
        method: {name: summary(measured.robot[method, name]) for name in printed.SETS}
        for method in printed.METHODS
    }


def _path_errors(outcome: RobotSetOutcome) -> dict[str, Any]:
    winner = outcome.starts[outcome.winner]
    first = printed.PRINTED_POINTS
    max9 = [float(start.path_position[:first].max()) for start in outcome.starts]
    max15 = [float(start.path_position.max()) for start in outcome.starts]
    orientation = [float(start.path_orientation.max()) for start in outcome.starts]
    return {
        "position_error_mm": {
            "max9": float(winner.path_position[:first].max()),
            "max15": float(winner.path_position.max()),
            "points": winner.path_position.tolist(),
            "median_over_seeds": _median(max9),
            "range": _range(max9),
            "max15_median_over_seeds": _median(max15),
            "max15_range": _range(max15),
        },
        "orientation_error_deg": {
            "max15": float(winner.path_orientation.max()),
            "points": winner.path_orientation.tolist(),
            "median_over_seeds": _median(orientation),
            "range": _range(orientation),
        },
    }


def _workspace_errors(outcome: RobotSetOutcome) -> dict[str, Any]:
    winner = outcome.starts[outcome.winner]
    position = [start.workspace_position for start in outcome.starts]
    orientation = [start.workspace_orientation for start in outcome.starts]
    return {
        "position_error_mm": {
            "rms": _median([ErrorSummary.of(errors).rms for errors in position]),
            "max": _median([float(errors.max()) for errors in position]),
            "rms_range": _range([ErrorSummary.of(errors).rms for errors in position]),
            "max_range": _range([float(errors.max()) for errors in position]),
            "chosen_network": {
                "rms": ErrorSummary.of(winner.workspace_position).rms,
                "max": float(winner.workspace_position.max()),
            },
        },
        "orientation_error_deg": {
            "rms": _median([ErrorSummary.of(errors).rms for errors in orientation]),
            "max": _median([float(errors.max()) for errors in orientation]),
        },
        "poses": len(winner.workspace_position),
    }


def _training_errors(outcome: RobotSetOutcome) -> dict[str, Any]:
    return {
        "training_mse_scaled": _median([s.restart.training_error for s in outcome.starts]),
        "held_out_mse_scaled": _median([s.restart.choosing_error for s in outcome.starts]),
        "chosen_start": outcome.winner,
    }


def _fewest(measured: Measurements) -> dict[str, Any]:
    found = fewest_examples(measured.fits)
    summary: dict[str, Any] = {}
    for accuracy in ACCURACIES:
        best = least(found, accuracy)
        entry = summary.setdefault(accuracy.system, {})
        entry[accuracy.name] = best.examples if best else None
        entry[f"{accuracy.name}_design"] = best.design if best else None
        entry[f"{accuracy.name}_training"] = best.training if best else None
        entry[f"{accuracy.name}_all"] = [
            {"design": few.design, "training": few.training, "examples": few.examples}
            for few in found
            if few.accuracy == accuracy
        ]
    return summary


def _blind(measured: Measurements) -> dict[str, Any]:
    ranks = exact_ranks(RANK_STEPS)
    errors = median_errors(measured.fits)
    nonzero = nonzero_examples()
    return {
        **{
            design: {
                # The same at every j; if ever it is not, the smallest is the honest one.
                "rank": min(by_steps.values()),
                "terms": 28,
                "rank_by_steps": {str(steps): rank for steps, rank in by_steps.items()},
                "examples_that_see_the_interaction": nonzero[design],
                "interaction_rms": {
                    training: by_design[design] for training, by_design in errors.items()
                },
            }
            for design, by_steps in ranks.items()
        },
        "interaction_seeds": SEEDS_FACTOR * measured.settings.seeds,
        "interaction_ratio": {
            training: by_design["thirty_phase"] / by_design["thirty_phase_plus"]
            for training, by_design in errors.items()
        },
    }


def _median(values: Sequence[float]) -> float:
    return float(np.median(values))


def _range(values: Sequence[float]) -> list[float]:
    return [float(min(values)), float(max(values))]
