"""What can keep a report from being made, besides an unreadable bag."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from msg_tools.bags.errors import BagError


class NamespaceError(BagError):
    """It is not clear which robot of a bag is meant."""

    def __init__(self, path: Path, problem: str, namespaces: Sequence[str]) -> None:
        self.namespaces = tuple(namespaces)
        super().__init__(path, problem)


class AmbiguousNamespace(NamespaceError):
    """Several namespaces of a bag hold a robot, and none was chosen."""

    def __init__(self, path: Path, namespaces: Sequence[str]) -> None:
        super().__init__(
            path,
            f"robots in several namespaces: {', '.join(namespaces)}; choose one as 'namespace'",
            namespaces,
        )


class UnknownNamespace(NamespaceError):
    """The chosen namespace holds no robot."""

    def __init__(self, path: Path, namespace: str, namespaces: Sequence[str]) -> None:
        self.namespace = namespace
        there = ", ".join(namespaces) or "none"
        super().__init__(
            path,
            f"no topic of annik in namespace {namespace}; namespaces with a robot: {there}",
            namespaces,
        )
