"""The parameters of ``example_collector``. Needs no ROS."""

import math
from dataclasses import dataclass
from pathlib import Path

from annik_core.collection.settings import CollectionSettings
from annik_core.errors import InvalidValue
from annik_core.files import expanded
from annik_core.robots.library import load_robot
from annik_core.robots.robot import Robot
from annik_ros.parameters import parameter, parameters_of


@dataclass(frozen=True)
class ExampleCollectorParameters:
    """Parameters of ``example_collector``."""

    plan: str = parameter(
        "",
        "Path of the dataset whose joint positions to measure at, as annik design --out writes "
        "it; required without by_hand.",
    )
    dataset: str = parameter(
        "",
        "Path of the dataset (.npz) to write; required without by_hand. Beside it is the journal, "
        "NAME.journal.jsonl, from which an interrupted collection continues.",
    )
    by_hand: str = parameter(
        "",
        "Path of a file, such as measured/placement_0/hole_0.csv: nothing is commanded; ~/record "
        "adds the joint positions of an arm that a person guides, where it stands still.",
    )
    robot: str = parameter(
        "",
        "With by_hand: packaged robot, or path of a robot definition or URDF, whose joints are "
        "recorded.",
    )
    base_frame: str = parameter("", "Of this URDF: see fake_robot.")
    end_effector_frame: str = parameter("", "Of this URDF: see fake_robot.")
    settings: CollectionSettings = parameters_of(CollectionSettings)
    wait_timeout: float = parameter(
        60.0,
        "How long to wait at the start for joint_states, measured_pose and a subscriber of "
        "joint_command, before the node ends with exit code 1.",
        unit="s",
        within=(0.0, math.inf),
    )

    @property
    def guided_robot(self) -> Robot:
        """The robot of by_hand.

        Raises:
            AnnikError: if it is missing or can't be used, or a plan is given too.
        """
        for name in ("plan", "dataset"):
            if getattr(self, name):
                raise InvalidValue(name, getattr(self, name), "empty together with by_hand")
        if not self.robot:
            raise InvalidValue("robot", "", "the name or path of a robot, together with by_hand")
        return load_robot(
            self.robot,
            base_frame=self.base_frame or None,
            end_effector_frame=self.end_effector_frame or None,
        )

    @property
    def paths(self) -> tuple[Path, Path]:
        """The paths of the plan and of the dataset.

        Raises:
            InvalidValue: if one is missing, or both are the same.
        """
        for name in ("plan", "dataset"):
            if not getattr(self, name):
                raise InvalidValue(name, "", "the path of a file")
        plan, dataset = expanded(self.plan), expanded(self.dataset)
        if dataset.suffix != ".npz":
            raise InvalidValue("dataset", self.dataset, "the path of a file that ends in .npz")
        if plan.resolve() == dataset.resolve():
            raise InvalidValue("dataset", self.dataset, "another file than the plan")
        return plan, dataset
