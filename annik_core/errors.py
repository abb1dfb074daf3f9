"""The exceptions of annik: one tree, raised early, with the offending data as attributes.

Exceptions are for faults of set-up (a missing file, a wrong robot, a bad option). What may happen
in every control cycle, such as a target out of reach, is a value instead:
see :class:`annik_core.solver.result.IkResult`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path


class AnnikError(Exception):
    """Base of every exception that annik raises on purpose."""


class MissingDependency(AnnikError):
    """A library that this needs is not installed, or is another one of that name."""

    def __init__(self, library: str, purpose: str, remedy: str) -> None:
        self.library = library
        super().__init__(f"{purpose} needs {library}: {remedy}")


# --- robots -----------------------------------------------------------------------------------


class RobotError(AnnikError):
    """A robot definition can't be used."""


class UnknownRobot(RobotError):
    """No packaged robot has this name, and no file has this path."""

    def __init__(self, name: str, known: Sequence[str]) -> None:
        self.name = name
        self.known = tuple(known)
        super().__init__(
            f"no robot {name!r}: give one of the packaged robots ({', '.join(self.known)}) "
            "or the path of a robot definition (.yaml) or a URDF (.urdf)"
        )


class InvalidRobotDefinition(RobotError):
    """A robot definition is incomplete or contradicts itself."""

    def __init__(self, source: str, problem: str) -> None:
        self.source = source
        self.problem = problem
        super().__init__(f"robot definition {source}: {problem}")


class WrongJointCount(RobotError):
    """An array of joint positions does not have one column per joint."""

    def __init__(self, shape: tuple[int, ...], joint_names: Sequence[str]) -> None:
        self.shape = shape
        self.joint_names = tuple(joint_names)
        super().__init__(
            f"joint positions have shape {shape}; expected (n, {len(self.joint_names)}), "
            f"one column for each of {', '.join(self.joint_names)}"
        )


# --- poses and messages -----------------------------------------------------------------------


class ConversionError(AnnikError):
    """A message or array can't be converted."""


class WrongShape(ConversionError):
    """An array does not have the shape its meaning requires."""

    def __init__(self, what: str, shape: tuple[int, ...], expected: str) -> None:
        self.what = what
        self.shape = shape
        self.expected = expected
        super().__init__(f"{what} has shape {shape}; expected {expected}")


class NonFiniteValue(ConversionError):
    """A number is NaN or infinite."""

    def __init__(self, field: str, value: float) -> None:
        self.field = field
        self.value = value
        super().__init__(f"{field} is {value}: every number must be finite")


class NotUnitQuaternion(ConversionError):
    """A quaternion's norm is too far from one for it to be a rotation."""

    def __init__(self, norm: float, tolerance: float) -> None:
        self.norm = norm
        self.tolerance = tolerance
        super().__init__(
            f"quaternion norm is {norm:.6g}; it must be 1 within {tolerance:g}: normalise it "
            "(x, y, z, w order)"
        )


class MissingJoint(ConversionError):
    """A joint state lacks a joint that the robot has."""

    def __init__(self, missing: Sequence[str], received: Sequence[str]) -> None:
        self.missing = tuple(missing)
        self.received = tuple(received)
        super().__init__(
            f"joint state lacks {', '.join(self.missing)}; it names "
            f"{', '.join(self.received) or 'no joint'}"
        )


class MalformedJointState(ConversionError):
    """A joint state names a joint twice, or has not one position per name."""

    def __init__(self, problem: str) -> None:
        self.problem = problem
        super().__init__(f"joint state: {problem}")


# --- designs of experiments and datasets ------------------------------------------------------


class DesignError(AnnikError):
    """A design of experiments can't be made as asked."""


class UnknownDesign(DesignError):
    """No design of experiments has this name."""

    def __init__(self, name: str, known: Sequence[str]) -> None:
        self.name = name
        self.known = tuple(known)
        super().__init__(f"no design {name!r}: choose one of {', '.join(self.known)}")


class InvalidDesignSize(DesignError):
    """The requested size of a design is out of range."""

    def __init__(self, design: str, option: str, value: int, minimum: int, maximum: int) -> None:
        self.design = design
        self.option = option
        self.value = value
        self.allowed = (minimum, maximum)
        super().__init__(
            f"design {design}: {option} is {value}; it must be from {minimum} to {maximum}"
        )


class UnsupportedRobotForDesign(DesignError):
    """A design needs something that this robot does not offer."""

    def __init__(self, design: str, robot: str, reason: str) -> None:
        self.design = design
        self.robot = robot
        self.reason = reason
        super().__init__(f"design {design} can't be used with robot {robot}: {reason}")


class DatasetError(AnnikError):
    """A dataset can't be used."""


class UnreadableDataset(DatasetError):
    """A dataset file is missing, truncated, altered, or not a dataset."""

    def __init__(self, path: Path, reason: str) -> None:
        self.path = path
        self.reason = reason
        super().__init__(f"dataset {path}: {reason}")


class TooFewExamples(DatasetError):
    """A dataset is too small for what was asked of it."""

    def __init__(self, examples: int, minimum: int, purpose: str) -> None:
        self.examples = examples
        self.minimum = minimum
        super().__init__(f"{examples} examples are too few for {purpose}: at least {minimum}")


class RobotMismatch(AnnikError):
    """A file was made for one robot and is used with another."""

    def __init__(self, what: str, expected: str, found: str) -> None:
        self.what = what
        self.expected = expected
        self.found = found
        super().__init__(
            f"{what} belongs to robot {found}, not to {expected}: use the file made for this "
            "robot, or make one with 'annik train'"
        )


# --- files of checked lines -------------------------------------------------------------------


class CheckedLinesError(AnnikError):
    """A file of checked lines can't be used.

    Who owns the file gives its own error in place of this one, with a remedy.
    """


class CheckedLinesInUse(CheckedLinesError):
    """Another process has the file open."""

    def __init__(self, path: Path) -> None:
        self.path = path
        super().__init__(f"{path} is in use by another process")


class DamagedLine(CheckedLinesError):
    """A line is not as it was written."""

    def __init__(self, path: Path, line: int, problem: str) -> None:
        self.path = path
        self.line = line
        self.problem = problem
        super().__init__(f"{path}, line {line}: {problem}")


class CheckedLinesNotWritable(CheckedLinesError):
    """The file can't be opened or extended."""

    def __init__(self, path: Path, reason: str) -> None:
        self.path = path
        self.reason = reason
        super().__init__(f"{path} can't be written ({reason})")


# --- collecting examples on a robot -----------------------------------------------------------


class CollectionError(AnnikError):
    """Examples can't be collected as asked."""


class InvalidCollectionSetting(CollectionError):
    """A setting of a collection is out of range, or contradicts another."""

    def __init__(self, setting: str, value: object, allowed: str) -> None:
        self.setting = setting
        self.value = value
        self.allowed = allowed
        super().__init__(f"{setting} is {value!r}; it must be {allowed}")


class DatasetInTheWay(CollectionError):
    """Where the measured examples are to go is a file that no journal tells of."""

    def __init__(self, path: Path, journal: Path) -> None:
        self.path = path
        self.journal = journal
        super().__init__(
            f"{path} is there, but not {journal.name} that would belong to it: give another "
            "dataset, or move this one away"
        )


class JournalInUse(CollectionError):
    """Another collector writes to the same journal."""

    def __init__(self, path: Path) -> None:
        self.path = path
        super().__init__(
            f"{path} is in use by another example_collector: end that one, or give another dataset"
        )


class DamagedJournal(CollectionError):
    """A line of a journal is not as annik wrote it."""

    def __init__(self, path: Path, line: int, problem: str) -> None:
        self.path = path
        self.line = line
        self.problem = problem
        remedy = "delete this line (its example is then measured again), or give another dataset"
        if line == 1:
            remedy = "without its first line it can't be used: give another dataset"
        super().__init__(f"journal {path}, line {line}: {problem}; {remedy}")


class JournalMismatch(CollectionError):
    """A journal was begun for another plan, or with a setting that must stay."""

    def __init__(self, path: Path, what: str, journal: object, given: object) -> None:
        self.path = path
        self.what = what
        self.journal = journal
        self.given = given
        super().__init__(
            f"journal {path} was begun with {what} {journal}, not {given}: give what it was begun "
            "with, to go on with it, or another dataset, to begin anew"
        )


class JournalNotWritable(CollectionError):
    """A measured example can't be written down."""

    def __init__(self, path: Path, reason: str) -> None:
        self.path = path
        self.reason = reason
        super().__init__(
            f"journal {path} can't be written ({reason}): check the folder and free space; what "
            "was written before is kept, and the same command goes on from there"
        )


class CollectionStopped(CollectionError):
    """The robot did something that it should not: nothing is commanded any more."""

    def __init__(self, reason: str) -> None:
        self.reason = reason
        super().__init__(
            f"stopped: {reason}; what was measured is kept, and the same command goes on from "
            "there once the cause is found"
        )


class CollectionIncomplete(CollectionError):
    """Some examples could not be measured.

    Attributes:
        missing: row of the plan to the reason that it failed for last.
    """

    def __init__(self, missing: Mapping[int, str]) -> None:
        self.missing = dict(missing)
        first = "; ".join(f"row {row}: {reason}" for row, reason in sorted(missing.items())[:3])
        more = "; ..." if len(missing) > 3 else ""
        super().__init__(
            f"{len(missing)} examples could not be measured ({first}{more}): the same command "
            "tries them again, and keeps the others"
        )


# --- training ---------------------------------------------------------------------------------


class TrainingError(AnnikError):
    """A network could not be trained."""


class InvalidTrainingOption(TrainingError):
    """A training option is out of range."""

    def __init__(self, option: str, value: object, allowed: str) -> None:
        self.option = option
        self.value = value
        self.allowed = allowed
        super().__init__(f"{option} is {value!r}; allowed: {allowed}")


class ReproductionNotWritable(TrainingError):
    """What the reproduction of the paper found can't be written."""

    def __init__(self, path: Path, reason: str) -> None:
        self.path = path
        self.reason = reason
        super().__init__(f"{path} can't be written ({reason}): check the folder and free space")


# --- studies ----------------------------------------------------------------------------------


class StudyError(AnnikError):
    """A study can't be run as asked."""


class InvalidStudySetting(StudyError):
    """What is to be compared makes no sense."""

    def __init__(self, setting: str, value: object, allowed: str) -> None:
        self.setting = setting
        self.value = value
        self.allowed = allowed
        super().__init__(f"{setting} is {value!r}; allowed: {allowed}")


class StudyInUse(StudyError):
    """Another study writes to the same folder."""

    def __init__(self, path: Path) -> None:
        self.path = path
        super().__init__(
            f"{path} is in use by another study: wait until it ends, or give another --out"
        )


class DamagedStudyResults(StudyError):
    """A line of a file of results is not as annik wrote it."""

    def __init__(self, path: Path, line: int, problem: str) -> None:
        self.path = path
        self.line = line
        super().__init__(
            f"results {path}, line {line}: {problem}; delete this line (its job is then run "
            "again), or give another --out"
        )


class StudyNotWritable(StudyError):
    """What a study found can't be written."""

    def __init__(self, path: Path, reason: str) -> None:
        self.path = path
        self.reason = reason
        super().__init__(
            f"{path} can't be written ({reason}): check the folder and free space; what was "
            "written before is kept, and the same command goes on from there"
        )


class WorkerEnded(AnnikError):
    """A process that ran jobs ended in the midst of one."""

    def __init__(self, reason: str) -> None:
        self.reason = reason
        super().__init__(
            f"a worker process ended before its job was done, perhaps for lack of memory: run "
            f"again, with fewer --workers ({reason})"
        )


# --- the model artifact -----------------------------------------------------------------------


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


class MissingArtifactMetadata(ArtifactError):
    """A key that every model of annik has is not in the file."""

    def __init__(self, path: Path, key: str) -> None:
        self.key = key
        super().__init__(
            path,
            f"metadata key {key!r} is missing",
            "use a file made by 'annik train', unaltered",
        )


class InvalidArtifactMetadata(ArtifactError):
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


class ExportMismatch(ArtifactError):
    """The exported graph does not compute what the trained network computes."""

    def __init__(self, path: Path, difference: float, tolerance: float) -> None:
        self.difference = difference
        self.tolerance = tolerance
        super().__init__(
            path,
            f"exported and trained network differ by {difference:.3g}, more than {tolerance:g}",
            "nothing was written; report this with your onnxruntime and torch versions",
        )


class ArtifactNotWritable(ArtifactError):
    """The model file could not be written."""

    def __init__(self, path: Path, reason: str) -> None:
        super().__init__(path, f"can't be written ({reason})", "check the folder and free space")


# --- bags -------------------------------------------------------------------------------------


class BagError(AnnikError):
    """A bag can't be read or written."""

    def __init__(self, path: Path, problem: str) -> None:
        self.path = path
        self.problem = problem
        super().__init__(f"bag {path}: {problem}")


class BagNotFound(BagError):
    """There is no such bag."""

    def __init__(self, path: Path) -> None:
        super().__init__(path, "no such file or folder")


class BagNotReadable(BagError):
    """The bag is damaged beyond use, or not a bag."""


class BagNotWritable(BagError):
    """The bag can't be created or extended."""


# --- paths of targets -------------------------------------------------------------------------


class TargetPathError(AnnikError):
    """A path of target poses can't be made as asked."""
