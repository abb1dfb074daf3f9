"""Exceptions of model files."""

from collections.abc import Sequence
from pathlib import Path

from annik_core.errors import AnnikError


class ModelError(AnnikError):
    """A model file can't be used."""

    def __init__(
        self, path: Path, problem: str, remedy: str = "make the file again with 'annik train'"
    ) -> None:
        self.path = path
        self.problem = problem
        super().__init__(f"model {path}: {problem}; {remedy}")


class ModelNotFound(ModelError):
    """There is no such file; ``known``: the packaged models, those of the nearest names first."""

    def __init__(self, path: Path, known: Sequence[str]) -> None:
        self.known = tuple(known)
        super().__init__(
            path,
            "no such file",
            f"give one of the packaged models ({', '.join(self.known)}) or the path of a model "
            "file as 'model'",
        )


class UnreadableModel(ModelError):
    """The file can't be read, is too large, is not ONNX, or onnxruntime refuses it."""


class UnsupportedFormat(ModelError):
    """The file is of another format version."""

    def __init__(self, path: Path, found: str, supported: Sequence[str]) -> None:
        self.found = found
        self.supported = tuple(supported)
        super().__init__(
            path,
            f"format version {found!r}; this annik reads {', '.join(self.supported)}",
            "make it again with 'annik train' or, if it was calibrated, 'annik calibrate'",
        )


class InvalidGraph(ModelError):
    """A part of the graph is one that no model has, or its weights are not finite.

    ``part`` names an operator, a tensor, an attribute, or is ``input`` or ``output``.
    """

    def __init__(self, path: Path, part: str, problem: str) -> None:
        self.part = part
        super().__init__(path, f"{part!r} in its graph {problem}")


class InvalidMetadata(ModelError):
    """A metadata entry is missing, has the wrong form, or contradicts the graph or another one."""

    def __init__(self, path: Path, key: str, problem: str) -> None:
        self.key = key
        super().__init__(path, f"metadata key {key!r}: {problem}")


class NetworkFailed(ModelError):
    """The network has no output, or one of another shape or type than it must have."""
