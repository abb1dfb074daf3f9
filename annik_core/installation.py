"""The installed version, and the folder of the packaged robots, models and configuration.

Where the packaged robots, models and configuration are, however annik was installed.

The version of annik, as installed; package.xml defines it.
"""

from __future__ import annotations

from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from annik_core.errors import AnnikError


def share_directory() -> Path:
    """The folder that holds ``robots/``, ``models/`` and ``config/``.

    In a checkout (and so in an editable or symlinked install) it is the checkout itself. In every
    other install it is ``share/annik_ros`` under the prefix, the place that ROS expects: a virtual
    environment, ``~/.local``, ``/usr``, or colcon's ``install/annik_ros``.

    Raises:
        AnnikError: if neither exists, which means that the installation is damaged.
    """
    module = Path(__file__).resolve()
    checkout = module.parent.parent
    if (checkout / "package.xml").is_file() and (checkout / "robots").is_dir():
        return checkout
    for prefix in module.parents:
        candidate = prefix / "share" / "annik_ros"
        if (candidate / "robots").is_dir():
            return candidate
    raise AnnikError(
        f"no share/annik_ros folder above {module}: the installation is incomplete, "
        "install annik_ros again"
    )


try:
    VERSION = version("annik_ros")
except PackageNotFoundError:  # run from a checkout that was never installed
    VERSION = "0+not.installed"
