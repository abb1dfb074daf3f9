"""The parameters of ``viewer``. Needs no ROS."""

from dataclasses import dataclass

from annik_core.errors import InvalidValue
from annik_ros.parameters import parameter


@dataclass(frozen=True)
class ViewerParameters:
    """Parameters of ``viewer``."""

    model: str = parameter(
        "",
        "Path of a model file, or name of a packaged model, whose robot to show; empty: see "
        "robot.",
    )
    robot: str = parameter(
        "gantry",
        "Packaged robot, or path of a robot definition or URDF, to show if there is no model.",
    )
    base_frame: str = parameter(
        "", "Of a URDF: the link that poses are relative to; empty: its root, or as defined."
    )
    end_effector_frame: str = parameter(
        "", "Of a URDF: the link whose pose is given; empty: its only tip, or as defined."
    )
    plan: str = parameter(
        "",
        "Plan of example_collector (.npz), whose examples to show, and which are measured. It has "
        "its robot, so robot is not needed then. Empty: none.",
    )
    host: str = parameter(
        "127.0.0.1",
        "Address of the page. By default only this machine reaches it; 0.0.0.0: others too.",
    )
    port: int = parameter(
        8080, "Port of the page: the first free one from this on.", within=(1, 65_535)
    )
    drive: bool = parameter(
        False,
        "true: the page has a switch that publishes the dragged target, so whoever reaches the "
        "page can move the robot; pages of other sites are refused. false: the page only shows.",
    )

    def __post_init__(self) -> None:
        for name in ("base_frame", "end_effector_frame"):
            if self.model and getattr(self, name):
                allowed = "empty together with model, which has its own"
                raise InvalidValue(name, getattr(self, name), allowed)
