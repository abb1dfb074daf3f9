"""Write a bag that ROS 2 opens and that stays readable if the writer is killed."""

import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from types import TracebackType
from typing import IO, Any, Final, cast

from mcap.writer import CompressionType, Writer
from rosbags.interfaces import Qos

from annik_core.errors import NotWritable
from annik_core.files import write_files_atomically
from msg_tools.bags import metadata
from msg_tools.bags.provisional_end import LIBRARY, ClosedMcapFile

#: Messages are written to the file after so many bytes or so many seconds.
CHUNK_SIZE: Final = 64 * 1024
FLUSH_INTERVAL: Final = 0.1
#: Interval of updates of metadata.yaml while writing [s].
METADATA_INTERVAL: Final = 2.0


class BagWriter:
    """A rosbag2 directory with one MCAP file, being written; a context manager.

    A process killed at any moment leaves a bag with everything up to the last flush. Every method
    raises NotWritable if writing fails; everything flushed before stays readable.
    """

    def __init__(self, directory: Path) -> None:
        """Create the bag in an empty folder, or in a new one.

        Raises:
            NotWritable: if it exists and is not an empty folder, or can't be created.
        """
        self._directory = directory
        self._file_name = f"{directory.absolute().name}_0.mcap"
        self._topics: dict[str, metadata.RecordedTopic] = {}
        self._channels: dict[str, int] = {}
        self._schemas: dict[str, int] = {}
        self._span = metadata.RecordedSpan()
        self._unflushed = 0
        self._flushed_at = time.monotonic()
        self._metadata_at = 0.0
        self._broken = False
        self._closed = False
        self._make_empty_directory()
        with self._failing_for_good():
            self._file = ClosedMcapFile(directory / self._file_name)
            self._writer = Writer(
                cast("IO[Any]", self._file),
                # Chunks end at flush() only, so that each is written in one piece.
                chunk_size=2**40,
                compression=CompressionType.NONE,
            )
            self._writer.start(profile="ros2", library=LIBRARY)
            self._file.flush()
            self._write_metadata()

    @property
    def directory(self) -> Path:
        """The bag's folder."""
        return self._directory

    @property
    def message_count(self) -> int:
        """Messages written so far, all topics together."""
        return sum(topic.message_count for topic in self._topics.values())

    def __enter__(self) -> "BagWriter":
        return self

    def __exit__(
        self,
        exception_type: type[BaseException] | None,
        exception: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        """Close the bag; an error while closing does not hide an earlier one."""
        if exception is None:
            self.close()
        else:
            with suppress(NotWritable):
                self.close()

    def __contains__(self, topic: str) -> bool:
        return topic in self._topics

    def add_topic(self, name: str, message_type: str, offered_qos: Sequence[Qos] = ()) -> None:
        """Add a topic by its absolute name, before its first message.

        Raises:
            NotWritable: if the type does not come with ROS 2 Jazzy, or the topic has another type.
        """
        if name in self._topics:
            if self._topics[name].type != message_type:
                known = self._topics[name].type
                raise NotWritable(
                    self._directory,
                    f"topic {name} has the type {known}, not {message_type}",
                    "a topic of a bag has one type",
                )
            return
        if not metadata.is_known_type(message_type):
            raise NotWritable(
                self._directory,
                f"topic {name} has the unknown type {message_type}",
                "record types that come with ROS 2 Jazzy",
            )
        if message_type not in self._schemas:
            definition, _ = metadata.jazzy_types().generate_msgdef(message_type, ros_version=2)
            self._schemas[message_type] = self._writer.register_schema(
                message_type, "ros2msg", definition.encode()
            )
        self._channels[name] = self._writer.register_channel(
            name,
            "cdr",
            self._schemas[message_type],
            {
                "offered_qos_profiles": metadata.qos_text(offered_qos),
                "topic_type_hash": metadata.jazzy_types().hash_rihs01(message_type),
            },
        )
        self._topics[name] = metadata.RecordedTopic(name, message_type, tuple(offered_qos))
        with self._failing_for_good():
            self._write_metadata()

    def write(self, topic: str, cdr: bytes, log_time_ns: int, publish_time_ns: int) -> None:
        """Add a message to a topic that was added; times in ns since the epoch.

        ``cdr`` begins with the four bytes of encapsulation, as DDS carries it.

        Raises:
            KeyError: if the topic was not added.
        """
        self._refuse_if_broken()
        recorded = self._topics[topic]
        self._writer.add_message(
            channel_id=self._channels[topic],
            log_time=log_time_ns,
            data=cdr,
            publish_time=publish_time_ns,
            sequence=recorded.message_count,
        )
        recorded.message_count += 1
        self._span.include(log_time_ns)
        self._unflushed += len(cdr)
        due = time.monotonic() - self._flushed_at >= FLUSH_INTERVAL
        if due or self._unflushed >= CHUNK_SIZE:
            self.flush()

    def flush(self) -> None:
        """Write all messages to the file.

        :meth:`write` does this when it is due; call it on a timer for the last message before a
        pause.
        """
        self._refuse_if_broken()
        with self._failing_for_good():
            if self._unflushed:
                self._writer.flush()  # type: ignore[no-untyped-call]
            self._unflushed = 0
            self._flushed_at = time.monotonic()
            if self._flushed_at - self._metadata_at >= METADATA_INTERVAL:
                self._write_metadata()

    def close(self) -> None:
        """Complete the file and its metadata; does nothing if closed or failed before."""
        if self._closed or self._broken:
            return
        self._closed = True
        with self._failing_for_good():
            self._writer.flush()  # type: ignore[no-untyped-call]
            self._writer.add_metadata(
                "rosbag2", {"serialized_metadata": metadata.yaml_text(self._information())}
            )
            self._writer.finish()  # type: ignore[no-untyped-call]
            self._file.close(with_own_end=True)
            self._write_metadata()

    def _make_empty_directory(self) -> None:
        try:
            self._directory.mkdir(parents=True, exist_ok=True)
            occupied = any(self._directory.iterdir())
        except OSError as error:
            reason = error.strerror or str(error)
            raise NotWritable(self._directory, reason, "give another folder") from error
        if occupied:
            raise NotWritable(
                self._directory,
                "the folder is not empty",
                "a bag is never overwritten; give another folder or remove this one",
            )

    def _information(self) -> Mapping[str, Any]:
        return metadata.bag_information(self._file_name, list(self._topics.values()), self._span)

    def _write_metadata(self) -> None:
        text = metadata.yaml_text({"rosbag2_bagfile_information": self._information()})
        write_files_atomically(self._directory, {metadata.METADATA_FILE: text.encode()})
        self._metadata_at = time.monotonic()

    def _refuse_if_broken(self) -> None:
        if self._broken:
            raise NotWritable(self._directory, "writing failed before", "start another bag")
        if self._closed:
            raise NotWritable(self._directory, "the bag is closed", "start another bag")

    @contextmanager
    def _failing_for_good(self) -> Iterator[None]:
        """Close the file where writing fails; what was flushed before stays readable."""
        try:
            yield
        except (OSError, NotWritable) as error:
            self._broken = True
            with suppress(OSError, AttributeError):
                self._file.close(with_own_end=False)
            reason = error.strerror or str(error) if isinstance(error, OSError) else error.reason
            remedy = "check free space and permissions; what was recorded before is kept"
            raise NotWritable(self._directory, reason, remedy) from error
