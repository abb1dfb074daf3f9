"""Training and calibration: from a robot or measured poses to a model file. See docs/api.md.

The names below are loaded on first use, since torch is slow to load.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from annik_training.calibration.calibrate import CalibratedRobot, CalibrationOptions, calibrate
    from annik_training.designs.registry import design_names, make_design
    from annik_training.designs.sampling import generate_dataset
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
    "designs.registry": ("design_names", "make_design"),
    "designs.sampling": ("generate_dataset",),
    "evaluation": ("Evaluation", "evaluate"),
    "fitting.options": ("FitOptions",),
    "training": ("TrainedModel", "train"),
}
_MODULES = {name: module for module, names in _NAMES.items() for name in names}


def __getattr__(name: str) -> Any:
    """Load a public name on first use (PEP 562)."""
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(import_module(f"{__name__}.{_MODULES[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """The public names, for completion."""
    return sorted(__all__)
