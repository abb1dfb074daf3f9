"""All of annik in one command: train, serve, drive the fake robot, record, report.

Each part runs as its user would run it, in a process of its own: the ``annik`` command line for
the training, the four nodes over DDS.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import click
from rich.console import Console

from annik_core.errors import AnnikError, InvalidValue
from annik_core.files import write_files_atomically
from annik_core.model.artifact import load_model
from examples.demonstration import (
    drive,
    emptied,
    out_option,
    processes,
    run_demonstration,
)
from msg_tools.report.table import print_report
from msg_tools.report.write import write_report

#: A target every 2 mm of the paper's diagonal; each tenth is one of its 15 points.
POINTS = 141
RATE = 50.0
STEPS = 6

_TRAINING_TIMEOUT = 600.0


def run_demo(folder: Path, model: str | None, console: Console) -> str:
    """Run the demo.

    Args:
        folder: for ``model.onnx``, ``bag/``, ``report.html``, pictures, ``results.json`` and the
            ``logs/`` of the processes. The files of an earlier demo there are removed.
        model: name of a packaged model, or path of a model file, whose robot to drive; None: the
            gantry, with a model trained now.
        console: for progress messages.

    Returns:
        Where the results are.

    Raises:
        AnnikError: if a part fails, naming it and showing the end of its log; or if not every
            target was followed.
    """
    file = folder / "model.onnx" if model is None else load_model(model).path.resolve()
    if model is not None and file.is_relative_to(folder):
        raise InvalidValue("--model", model, f"a file outside {folder}, which is emptied")
    with emptied(folder) as logs:
        return _run(folder, logs, file, model, console)


def _run(folder: Path, logs: Path, file: Path, model: str | None, console: Console) -> str:
    bag = folder / "bag"
    training = _train(file, logs, console) if model is None else None
    diagonal = "the paper's diagonal" if model is None else f"a diagonal for {model}"
    console.print(f"driving the fake robot along {POINTS} targets of {diagonal}")
    with processes(logs) as started:
        served: dict[str, object] = {"model": file}
        path: dict[str, object] = {**served, "path": "diagonal", "points": POINTS}
        drive(started, "", bag, POINTS, RATE, served, served, path)
    console.print("reporting")
    report = write_report(bag, folder)
    print_report(report, console)
    results = {**report.to_dict(), **({} if training is None else {"training": training})}
    text = json.dumps(results, indent=2) + "\n"
    write_files_atomically(folder, {"results.json": text.encode()})
    if len(report.targets) < POINTS:
        raise AnnikError(
            f"only {len(report.targets)} of {POINTS} targets were followed; {report.why_refused} "
            f"The report: {folder / 'report.html'}"
        )
    return f"report: {folder / 'report.html'}   bag: {bag}"


def _train(model: Path, logs: Path, console: Console) -> dict[str, Any]:
    summary = model.with_name("training.json")
    with (
        console.status("training on the paper's 30-phase design"),
        processes(logs) as started,
    ):
        started.annik(
            "train",
            *("train", "--robot", "gantry", "--design", "thirty_phase", "--steps", str(STEPS)),
            *("--out", str(model), "--summary", str(summary)),
        ).wait(_TRAINING_TIMEOUT)
    training: dict[str, Any] = json.loads(summary.read_text(encoding="utf-8"))
    console.print(f"trained on {training['examples']} examples in {training['seconds']:.1f} s")
    return training


@click.command()
@click.option(
    "--model", help="Packaged model or model file to drive with; by default the gantry is trained."
)
@out_option("build/demo")
def main(model: str | None, out: Path) -> None:
    """Train on 179 examples, drive the fake robot over ROS 2, record and report."""
    run_demonstration("demo", lambda console: run_demo(out, model, console))


if __name__ == "__main__":
    main()
