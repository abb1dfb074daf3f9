"""Training and calibration: from a robot or measured poses to a model file. See docs/api.md.

The names below are loaded on first use, since torch is slow to load.
"""

from typing import TYPE_CHECKING

from annik_core.lazy import lazy_names

if TYPE_CHECKING:
    from annik_training.calibration.calibrate import CalibratedRobot, CalibrationOptions, calibrate
    from annik_training.designs.registry import design_names, generate_dataset, make_design
    from annik_training.evaluation import Evaluation, evaluate
    from annik_training.fitting.options import FitOptions
    from annik_training.training import TrainedModel, train

__all__ = [
    "CalibratedRobot",
    "CalibrationOptions",
    "Evaluation",
    "FitOptions",
    "TrainedModel",
    "calibrate",
    "design_names",
    "evaluate",
    "generate_dataset",
    "make_design",
    "train",
]

_NAMES = {
    "calibration.calibrate": ("CalibratedRobot", "CalibrationOptions", "calibrate"),
    "designs.registry": ("design_names", "generate_dataset", "make_design"),
    "evaluation": ("Evaluation", "evaluate"),
    "fitting.options": ("FitOptions",),
    "training": ("TrainedModel", "train"),
}
__getattr__, __dir__ = lazy_names(__name__, _NAMES)
