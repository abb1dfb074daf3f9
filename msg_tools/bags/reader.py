"""Read a bag without ROS: MCAP or SQLite3, closed, cut or left by a killed recorder."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Collection, Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, NamedTuple

import yaml
from rosbags.interfaces import Connection, ConnectionExtRosbag2, MessageDefinitionFormat
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from msg_tools.bags.errors import BagNotFound, BagNotReadable
from msg_tools.bags.mcap_messages import RawMessage, mcap_messages
from msg_tools.bags.metadata import METADATA_FILE, is_known_type, jazzy_types

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

    def records(self, topics: Collection[str] | None = None) -> Iterator[BagRecord]:
        """Decoded messages in stored order, of all topics or of those with these absolute names.

        Raises:
            BagNotReadable: if a message of these topics can't be decoded.
        """
        extra = get_typestore(Stores.EMPTY)
        for raw in _raw_messages(self.path, []):
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


def read_bag(path: Path) -> Bag:
    """Read a whole bag once, count its messages and find its damage.

    The path is the folder of a bag (MCAP or SQLite3, one file or several), or one ``.mcap`` or
    ``.db3``.

    Raises:
        BagNotFound: if there is no such path.
        BagNotReadable: if it is not a bag, or nothing in it can be read.
    """
    if not path.exists():
        raise BagNotFound(path)
    damage: list[str] = []
    counts: Counter[tuple[str, str]] = Counter()
    has_publish_times = False
    for raw in _raw_messages(path, damage):
        counts[raw.topic, raw.type] += 1
        has_publish_times |= raw.publish_time_ns != raw.log_time_ns
    topics: dict[str, BagTopic] = {}
    for (name, message_type), count in counts.items():
        if name in topics:
            damage.append(f"topic {name} has two types; only {topics[name].type} is counted")
            continue
        topics[name] = BagTopic(name, message_type, count)
    return Bag(path, topics, not damage, tuple(damage), has_publish_times)


def _raw_messages(path: Path, damage: list[str]) -> Iterator[RawMessage]:
    """Undecoded messages of all files of a bag; appends to ``damage`` what could not be read."""
    if path.is_file() and path.suffix in _STORAGE_SUFFIXES:
        files = [path]
    elif path.is_dir():
        information = _bag_information(path)
        if information.get("compression_mode") and information["compression_mode"] != "none":
            yield from _rosbags_messages(path)
            return
        files = _storage_files(path, information, damage)
    else:
        raise BagNotReadable(path, "not a bag folder, nor an .mcap or .db3 file")
    failures: list[BagNotReadable] = []
    for file in files:
        try:
            if file.suffix == ".mcap":
                yield from mcap_messages(file, damage)
            else:
                yield from _rosbags_messages(file)
        except BagNotReadable as error:
            failures.append(error)
            damage.append(f"{file.name}: {error.problem}")
    if failures and len(failures) == len(files):
        raise failures[0]


def _rosbags_messages(path: Path) -> Iterator[RawMessage]:
    with ExitStack() as stack:
        # The reader passes on any error of its database, YAML and decompression libraries.
        try:
            reader = stack.enter_context(Reader(path))
            messages = reader.messages()
        except Exception as error:
            raise BagNotReadable(path, str(error)) from error
        while True:
            try:
                connection, time, data = next(messages)
            except StopIteration:
                return
            except Exception as error:
                raise BagNotReadable(path, str(error)) from error
            yield RawMessage(
                connection.topic,
                connection.msgtype,
                time,
                time,
                data,
                connection.msgdef.data,
                _definition_format(connection),
            )


def _definition_format(connection: Connection) -> str:
    assert isinstance(connection.ext, ConnectionExtRosbag2)
    formats = {MessageDefinitionFormat.MSG: "ros2msg", MessageDefinitionFormat.IDL: "ros2idl"}
    return formats.get(connection.msgdef.format, "")


def _bag_information(directory: Path) -> dict[str, Any]:
    """What metadata.yaml says; empty if it is missing or damaged."""
    try:
        content = yaml.safe_load((directory / METADATA_FILE).read_text())
        information = content["rosbag2_bagfile_information"]
    # YAML passes on the errors of its values: an invalid date, a number too long.
    except Exception:
        return {}
    return information if isinstance(information, dict) else {}


def _storage_files(directory: Path, information: dict[str, Any], damage: list[str]) -> list[Path]:
    found = sorted(
        (file for file in directory.iterdir() if file.suffix in _STORAGE_SUFFIXES),
        key=_natural_order,
    )
    listed = information.get("relative_file_paths")
    if not isinstance(listed, list):
        damage.append(f"{METADATA_FILE} is missing or damaged: the recorder was killed")
        files = found
    else:
        # Old versions of rosbag2 wrote the folder's name before the file's.
        names = [Path(str(name)).name for name in listed]
        # Compared as text: a listed name need not be a valid file name.
        existing = {file.name for file in directory.iterdir() if file.is_file()}
        damage += [f"{name}: is missing" for name in names if name not in existing]
        files = [directory / name for name in names if name in existing]
        files += [file for file in found if file.name not in names]
    if not files:
        raise BagNotReadable(directory, "no .mcap or .db3 file in the folder")
    return files


def _natural_order(path: Path) -> list[tuple[int, str]]:
    """Sort key under which ``bag_10`` comes after ``bag_9``."""
    parts = re.split(r"(\d+)", path.name)
    return [(int(part), "") if part.isdigit() else (-1, part) for part in parts]


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
