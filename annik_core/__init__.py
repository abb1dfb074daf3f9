"""Robots, model files, solver and checks; no ROS, no torch. See docs/api.md.

The names below are loaded on first use: a node joins the graph before it loads onnxruntime.
"""

from typing import TYPE_CHECKING

from annik_core.lazy import lazy_names

if TYPE_CHECKING:
    from annik_core.dataset import Dataset, load_dataset, save_dataset
    from annik_core.errors import AnnikError
    from annik_core.installation import packaged_models
    from annik_core.model.artifact import Model, load_model
    from annik_core.robots.library import load_robot, packaged_robots
    from annik_core.robots.robot import Robot
    from annik_core.safety import AcceptanceLimits, CommandSafety, IkStatus
    from annik_core.serving.ik_server import IkServer
    from annik_core.solver.ik_solver import IkSolver
    from annik_core.solver.mode import SolverMode
    from annik_core.solver.result import IkResult, RefinementOptions

__all__ = [
    "AcceptanceLimits",
    "AnnikError",
    "CommandSafety",
    "Dataset",
    "IkResult",
    "IkServer",
    "IkSolver",
    "IkStatus",
    "Model",
    "RefinementOptions",
    "Robot",
    "SolverMode",
    "load_dataset",
    "load_model",
    "load_robot",
    "packaged_models",
    "packaged_robots",
    "save_dataset",
]

_NAMES = {
    "dataset": ("Dataset", "load_dataset", "save_dataset"),
    "errors": ("AnnikError",),
    "installation": ("packaged_models",),
    "model.artifact": ("Model", "load_model"),
    "robots.library": ("load_robot", "packaged_robots"),
    "robots.robot": ("Robot",),
    "safety": ("AcceptanceLimits", "CommandSafety", "IkStatus"),
    "serving.ik_server": ("IkServer",),
    "solver.ik_solver": ("IkSolver",),
    "solver.mode": ("SolverMode",),
    "solver.result": ("IkResult", "RefinementOptions"),
}
__getattr__, __dir__ = lazy_names(__name__, _NAMES)
