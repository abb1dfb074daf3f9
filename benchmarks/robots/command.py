"""``./run bench robots``: options, page and data."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict
from pathlib import Path
from typing import Any

import click
from rich.progress import track

from annik_core.errors import AnnikError, one_line
from benchmarks.command_line import (
    FOLDER,
    chosen,
    docs_folder,
    docs_option,
    out_option,
    output_folders,
    quick_option,
    rewrite_page,
    write_results,
)
from benchmarks.conditions import Conditions, load
from benchmarks.markdown import markdown_table
from benchmarks.plain_data import built
from benchmarks.robots.folder import ArmFile, arms_of
from benchmarks.robots.measure import LARGE, ArmResult, RobotsSettings, measured_arm

PAGE, DATA = "robots.md", "robots.json"
_STANDARD = RobotsSettings()
_QUICK = RobotsSettings(poses=100, recall_poses=20, restarts=200, paths=5, points=20)
_ANSWERS = (
    "arm",
    "joints",
    "answered [%]",
    "of these right and within limits [%]",
    "recall of all solutions [%]",
    "poses with all solutions [%]",
    "solutions, mean",
    "first: median, p99 [us]",
    "all: median, p99 [us]",
)
_PATHS = (
    "arm",
    "paths followed to the end",
    "branch ends",
    "not converged",
    "ends where small steps go on",
    "points answered",
    "wrong",
    f"steps above {LARGE:g} x need",
    "largest step [rad or m]",
    "largest step / need",
)


@click.command()
@click.argument("folder", type=FOLDER, required=False)
@click.option("--poses", type=click.IntRange(1), help=f"Random (default {_STANDARD.poses}).")
@click.option(
    "--recall-poses",
    type=click.IntRange(1),
    help=f"Of these, for the recall (default {_STANDARD.recall_poses}).",
)
@click.option(
    "--restarts", type=click.IntRange(1), help=f"For each (default {_STANDARD.restarts})."
)
@click.option("--paths", type=click.IntRange(1), help=f"Lines (default {_STANDARD.paths}).")
@click.option("--points", type=click.IntRange(2), help=f"On each (default {_STANDARD.points}).")
@click.option("--jobs", type=click.IntRange(1), default=1, help="Arms at a time (default 1).")
@quick_option("Fewer poses and paths")
@click.option(
    "--page-only", is_flag=True, help="Measure nothing: write the page anew from its data."
)
@out_option("bench", "page and data")
@docs_option("page and data, in results/ there,")
def robots(
    folder: Path | None,
    jobs: int,
    quick: bool,
    page_only: bool,
    out: Path,
    docs: Path | None,
    **amounts: int | None,
) -> None:
    """Whole robots: every URDF of FOLDER, anywhere within its joint limits.

    An index.csv in FOLDER (name, base_frame, end_effector_frame) may name the frames; otherwise
    the longest chain of a URDF is taken. The documentation is written with --docs only.
    """
    if page_only:
        rewrite_page(docs, PAGE, DATA, page)
        return
    settings = chosen(_QUICK if quick else _STANDARD, amounts)
    docs = docs_folder(docs, standard=False, quick=quick)
    if folder is None:
        raise click.UsageError("name the folder with the URDFs")
    folders = output_folders(out, docs)
    load_before, results, refused = load(), [], {}
    arms = arms_of(folder)
    with ProcessPoolExecutor(jobs) as pool:
        measured = [pool.submit(_result_or_reason, arm, settings) for arm in arms]
        for arm, future in track(list(zip(arms, measured, strict=True)), "arms"):
            result = future.result()
            if isinstance(result, ArmResult):
                results.append(result)
            else:
                refused[arm.name] = result
    data = {
        "settings": asdict(settings),
        "arms": [asdict(result) for result in results],
        "refused": refused,
        "conditions": str(Conditions.now(("numpy", "scipy"), load_before)),
    }
    text = page(data)
    click.echo(text)
    content = json.dumps(data, indent=2, allow_nan=False) + "\n"
    write_results(folders, {PAGE: text, DATA: content})


def _result_or_reason(arm: ArmFile, settings: RobotsSettings) -> ArmResult | str:
    """What is measured, or why annik refuses the arm."""
    try:
        return measured_arm(arm, settings)
    except AnnikError as error:
        return one_line(error)


def page(data: Mapping[str, Any]) -> str:
    """The page of the results."""
    settings: RobotsSettings = built(RobotsSettings, data["settings"])
    arms: Sequence[ArmResult] = [_arm(entry) for entry in data["arms"]]
    recalls = [arm.recall for arm in arms if arm.recall is not None]
    mean = (
        f" The mean recall of the {len(recalls)} arms with up to six joints is "
        f"{_percent(sum(recalls) / len(recalls))} %."
        if recalls
        else ""
    )
    refused = [f"\n{name} is refused: {reason}" for name, reason in data["refused"].items()]
    lines = [
        "<!-- Written by ./run bench robots -->",
        "",
        f"{settings.poses:,} random poses of each arm, from joint positions anywhere within its "
        f"limits. Recall: on {min(settings.recall_poses, settings.poses):,} of them, against "
        f"{settings.restarts:,} random starts each of an independent Newton's method and what "
        f"the search itself finds.{mean} Times are of the processor, in Python.",
        "",
        f"{data['conditions']}",
        "",
        markdown_table(_ANSWERS, [_answers(arm) for arm in arms], len(_ANSWERS) - 2),
        "",
        f"{settings.paths} paths of {settings.points} points.",
        "",
        markdown_table(_PATHS, [_path_row(arm) for arm in arms], len(_PATHS) - 1),
        *refused,
    ]
    return "\n".join(lines) + "\n"


def _arm(entry: Mapping[str, Any]) -> ArmResult:
    arm: ArmResult = built(ArmResult, entry)
    return arm


def _answers(arm: ArmResult) -> tuple[str, ...]:
    return (
        arm.name,
        f"{len(arm.joints)}: {arm.joints}",
        _percent(arm.answered),
        _percent(arm.right),
        "" if arm.recall is None else _percent(arm.recall),
        "" if arm.complete is None else _percent(arm.complete),
        f"{arm.solutions:.1f}",
        ", ".join(f"{spent:.0f}" for spent in arm.first),
        ", ".join(f"{spent:.0f}" for spent in arm.every),
    )


def _path_row(arm: ArmResult) -> tuple[str, ...]:
    paths = arm.paths
    return (
        arm.name,
        f"{paths.whole} of {paths.paths}",
        f"{paths.branch_ends}",
        f"{paths.not_converged}",
        f"{paths.too_early}",
        f"{paths.answered:,} of {paths.asked:,}",
        f"{paths.wrong}",
        f"{paths.large_steps}",
        f"{paths.largest_step:.3f}",
        f"{paths.largest_ratio:.2f}",
    )


def _percent(share: float) -> str:
    """Two digits after the point; never 100 for less than all."""
    return "100" if share == 1.0 else f"{int(1e4 * share + 1e-9) / 100:.2f}"
