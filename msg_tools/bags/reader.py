"""Read a bag without ROS: MCAP or SQLite3, whole, cut or left by a killed recorder."""

import re
from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePath
from typing import Any, Final, NamedTuple

from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from annik_core.files import bounded_yaml, read_text
from msg_tools.bags.errors import BagNotFound, BagNotReadable
from msg_tools.bags.metadata import METADATA_FILE, is_known_type, jazzy_types
from msg_tools.bags.progress import Progress, not_shown
from msg_tools.bags.stored_messages import RawMessage, stored_messages

_STORAGE_SUFFIXES: Final = (".mcap", ".db3")


class BagRecord(NamedTuple):
    """A decoded message of a bag."""

    topic: str
    type: str
    log_time_ns: int  #: receive time [ns since the epoch]
    #: Send time [ns since the epoch]; the receive time if the bag has none, see
    #: :attr:`Bag.has_publish_times`.
    publish_time_ns: int
    message: Any  #: has the fields of its ROS type as attributes


class BagTopic(NamedTuple):
    """A topic of a bag: absolute name, message type, number of readable messages."""

    name: str
    type: str
    message_count: int


@dataclass(frozen=True)
class Bag:
    """Summary of a bag; :meth:`records` reads its messages."""

    path: Path
    topics: dict[str, BagTopic]  #: topics with at least one readable message, by name
    complete: bool  #: whether everything that was recorded could be read
    damage: tuple[str, ...]  #: what was lost, one sentence per fault; empty if complete
    has_publish_times: bool  #: whether the bag has the times at which messages were sent

    @property
    def message_count(self) -> int:
        """Readable messages of all topics."""
        return sum(topic.message_count for topic in self.topics.values())

    def records(
        self, topics: Collection[str] | None = None, progress: Progress | None = None
    ) -> Iterator[BagRecord]:
        """Decoded messages in stored order, of all topics or of those with these absolute names.

        Raises:
            BagNotReadable: if a message of these topics can't be decoded.
        """
        extra = get_typestore(Stores.EMPTY)
        stored = _raw_messages(_content(self.path, [])[0], [])
        for raw in (progress or not_shown)(stored, "reading messages", self.message_count):
            if topics is not None and raw.topic not in topics:
                continue
            types = _types_for(raw, extra, self.path)
            try:
                message = types.deserialize_cdr(raw.data, raw.type)
            # Each field type fails in its own way on damaged CDR.
            except Exception as error:
                raise BagNotReadable(
                    self.path, f"a message of {raw.topic} is not a valid {raw.type} ({error})"
                ) from error
            yield BagRecord(raw.topic, raw.type, raw.log_time_ns, raw.publish_time_ns, message)


def read_bag(path: Path, progress: Progress | None = None) -> Bag:
    """Read a whole bag once, count its messages and find its damage.

    The path is the folder of a bag (MCAP or SQLite3, one file or several, compressed or not), its
    ``metadata.yaml``, or one of its files. It is complete if as many messages could be read as it
    states, of each topic. Nothing is written into the folder.

    Raises:
        BagNotFound: if there is no such path.
        BagNotReadable: if it is not a bag, or nothing in it can be read.
    """
    if not path.exists():
        raise BagNotFound(path)
    damage: list[str] = []
    counts: Counter[tuple[str, str]] = Counter()
    has_publish_times = False
    files, total, stated = _content(path, damage)
    for raw in (progress or not_shown)(_raw_messages(files, damage), "counting messages", total):
        counts[raw.topic, raw.type] += 1
        has_publish_times |= raw.publish_time_ns != raw.log_time_ns
    topics: dict[str, BagTopic] = {}
    read: Counter[str] = Counter()
    for (name, message_type), count in counts.items():
        read[name] += count
        if name in topics:
            damage.append(f"topic {name} has two types; only {topics[name].type} is counted")
            continue
        topics[name] = BagTopic(name, message_type, count)
    stated = read if stated is None else stated
    if total is not None and (total, stated) != (read.total(), read):
        wrong = (name for name in (read | stated) if read[name] != stated[name])
        parts = "".join(f", {name} {read[name]} of {stated[name]}" for name in wrong)
        damage.append(f"{read.total()} of {total} messages of {METADATA_FILE} were read{parts}")
    return Bag(path, topics, not damage, tuple(damage), has_publish_times)


def _content(path: Path, damage: list[str]) -> tuple[list[Path], int | None, Counter[str] | None]:
    """The files of a bag, and the numbers of messages that it states, of all topics and by topic.

    None where it states none; appends to ``damage`` what is missing.
    """
    is_bag = path.is_dir() or path.name == METADATA_FILE
    name = _unpacked(path.name)
    if not is_bag and PurePath(name).suffix not in _STORAGE_SUFFIXES:
        raise BagNotReadable(path, "not a bag folder, nor an .mcap or .db3 file")
    directory = path if path.is_dir() else path.parent
    information = _bag_information(directory)
    paths = information.get("relative_file_paths")
    # Old versions of rosbag2 wrote the folder's name before the file's.
    listed = [PurePath(str(path)).name for path in paths] if isinstance(paths, list) else None
    if is_bag:
        files = _storage_files(directory, listed, damage)
    else:
        files = [path]
        if listed is None or {_unpacked(other) for other in listed} != {name}:
            information = _part_information(information, name)
    total, by_topic = _stated_counts(information)
    if total is None and (listed is not None if is_bag else name.endswith(".db3")):
        damage.append(f"{METADATA_FILE} does not say how many messages were recorded")
    return files, total, by_topic


def _raw_messages(files: Sequence[Path], damage: list[str]) -> Iterator[RawMessage]:
    """Undecoded messages of the files of a bag; appends to ``damage`` what could not be read."""
    failures: list[BagNotReadable] = []
    for file in files:
        try:
            yield from stored_messages(file, damage)
        except BagNotReadable as error:
            failures.append(error)
            damage.append(f"{file.name}: {error.problem}")
    if failures and len(failures) == len(files):
        raise failures[0]


def _bag_information(directory: Path) -> dict[str, Any]:
    """What metadata.yaml says; empty if it is missing or damaged."""
    try:
        content = bounded_yaml(read_text(directory / METADATA_FILE))
        information = content["rosbag2_bagfile_information"]
    except (OSError, ValueError, KeyError, TypeError):
        return {}
    return information if isinstance(information, dict) else {}


def _part_information(information: Mapping[str, Any], name: str) -> dict[str, Any]:
    """What metadata.yaml says of one of several files; empty if it says nothing."""
    parts = information.get("files")
    for part in parts if isinstance(parts, list) else ():
        if isinstance(part, dict) and _unpacked(PurePath(str(part.get("path"))).name) == name:
            return part
    return {}


def _stated_counts(information: Mapping[str, Any]) -> tuple[int | None, Counter[str] | None]:
    """Stated numbers of messages, of all topics and by topic; None where there are none."""
    topics = information.get("topics_with_message_count")
    by_topic: Counter[str] = Counter()
    try:
        for topic in topics or ():
            by_topic[str(topic["topic_metadata"]["name"])] += int(topic["message_count"])
        return int(information["message_count"]), None if topics is None else by_topic
    except (KeyError, TypeError, ValueError, OverflowError):
        return None, None


def _storage_files(directory: Path, listed: list[str] | None, damage: list[str]) -> list[Path]:
    """The listed files and others of a bag; of a file and its compressed form, the file."""
    try:
        names = sorted((file.name for file in directory.iterdir()), key=_natural_order)
    except OSError as error:
        raise BagNotReadable(directory, error.strerror or str(error)) from error
    wanted = dict.fromkeys(_unpacked(name) for name in listed or ())
    found: dict[str, Path] = {}
    for name in names:
        plain = _unpacked(name)
        is_storage = plain in wanted or PurePath(plain).suffix in _STORAGE_SUFFIXES
        if is_storage and (plain == name or plain not in found):
            found[plain] = directory / name
    if listed is None:
        damage.append(f"{METADATA_FILE} is missing or damaged: the recorder was killed")
    else:
        damage += [f"{name}: is missing" for name in wanted if name not in found]
        others = [path.name for name, path in found.items() if name not in wanted]
        damage += [f"{name}: {METADATA_FILE} does not list it" for name in others]
    if not found:
        raise BagNotReadable(directory, "no .mcap or .db3 file in the folder")
    # The listed ones in their order, then the others.
    return [found[name] for name in {**wanted, **dict.fromkeys(found)} if name in found]


def _unpacked(name: str) -> str:
    """The name of a file without the suffix of its compression."""
    return name.removesuffix(".zstd").removesuffix(".zst")


def _natural_order(name: str) -> list[tuple[int, str]]:
    """Sort key under which ``bag_10`` comes after ``bag_9``."""
    parts = re.split(r"(\d+)", name)
    return [(int(part), "") if part.isdecimal() else (-1, part) for part in parts]


def _types_for(raw: RawMessage, extra: Typestore, path: Path) -> Typestore:
    """The store of the message's type; types beyond those of Jazzy are read from the bag."""
    if is_known_type(raw.type):
        return jazzy_types()
    if raw.type not in extra.fielddefs:
        try:
            if raw.definition_format == "ros2idl":
                extra.register(get_types_from_idl(raw.definition))
            else:
                extra.register(get_types_from_msg(raw.definition, raw.type))
        # The parser raises many kinds of errors on a damaged definition.
        except Exception as error:
            raise BagNotReadable(
                path, f"the bag does not define {raw.type}, the type of {raw.topic}"
            ) from error
    return extra
