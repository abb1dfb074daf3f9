"""The tables of the reproduction as CSV, with all digits."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from annik_training.evaluation import ErrorSummary
from benchmarks.paper import paper_values as printed
from benchmarks.paper.efficiency_experiment import fewest_examples
from benchmarks.paper.example_sets import counts
from benchmarks.paper.function_experiment import test_diagonal
from benchmarks.paper.reproduction import Measurements


def csv_tables(measured: Measurements) -> dict[str, bytes]:
    """All tables: file name to content. Units are in the column names."""
    return {
        "counts.csv": _counts(),
        "table4.csv": _table_4(measured),
        "tables5_6.csv": _tables_5_and_6(measured),
        "table9.csv": _table_9(measured),
        "workspace.csv": _workspace(measured),
        "fewest.csv": _fewest(measured),
        "fits.csv": _fits(measured),
    }


def _counts() -> bytes:
    found = counts()
    rows = [
        (method, name, found[method][name], printed.COUNTS[method][name])
        for method in printed.METHODS
        for name in (*printed.SETS, "section2")
    ]
    return _csv(("method", "set", "examples", "printed"), rows)


def _table_4(measured: Measurements) -> bytes:
    rows = [
        (method, number, fold.training_error, fold.mean_square_error)
        for method, folds in measured.functions.items()
        for number, fold in enumerate(folds)
    ]
    return _csv(("method", "network", "training_mse_scaled", "test_mse"), rows)


def _tables_5_and_6(measured: Measurements) -> bytes:
    degrees = np.degrees(test_diagonal()[:, 0])
    rows = []
    for method, folds in measured.functions.items():
        middle = np.median([np.abs(fold.test_errors) for fold in folds], axis=0)
        rows += [
            (method, round(float(angle), 6), *errors)
            for angle, errors in zip(degrees, middle, strict=True)
        ]
    columns = [f"f{output}_median_absolute_error" for output in range(1, 7)]
    return _csv(("method", "q_deg", *columns), rows)


def _table_9(measured: Measurements) -> bytes:
    rows: list[Sequence[Any]] = []
    for (method, name), outcome in sorted(measured.robot.items()):
        values = printed.TABLE_9[method][name]
        all_starts = np.array([start.path_position for start in outcome.starts])
        winner = outcome.starts[outcome.winner]
        for point in range(all_starts.shape[1]):
            errors = all_starts[:, point]
            rows.append(
                (
                    method,
                    name,
                    point + 1,
                    values[point] if point < len(values) else "",
                    errors[outcome.winner],
                    np.median(errors),
                    errors.min(),
                    errors.max(),
                    winner.path_orientation[point],
                )
            )
    return _csv(
        (
            "method",
            "set",
            "point",
            "printed_position_error_mm",
            "chosen_position_error_mm",
            "median_position_error_mm",
            "least_position_error_mm",
            "greatest_position_error_mm",
            "chosen_orientation_error_deg",
        ),
        rows,
    )


def _workspace(measured: Measurements) -> bytes:
    rows = [
        (
            method,
            name,
            number,
            number == outcome.winner,
            start.restart.training_error,
            start.restart.held_out_error,
            ErrorSummary.of(start.workspace_position).rms,
            start.workspace_position[-1],
            ErrorSummary.of(start.workspace_orientation).rms,
            start.workspace_orientation[-1],
        )
        for (method, name), outcome in sorted(measured.robot.items())
        for number, start in enumerate(outcome.starts)
    ]
    return _csv(
        (
            "method",
            "set",
            "start",
            "chosen",
            "training_mse_scaled",
            "held_out_mse_scaled",
            "position_rms_mm",
            "position_max_mm",
            "orientation_rms_deg",
            "orientation_max_deg",
        ),
        rows,
    )


def _fewest(measured: Measurements) -> bytes:
    rows = [
        (few.accuracy.system, few.accuracy.name, few.design, few.training, few.examples)
        for few in fewest_examples(measured.fits)
    ]
    return _csv(("system", "accuracy", "design", "training", "examples"), rows)


def _fits(measured: Measurements) -> bytes:
    rows = [
        (
            job.system,
            job.design,
            outcome.examples,
            job.training,
            job.seed,
            outcome.training_error,
            outcome.error.rms,
            outcome.error.max,
        )
        for job, outcome in measured.fits.items()
    ]
    return _csv(
        (
            "system",
            "design",
            "examples",
            "training",
            "seed",
            "training_mse_scaled",
            "error_rms",
            "error_max",
        ),
        rows,
    )


def _csv(columns: Sequence[str], rows: Iterable[Sequence[Any]]) -> bytes:
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows(rows)
    return stream.getvalue().encode()
