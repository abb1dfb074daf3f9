"""The installed version; where the packaged robots, models and configuration are."""

import difflib
import os
from collections.abc import Iterable
from functools import cache
from pathlib import Path

from annik_core.errors import AnnikError
from annik_core.files import expanded


def share_directory() -> Path:
    """The folder that holds ``robots/``, ``models/`` and ``config/``.

    A checkout (also in an editable or symlinked install) is that folder itself. Otherwise it is
    ``share/annik_ros`` under the prefix of the installation, as ROS expects.

    Raises:
        AnnikError: if there is none: the installation is damaged.
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


def ament_prefixes() -> list[Path]:
    """The prefixes of ROS packages that are sourced, the first to look in first."""
    prefixes = os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)
    return [Path(prefix) for prefix in prefixes if prefix]


def default_model_path() -> Path:
    """The packaged model of the gantry."""
    return share_directory() / "models" / "gantry.onnx"


def packaged_models() -> tuple[str, ...]:
    """Names of the models that come with annik."""
    return tuple(sorted(path.stem for path in (share_directory() / "models").glob("*.onnx")))


def model_path(name_or_path: str | Path) -> Path:
    """The file of a packaged model, by its name, or the path itself if it is not such a name."""
    if str(name_or_path) in packaged_models():
        return share_directory() / "models" / f"{name_or_path}.onnx"
    return expanded(name_or_path)


def nearest_first(name: str, known: Iterable[str]) -> tuple[str, ...]:
    """Known names, those most like a given one first."""

    def likeness(other: str) -> float:
        return difflib.SequenceMatcher(None, name[:100].lower(), other.lower()).ratio()

    return tuple(sorted(known, key=likeness, reverse=True))


@cache
def annik_version() -> str:
    """Version of annik, from package.xml; ``0+not.installed`` for a checkout that is not."""
    # Not above: it loads slowly, and a node starts without it.
    from importlib.metadata import PackageNotFoundError, version

    try:
        return version("annik_ros")
    except PackageNotFoundError:
        return "0+not.installed"
