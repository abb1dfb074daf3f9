"""Messages made wrong in every way that bytes can be wrong, from a seeded generator."""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator

import numpy as np
from geometry_msgs.msg import Pose, PoseArray, PoseStamped
from invariants import UNREACHABLE
from rclpy.serialization import serialize_message

from annik_core.pose import FloatArray
from msg_tools.conversions.pose import pose_from_array

_WILD_NUMBERS = (math.nan, math.inf, -math.inf, 1e308, -1e308, 5e-324, -0.0, 0.0, 1.0, 2.0, 1e9)
_LENGTHS = (0, 1, 2, 255, 1024, 1025, 2**31 - 1, 2**31, 2**32 - 1)

_HEADER_SIZE = 4


def message_of(message_type: type, poses: list[FloatArray], frame_id: str = "") -> Pose:
    """A good message of one of the three types of targets."""
    messages = [pose_from_array(pose) for pose in poses]
    if message_type is Pose:
        return messages[0]
    if message_type is PoseStamped:
        message = PoseStamped(pose=messages[0])
    else:
        message = PoseArray(poses=messages)
    message.header.frame_id = frame_id
    return message


def mutated(
    message_type: type, good: FloatArray, count: int, seed: int, longest: int
) -> Iterator[bytes]:
    """Messages that went wrong: cut short, too long, at random, or with bytes changed.

    Some of them are still messages, and a few even good ones: what each of them means, the test
    has to find out by other means.

    Args:
        message_type: Pose, PoseStamped or PoseArray.
        good: a target to begin with.
        count: how many to make.
        seed: of the random numbers.
        longest: no message is made longer than this [bytes].
    """
    random = np.random.default_rng(seed)
    sound = [
        serialize_message(message_of(message_type, poses, frame_id))
        for frame_id in ("", "base_link", "camera", "\u00e4" * 20, "x" * 1030)
        for poses in ([good], [UNREACHABLE, good], [UNREACHABLE], [UNREACHABLE, good, good])
    ]
    for _ in range(count):
        data = bytearray(sound[int(random.integers(len(sound)))])
        _MUTATIONS[int(random.integers(len(_MUTATIONS)))](data, random)
        # Of nothing at all, the sender's own middleware makes a sample that no reader can take:
        # it sends this and all that comes after it in vain.
        yield bytes(data[:longest]) or b"\x00"


def _cut_short(data: bytearray, random: np.random.Generator) -> None:
    del data[int(random.integers(len(data))) :]


def _lengthen(data: bytearray, random: np.random.Generator) -> None:
    data += random.bytes(int(random.integers(1, 3000)))


def _replace_by_noise(data: bytearray, random: np.random.Generator) -> None:
    data[:] = data[:_HEADER_SIZE] + random.bytes(int(random.integers(200)))


def _replace_all_by_noise(data: bytearray, random: np.random.Generator) -> None:
    data[:] = random.bytes(int(random.integers(200)))


def _change_bytes(data: bytearray, random: np.random.Generator) -> None:
    for _ in range(int(random.integers(1, 6))):
        data[int(random.integers(len(data)))] = int(random.integers(256))


def _put_a_wild_number(data: bytearray, random: np.random.Generator) -> None:
    # Doubles are at multiples of eight, counted from behind the header.
    places = range(_HEADER_SIZE, len(data) - 7, 8)
    number = _WILD_NUMBERS[int(random.integers(len(_WILD_NUMBERS)))]
    struct.pack_into("<d", data, places[int(random.integers(len(places)))], number)


def _put_a_wild_length(data: bytearray, random: np.random.Generator) -> None:
    places = range(_HEADER_SIZE, len(data) - 3, 4)
    length = _LENGTHS[int(random.integers(len(_LENGTHS)))]
    struct.pack_into("<I", data, places[int(random.integers(len(places)))], length)


def _turn_the_byte_order(data: bytearray, _: np.random.Generator) -> None:
    data[1] ^= 1


_MUTATIONS = (
    _cut_short,
    _lengthen,
    _replace_by_noise,
    _replace_all_by_noise,
    _change_bytes,
    _put_a_wild_number,
    _put_a_wild_length,
    _turn_the_byte_order,
)
