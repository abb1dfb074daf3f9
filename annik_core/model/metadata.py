"""The metadata of a model file, and their form inside the file.

Every entry is one ONNX metadata property, named ``annik.<key>``, whose value is JSON. See
docs/artifact.md.
"""

import json
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, NamedTuple, get_origin, get_type_hints

import numpy as np

from annik_core.errors import listed
from annik_core.model.errors import InvalidMetadata, UnsupportedFormat
from annik_core.robots.definition import is_numeric
from annik_core.safety import AcceptanceLimits

FORMAT_VERSION = "2"
SUPPORTED_VERSIONS = (FORMAT_VERSION,)
_PREFIX = "annik."
#: Most reference poses, which are solved one by one when a file is loaded; annik writes 8.
MAX_REFERENCES = 64
#: Most characters of an entry. That of a calibrated robot has some ten thousand.
MAX_LENGTH = 1_000_000
#: Of random poses, a model that solves less is poor, and one is ambiguous that solves less by the
#: joint positions that they were made from.
_SOLVED, _SAME_SOLUTION = 0.995, 0.95
#: Mean steps of refinement beyond which a network is only a rough start; 2 to 3 are usual.
_STEPS = 3.3


@dataclass(frozen=True)
class ModelMetadata:
    """Metadata of a model file.

    Attributes:
        package_version: the annik that trained the network.
        robot: the whole robot definition, as plain data.
        joint_names: joints in the order of the output's columns.
        joint_box_lower: ``dof`` numbers, range of the examples [rad or m].
        features: name of the tensor in which the encoding ends.
        examples: number of distinct examples, with held-out ones and second solutions.
        held_out_examples: how many of them only chose the winner among the restarts.
        winning_restart: the restart that gave the network.
        evaluation: percentiles of the network's errors on fresh random poses.
        reference_poses: ``(k, 7)`` poses to prove a loaded file with.
        reference_joint_positions: ``(k, dof)`` the trained network's joint positions for them.
    """

    format_version: str
    package_version: str
    robot: Mapping[str, Any]
    robot_hash: str
    joint_names: list[str]
    base_frame: str
    end_effector_frame: str
    joint_box_lower: list[float]
    joint_box_upper: list[float]
    encoding: str
    features: str
    hidden_units: list[int]
    design: str
    design_options: dict[str, Any]
    examples: int
    held_out_examples: int
    dataset_hash: str
    seed: int
    winning_restart: int
    fit_options: dict[str, Any]
    evaluation: dict[str, Any]
    reference_poses: list[list[float]]
    reference_joint_positions: list[list[float]]

    def to_properties(self) -> dict[str, str]:
        """The entries as they are in the file. Floats survive the round trip bit for bit.

        Raises:
            ValueError: if a number is NaN or infinite, which JSON does not have.
        """
        return {
            _PREFIX + key: json.dumps(value, sort_keys=True, allow_nan=False)
            for key, value in asdict(self).items()
        }

    @classmethod
    def from_properties(cls, properties: Mapping[str, str], path: Path) -> "ModelMetadata":
        """Read the entries of the file at ``path``; the version is checked before all others.

        Raises:
            UnsupportedFormat: if the file is of another format.
            InvalidMetadata: if an entry is missing or has the wrong form; names it.
        """
        version = _entry(properties, "format_version", path)
        if version not in SUPPORTED_VERSIONS:
            raise UnsupportedFormat(path, str(version), SUPPORTED_VERSIONS)
        values = {key: _entry(properties, key, path) for key in _KINDS}
        for key, kind in _KINDS.items():
            if not isinstance(values[key], kind) or isinstance(values[key], bool):
                raise InvalidMetadata(path, key, f"not of type {kind.__name__}")
        dof = len(values["joint_names"])
        for key, width in (
            ("joint_box_lower", None),
            ("joint_box_upper", None),
            ("reference_poses", 7),
            ("reference_joint_positions", dof),
        ):
            _check_numbers(values[key], key, width, dof, path)
        if len(values["reference_poses"]) > MAX_REFERENCES:
            problem = f"{len(values['reference_poses'])} poses; at most {MAX_REFERENCES}"
            raise InvalidMetadata(path, "reference_poses", problem)
        if len(values["reference_poses"]) != len(values["reference_joint_positions"]):
            raise InvalidMetadata(
                path, "reference_joint_positions", "not one row for each reference pose"
            )
        return cls(**values)


_KINDS = {name: get_origin(kind) or kind for name, kind in get_type_hints(ModelMetadata).items()}


def _entry(properties: Mapping[str, str], key: str, path: Path) -> Any:
    text = properties.get(_PREFIX + key)
    if text is None:
        raise InvalidMetadata(path, key, "missing")
    if len(text) > MAX_LENGTH:
        problem = f"{len(text)} characters; at most {MAX_LENGTH}"
        raise InvalidMetadata(path, key, problem)
    try:
        return json.loads(
            text, parse_constant=_finite_float, parse_float=_finite_float, parse_int=_finite_int
        )
    # Text that is not JSON, or, in a damaged file, bytes that are not text.
    except (ValueError, TypeError, RecursionError) as error:
        raise InvalidMetadata(path, key, f"not JSON: {error}") from error


def _finite_float(text: str) -> float:
    """For the JSON reader, which itself accepts NaN and Infinity, and infinity for 1e999."""
    number = float(text)
    if not math.isfinite(number):
        raise ValueError(f"{text[:20]} is not a finite number")
    return number


def _finite_int(text: str) -> int:
    # One that is beyond a double could be neither computed with nor formatted later.
    _finite_float(text)
    return int(text)


def _check_numbers(value: Any, key: str, width: int | None, dof: int, path: Path) -> None:
    expected = f"({dof},)" if width is None else f"(k, {width})"
    if not is_numeric(value):
        raise InvalidMetadata(path, key, f"not numbers of shape {expected}")
    try:
        numbers = np.array(value, dtype=np.float64)
    # Rows of different lengths, or far too deep.
    except ValueError as error:
        raise InvalidMetadata(path, key, f"not numbers of shape {expected}") from error
    right_shape = (
        numbers.shape == (dof,)
        if width is None
        else numbers.ndim == 2 and numbers.shape[1] == width and len(numbers) > 0
    )
    if not right_shape:
        raise InvalidMetadata(path, key, f"shape {numbers.shape}, not {expected}")


class Quality(NamedTuple):
    """What a model solves of random poses, and what makes it poor, with the remedy."""

    summary: str
    concerns: list[str]

    def __str__(self) -> str:
        """One line."""
        return "; ".join((self.summary, *self.concerns))


def quality_of(evaluation: Mapping[str, Any]) -> Quality:
    """The quality by the evaluation of a model file, as far as that of another annik tells."""
    whole = evaluation.get("whole_robot")
    if isinstance(whole, Mapping):
        return _quality_of_whole_robot(whole)
    refined, redundant = evaluation.get("refined"), evaluation.get("redundant_joints")
    if not isinstance(refined, Mapping):
        refined = {"success": _accepted(evaluation)}
    solved, same, steps = (
        _number(refined, key) for key in ("success", "same_solution", "mean_steps")
    )
    told = _shares(
        (solved, "of random poses solved"),
        (same, "by the joint positions that they were made from"),
    )
    concerns = []
    if solved < _SOLVED:
        concerns.append("poor: give more examples, a larger network, or a smaller joint box")
    if same < _SAME_SOLUTION:
        concerns.append("ambiguous: choose a joint box with one solution, by annik robot")
    if steps > _STEPS:
        concerns.append(f"rough: refined by {steps:.1f} steps, not 2 to 3; give more examples")
    if isinstance(redundant, list) and redundant:
        names = listed(list(map(str, redundant)))
        concerns.append(f"redundant: {names}; lock as many as annik robot says")
    return Quality(told or "unknown", concerns)


def _quality_of_whole_robot(evaluation: Mapping[str, Any]) -> Quality:
    answered, right = _number(evaluation, "answered"), _number(evaluation, "right")
    told = _shares(
        (answered, "of random poses within the joint limits answered"),
        (right, "verified by other forward kinematics"),
    )
    poor = "poor: some poses need more starts of the search; raise max_starts"
    return Quality(told or "unknown", [poor] if answered < _SOLVED else [])


def _shares(*parts: tuple[float, str]) -> str:
    """Known shares, rounded down, so that 100 % are all."""
    return ", ".join(
        f"{math.floor(1e4 * min(max(part, 0.0), 1.0) + 1e-9) / 100:g} % {what}"
        for part, what in parts
        if not math.isnan(part)
    )


def _accepted(evaluation: Mapping[str, Any]) -> float:
    """Of a network alone, what a node accepts by default; an older file says so of all or none."""
    limits = AcceptanceLimits()
    position, orientation = (
        _number(evaluation.get(key), "max")
        for key in ("position_error_m", "orientation_error_rad")
    )
    if position <= limits.max_position_residual and orientation <= limits.max_orientation_residual:
        return 1.0
    return _number(evaluation, "accepted")


def _number(evaluation: object, key: str) -> float:
    """A number of an evaluation, NaN where there is none."""
    value = evaluation.get(key) if isinstance(evaluation, Mapping) else None
    return float(value) if isinstance(value, (int, float)) else math.nan
