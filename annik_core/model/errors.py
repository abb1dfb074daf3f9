"""Exceptions of model files."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from annik_core.errors import AnnikError


class ArtifactError(AnnikError):
    """A model file can't be used."""

    remedy = "make the file again with 'annik train'"

    def __init__(self, path: Path, problem: str, remedy: str | None = None) -> None:
        self.path = path
        self.problem = problem
        super().__init__(f"model {path}: {problem}; {remedy or self.remedy}")


class ArtifactNotFound(ArtifactError):
    """There is no such model file."""

    def __init__(self, path: Path) -> None:
        super().__init__(path, "no such file", "check the path given as 'model'")


class ArtifactNotReadable(ArtifactError):
    """The file is not ONNX, is truncated, or onnxruntime refuses it."""


class ArtifactTooLarge(ArtifactError):
    """The file is larger than a model of annik can be."""

    def __init__(self, path: Path, size: int, limit: int) -> None:
        self.size = size
        self.limit = limit
        super().__init__(path, f"{size} bytes; at most {limit} are accepted")


class ArtifactHasExternalData(ArtifactError):
    """The weights are in other files; a model of annik is one self-contained file."""

    def __init__(self, path: Path, tensor: str) -> None:
        self.tensor = tensor
        super().__init__(path, f"tensor {tensor!r} is stored outside the file")


class UnsupportedArtifactVersion(ArtifactError):
    """The format version is not one that this annik reads."""

    def __init__(self, path: Path, found: str, supported: Sequence[str]) -> None:
        self.found = found
        self.supported = tuple(supported)
        super().__init__(
            path,
            f"format version {found!r}; this annik reads {', '.join(self.supported)}",
            "use the annik that made it, or make it again with 'annik train'",
        )


class MissingMetadata(ArtifactError):
    """A key that every model of annik has is not in the file."""

    def __init__(self, path: Path, key: str) -> None:
        self.key = key
        super().__init__(
            path,
            f"metadata key {key!r} is missing",
            "use a file made by 'annik train', unaltered",
        )


class InvalidMetadata(ArtifactError):
    """A metadata entry has the wrong form or contradicts another."""

    def __init__(self, path: Path, key: str, problem: str) -> None:
        self.key = key
        super().__init__(path, f"metadata key {key!r}: {problem}")


class ArtifactSignatureMismatch(ArtifactError):
    """The graph's inputs or outputs are not those of the artifact contract."""


class NonFiniteWeights(ArtifactError):
    """A weight of the network is NaN or infinite."""

    def __init__(self, path: Path, tensor: str) -> None:
        self.tensor = tensor
        super().__init__(path, f"tensor {tensor!r} holds a value that is not finite")


class NetworkFailed(ArtifactError):
    """The network gives no answer, or one of another shape or type than it promises."""

    def __init__(self, path: Path, reason: str) -> None:
        self.reason = reason
        super().__init__(path, f"the network fails ({reason})")
