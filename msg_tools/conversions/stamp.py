"""ROS stamps as nanoseconds and back."""

from __future__ import annotations

from builtin_interfaces.msg import Time

from annik_core.errors import ConversionError

NANOSECONDS_PER_SECOND = 1_000_000_000
_SECONDS_RANGE = (-(2**31), 2**31 - 1)


class StampOutOfRange(ConversionError):
    """A time is too far from the epoch for a ROS stamp, whose seconds have 32 bits."""

    def __init__(self, nanoseconds: int) -> None:
        self.nanoseconds = nanoseconds
        super().__init__(f"{nanoseconds} ns since the epoch does not fit into a ROS stamp")


class MalformedStamp(ConversionError):
    """A stamp's nanoseconds make a whole second or more: two stamps could mean one time."""

    def __init__(self, nanosec: int) -> None:
        self.nanosec = nanosec
        super().__init__(
            f"header.stamp.nanosec is {nanosec}; it must be less than {NANOSECONDS_PER_SECOND}"
        )


def stamp_from_message(message: Time) -> int:
    """Time since the epoch of the clock that made the stamp [ns].

    Whatever this returns, :func:`stamp_to_message` takes back.

    Raises:
        MalformedStamp: if the nanoseconds are a second or more.
    """
    nanosec = int(message.nanosec)
    if nanosec >= NANOSECONDS_PER_SECOND:
        raise MalformedStamp(nanosec)
    return int(message.sec) * NANOSECONDS_PER_SECOND + nanosec


def split_stamp(nanoseconds: int) -> tuple[int, int]:
    """Seconds and nanoseconds of a time since the epoch [ns]; exact, so that they can be compared.

    Raises:
        StampOutOfRange: if the seconds do not fit into 32 bits.
    """
    seconds, remainder = divmod(int(nanoseconds), NANOSECONDS_PER_SECOND)
    if not _SECONDS_RANGE[0] <= seconds <= _SECONDS_RANGE[1]:
        raise StampOutOfRange(nanoseconds)
    return seconds, remainder


def stamp_to_message(nanoseconds: int) -> Time:
    """The stamp of a time since the epoch [ns].

    Raises:
        StampOutOfRange: if the seconds do not fit into 32 bits.
    """
    seconds, remainder = split_stamp(nanoseconds)
    return Time(sec=seconds, nanosec=remainder)
