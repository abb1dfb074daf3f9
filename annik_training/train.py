"""From a robot to a model file: design, dataset, fit, evaluation, export, in one call."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from annik_core.dataset import Dataset
from annik_core.files import ensure_writable_folder
from annik_core.robots.robot import Robot
from annik_training.designs.sampling import compute_random_dataset
from annik_training.evaluation import Evaluation, evaluate
from annik_training.export import export_model
from annik_training.fitting.fit import FittedNetwork, Restart, fit
from annik_training.fitting.options import FitOptions

EVALUATION_POSES = 5000


@dataclass(frozen=True, eq=False)
class TrainingResult:
    """A written model and what is known of it."""

    path: Path
    fitted: FittedNetwork
    evaluation: Evaluation


def train(
    dataset: Dataset,
    path: Path,
    options: FitOptions,
    on_restart: Callable[[Restart], None] | None = None,
) -> TrainingResult:
    """Fit a network to a dataset, evaluate it, and write the model file.

    The evaluation is on :data:`EVALUATION_POSES` fresh random poses of the joint box; it is
    reported and stored, and chooses nothing.

    Args:
        dataset: the examples.
        path: the ``.onnx`` file to write.
        options: how to fit.
        on_restart: told of each start as it ends.

    Raises:
        TooFewExamples: see :func:`annik_training.fitting.fit.fit`.
        ExportMismatch: see :func:`annik_training.export.export_model`.
        NotWritable: if the file can't be written.
    """
    # Before the fit, not after it.
    ensure_writable_folder(path.parent)
    fitted = fit(dataset, options, on_restart)
    evaluation = evaluate(
        fitted.network.joint_positions, evaluation_dataset(dataset.robot, options.seed)
    )
    export_model(fitted, evaluation, path)
    return TrainingResult(path, fitted, evaluation)


def evaluation_dataset(robot: Robot, seed: int) -> Dataset:
    """The random poses that a model is evaluated on, drawn apart from everything else."""
    entropy = np.random.SeedSequence([seed, EVALUATION_POSES]).generate_state(1)[0]
    return compute_random_dataset(robot, robot.joint_box, EVALUATION_POSES, int(entropy))
