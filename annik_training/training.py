"""From a dataset to a model file: fit, evaluation and export in one call."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from annik_core.dataset import Dataset
from annik_core.files import ensure_writable_folder
from annik_training.defaults import DEFAULT_EVALUATION_POSES, defaults_of
from annik_training.evaluation import Evaluation, evaluation_dataset, network_errors
from annik_training.export import export_model
from annik_training.fitting.fit import FittedNetwork, Restart, fit
from annik_training.fitting.options import FitOptions


@dataclass(frozen=True, eq=False)
class TrainedModel:
    """A model file, with its network and its errors."""

    path: Path
    fitted: FittedNetwork  #: the network, all restarts and the dataset
    evaluation: Evaluation  #: errors at random poses; the file carries it too


def train(
    dataset: Dataset,
    path: str | Path,
    options: FitOptions | None = None,
    *,
    evaluation_poses: int = DEFAULT_EVALUATION_POSES,
    on_restart: Callable[[Restart], None] | None = None,
) -> TrainedModel:
    """Fit a network to a dataset, evaluate it, and write the model file (``.onnx``).

    The evaluation is on fresh random poses of the joint box; it chooses nothing. The options are
    those for the kind of robot, unless given. ``on_restart`` is called with each restart when it
    ends, such as for a progress bar.

    Raises:
        TooFewExamples: see :func:`annik_training.fitting.fit.fit`.
        ExportMismatch: see :func:`annik_training.export.export_model`.
        NotWritable: if the file can't be written; checked before the fit.
    """
    path = Path(path)
    # Before the fit, not after it.
    ensure_writable_folder(path.parent)
    options = options or defaults_of(dataset.robot).fit
    fitted = fit(dataset, options, on_restart)
    unseen = evaluation_dataset(dataset.robot, evaluation_poses, options.seed)
    evaluation = network_errors(fitted.network.joint_positions, unseen).summary()
    export_model(fitted, evaluation, path)
    return TrainedModel(path, fitted, evaluation)
