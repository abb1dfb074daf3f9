"""ROS stamps as nanoseconds and back."""

from builtin_interfaces.msg import Time

from annik_core.errors import ConversionError, InvalidValue
from annik_core.serving.stamps import LAST_STAMP

_NANOSECONDS = 1_000_000_000
_SECONDS_RANGE = (-(2**31), 2**31 - 1)


class InvalidStamp(InvalidValue, ConversionError):
    """A stamp is malformed, or a time does not fit into one."""


def join_stamp(sec: int, nanosec: int) -> int:
    """Time since the epoch [ns] of the two fields of a stamp.

    Raises:
        InvalidStamp: if ``nanosec`` is a second or more.
    """
    if nanosec >= _NANOSECONDS:
        raise InvalidStamp("header.stamp.nanosec", nanosec, f"less than {_NANOSECONDS}")
    return sec * _NANOSECONDS + nanosec


def split_stamp(nanoseconds: int) -> tuple[int, int]:
    """The two fields ``sec`` and ``nanosec`` of a time since the epoch [ns].

    Raises:
        InvalidStamp: if the seconds do not fit into 32 bits.
    """
    seconds, remainder = divmod(int(nanoseconds), _NANOSECONDS)
    if not _SECONDS_RANGE[0] <= seconds <= _SECONDS_RANGE[1]:
        raise InvalidStamp("time since the epoch [ns]", nanoseconds, "32-bit seconds")
    return seconds, remainder


def stamp_to_nanoseconds(message: Time) -> int:
    """Time since the epoch of the clock that made the stamp [ns]."""
    return join_stamp(int(message.sec), int(message.nanosec))


def stamp_from_nanoseconds(nanoseconds: int) -> Time:
    """The stamp of a time since the epoch [ns]."""
    sec, nanosec = split_stamp(nanoseconds)
    return Time(sec=sec, nanosec=nanosec)


def nearest_stamp(nanoseconds: int) -> Time:
    """The stamp of a time [ns], or the last that there is; a simulated time may be too late."""
    return stamp_from_nanoseconds(min(nanoseconds, LAST_STAMP))
