"""The interface of the solvers, and the error of one that can't take part."""

from __future__ import annotations

import importlib
from collections.abc import Sequence
from importlib.metadata import PackageNotFoundError
from importlib.metadata import version as distribution_version
from types import ModuleType
from typing import Literal, Protocol, runtime_checkable

from annik_core.errors import AnnikError
from annik_core.pose import FloatArray

Kind = Literal["numerical", "closed form", "ours"]


class Peer(Protocol):
    """A solver, prepared for one robot and one joint box.

    A solve is timed from the pose to the joint positions, as a Python program would call it, so it
    includes the conversion to the solver's own types. Whatever can be prepared for all targets is
    done before.

    Attributes:
        name: as in the tables.
        version: of the package that was imported.
        kind: how it solves.
        settings: one line: tolerance, restarts, start, time limit.
    """

    name: str
    version: str
    kind: Kind
    settings: str

    def solve(self, pose: FloatArray, start: FloatArray | None = None) -> FloatArray | None:
        """Joint positions that reach a pose.

        Args:
            pose: ``(7,)``; x, y, z [m] and unit quaternion qx, qy, qz, qw in the base frame.
            start: ``(dof,)``, where a numerical solver begins, and which of several solutions is
                near; by default the centre of the joint box.

        Returns:
            ``(dof,)`` [rad or m], all joints of the problem, the locked ones too; None if the
            solver itself reports that it failed. They are not checked against target or box.
        """


@runtime_checkable
class SolvesAll(Protocol):
    """A solver that lists all solutions."""

    @property
    def name(self) -> str:
        """As in the tables."""

    def solutions(self, pose: FloatArray) -> Sequence[Sequence[float]] | FloatArray:
        """All joint positions ``(n, free)`` of a pose ``(7,)``, in any turn and beyond limits."""


class PeerUnavailable(AnnikError):
    """A solver can't take part: it is not installed, or can't do this robot."""

    def __init__(self, peer: str, reason: str) -> None:
        self.peer = peer
        self.reason = reason
        super().__init__(f"{peer}: {reason}")


def imported(peer: str, module: str, remedy: str) -> ModuleType:
    """A module of a solver, imported by name because none of them is a dependency of annik.

    Args:
        peer: the solver's name.
        module: to import.
        remedy: the command that installs it.

    Raises:
        PeerUnavailable: if it is not installed, or is but can't be imported.
    """
    try:
        return importlib.import_module(module)
    except ModuleNotFoundError as error:
        missing = error.name or module
        # A submodule is part of the package; anything else is something the package itself needs.
        if missing.partition(".")[0] == module.partition(".")[0]:
            raise PeerUnavailable(peer, f"not installed ({remedy})") from error
        raise PeerUnavailable(peer, f"installed, but needs {missing}") from error
    except ImportError as error:
        raise PeerUnavailable(peer, f"installed, but can't be imported: {error}") from error


def installed_version(distribution: str) -> str:
    """Version of an installed distribution, or "unknown", as where it came without metadata."""
    try:
        return distribution_version(distribution)
    except PackageNotFoundError:
        return "unknown"
