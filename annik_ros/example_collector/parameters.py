"""The parameters of ``example_collector``. Needs no ROS."""

import math
from dataclasses import dataclass
from pathlib import Path

from annik_core.collection.settings import CollectionSettings
from annik_core.errors import InvalidValue
from annik_core.files import expanded
from annik_ros.parameters import parameter, parameters_of


@dataclass(frozen=True)
class ExampleCollectorParameters:
    """Parameters of ``example_collector``."""

    plan: str = parameter(
        "",
        "Path of the dataset whose joint positions to measure at, as annik design --out writes "
        "it; required.",
    )
    dataset: str = parameter(
        "",
        "Path of the dataset (.npz) to write; required. Beside it is the journal, NAME"
        ".journal.jsonl, from which an interrupted collection continues.",
    )
    settings: CollectionSettings = parameters_of(CollectionSettings)
    wait_timeout: float = parameter(
        60.0,
        "How long to wait at the start for joint_states, measured_pose and a subscriber of "
        "joint_command, before the node ends with exit code 1.",
        unit="s",
        within=(0.0, math.inf),
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
