"""Output of commands that train or evaluate a model."""

import math
from collections.abc import Iterable
from typing import TYPE_CHECKING, TypeVar

import click
import numpy as np
from rich.console import Console
from rich.markup import escape
from rich.progress import track
from rich.table import Table

from annik_core.model.metadata import quality_of

if TYPE_CHECKING:
    from annik_training import Evaluation, TrainedModel
    from annik_training.evaluation import SearchTimes


_Item = TypeVar("_Item")


def shown_progress(items: Iterable[_Item], what: str, total: int | None) -> Iterable[_Item]:
    """The same items, with a bar on stderr while they come by, if that is a terminal."""
    console = Console(stderr=True)
    hidden = not console.is_terminal
    return track(items, what, total, console=console, transient=True, disable=hidden)


def print_training(trained: "TrainedModel") -> None:
    """Print the number of examples and the evaluation."""
    fitted = trained.fitted
    left_out = f", {fitted.second_solutions} second solutions left out"
    click.echo(
        f"{len(fitted.dataset)} examples ({len(fitted.held_out)} held out to choose among "
        f"{len(fitted.restarts)} restarts{left_out if fitted.second_solutions else ''}), "
        f"{fitted.seconds:.1f} s"
    )
    print_evaluation(trained.evaluation, str(trained.path))


def print_search_times(times: "SearchTimes") -> None:
    """Print how long a whole robot's solutions take, and how many they are."""
    first, every = 1e6 * times.first, 1e6 * times.every
    click.echo(
        f"first solution: median {np.median(first):.0f} us, p99 {np.percentile(first, 99):.0f}; "
        f"all solutions: median {np.median(every):.0f} us, p99 {np.percentile(every, 99):.0f}, "
        f"{times.counts.mean():.1f} a pose ({len(first)} poses)"
    )


def print_evaluation(evaluation: "Evaluation", title: str) -> None:
    """Print what a node solves with a model, the errors of its network, and what makes it poor."""
    quality = quality_of(evaluation.to_dict())
    refined = evaluation.refined
    click.echo(f"{title}: {quality.summary}")
    if refined is not None:
        click.echo(
            f"refined by {refined.mean_steps:.1f} steps ({refined.max_steps} at most), then at "
            f"most {1e9 * refined.position_residual:.0f} nm off"
        )
    whole = evaluation.whole_robot
    if whole is not None:
        click.echo(
            "whole robot: solutions on every branch, without a joint box, at most "
            f"{1e9 * whole.position_residual:.0f} nm off; the network is only the first guess of "
            f"the search, {1e3 * evaluation.position_error.p50:.0f} mm off in the median"
        )
    else:
        _print_network_errors(evaluation)
    for concern in quality.concerns:
        click.echo(f"annik: {concern}", err=True)


def _print_network_errors(evaluation: "Evaluation") -> None:
    table = Table("error", *vars(evaluation.position_error), title="the network alone")
    table.caption = f"{evaluation.examples} random poses of the joint box"
    for name, error, factor in (
        ("position [mm]", evaluation.position_error, 1e3),
        ("orientation [deg]", evaluation.orientation_error, 180.0 / math.pi),
    ):
        # Escaped: to rich, a unit in brackets is markup.
        table.add_row(escape(name), *(f"{factor * value:.4g}" for value in vars(error).values()))
    Console().print(table)
