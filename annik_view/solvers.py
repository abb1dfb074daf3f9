"""The solver for a robot or a model, by its name or file."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import numpy as np

from annik_core.installation import packaged_models
from annik_core.model.artifact import Model, load_model
from annik_core.pose import FloatArray
from annik_core.robots.library import load_robot, robot_from_definition
from annik_core.robots.robot import Robot
from annik_core.solver.ik_solver import IkSolver
from annik_core.solver.mode import SolverMode


@dataclass(frozen=True, eq=False)
class WithoutNetwork:
    """In place of a model, for an arm that none was trained for: the search finds its starts."""

    robot: Robot
    start_network: Any = None

    def after_encoding(self, name: str) -> None:
        """None: there is no network to run."""

    def start_at(self, pose: FloatArray) -> FloatArray:
        """No joint positions: NaN ``(dof,)``."""
        return np.full(self.robot.dof, np.nan)


def solver_of(
    name_or_path: str | Path,
    base_frame: str | None = None,
    end_effector_frame: str | None = None,
) -> IkSolver:
    """The solver for a packaged robot or model, a model file (.onnx), or a robot's file.

    An arm is solved anywhere within its joint limits, so without a model too. The frames are
    those of a URDF, as :func:`annik_core.robots.library.load_robot` takes them.

    Raises:
        AnnikError: if the file can't be used, or is a gantry without a model.
    """
    text = str(name_or_path)
    if text in packaged_models() or text.endswith(".onnx"):
        model = load_model(name_or_path)
        arm = model.robot.kind == "arm"
        return IkSolver(model, mode=SolverMode.WHOLE_ROBOT if arm else SolverMode.AUTO)
    robot = load_robot(name_or_path, base_frame=base_frame, end_effector_frame=end_effector_frame)
    return solver_for(robot)


def solver_for(robot: Robot) -> IkSolver:
    """The solver for an arm, or for the packaged gantry.

    Raises:
        AnnikError: if it is another gantry, which needs a model.
    """
    if robot.kind != "arm" and robot.name in packaged_models():
        solver = IkSolver(load_model(robot.name))
        if solver.robot.definition_hash == robot.definition_hash:
            return solver
    return IkSolver(cast(Model, WithoutNetwork(robot)), mode=SolverMode.WHOLE_ROBOT)


def nominal_of(robot: Robot) -> Robot | None:
    """A calibrated robot as it was described before; None if it is not calibrated."""
    if robot.definition.get("corrections") is None:
        return None
    return robot_from_definition(robot.nominal_definition, robot.name)
