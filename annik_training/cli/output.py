"""Output of commands that train or evaluate a model."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click
import numpy as np
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from annik_core.safety import AcceptanceLimits

if TYPE_CHECKING:
    from annik_training import Evaluation, TrainedModel


def print_training(trained: TrainedModel) -> None:
    """Print the number of examples, the errors, and a warning if a node would refuse many."""
    fitted = trained.fitted
    left_out = f", {fitted.second_solutions} second solutions left out"
    Console().print(
        f"{len(fitted.dataset)} examples ({len(fitted.held_out)} held out to choose among "
        f"{len(fitted.restarts)} restarts{left_out if fitted.second_solutions else ''}), "
        f"{fitted.seconds:.1f} s"
    )
    Console().print(evaluation_table(trained.evaluation, str(trained.path)))
    _warn_of_refusals(trained.evaluation)


def evaluation_table(evaluation: Evaluation, title: str) -> Table:
    """Errors in percentiles, with what refinement makes of them as a caption."""
    position, orientation = evaluation.position_error, evaluation.orientation_error
    columns = ("rms", "p50", "p95", "p99", "max")
    # Escaped: to rich, a unit in brackets is markup.
    table = Table(
        "error", *columns, title=escape(title), caption=f"{evaluation.examples} random poses"
    )
    table.add_row(
        escape("position [mm]"), *(f"{1e3 * getattr(position, column):.5f}" for column in columns)
    )
    table.add_row(
        escape("orientation [deg]"),
        *(f"{np.degrees(getattr(orientation, column)):.6f}" for column in columns),
    )
    refined = evaluation.refined
    if refined is not None:
        table.caption = (
            f"{evaluation.examples} random poses, the network alone. Refined: "
            f"{100 * refined.success:.2f} % solved inside the joint box, at most "
            f"{1e9 * refined.position_residual:.0f} nm off; steps {refined.mean_steps:.1f} on "
            f"average, {refined.p99_steps:.0f} p99, {refined.max_steps} at most; "
            f"{100 * refined.same_solution:.2f} % by the joint positions the pose was made from"
        )
    return table


def _warn_of_refusals(evaluation: Evaluation) -> None:
    """Warn if a node would often refuse a solution of this model."""
    limits = AcceptanceLimits()
    refined = evaluation.refined
    if refined is not None:
        if refined.success < 0.95:
            click.echo(
                f"annik: {100 * (1 - refined.success):.1f} % of these poses were not solved; give "
                "more --examples, or a smaller joint box: annik robot shows it",
                err=True,
            )
    elif (
        evaluation.position_error.p95 > limits.max_position_residual
        or evaluation.orientation_error.p95 > limits.max_orientation_residual
    ):
        click.echo(
            "annik: more than 5 % of these poses are beyond what ik_node accepts by default "
            f"({1e3 * limits.max_position_residual:g} mm, "
            f"{limits.max_orientation_residual:g} rad) and would be refused; give more --examples "
            "or --steps, --restarts or --max-evaluations, or another --design",
            err=True,
        )
