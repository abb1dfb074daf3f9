"""Streams of targets: how many get a command, their age by then, and the processor time."""

from __future__ import annotations

import time
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState

from annik_core.pose import FloatArray
from annik_core.robots.library import load_robot
from annik_ros.processes import ChildProcess
from benchmarks.node.client import Client, Link, NoCommand, no_garbage_collection
from benchmarks.node.nodes import NULL, NodeVariant
from benchmarks.node.process_usage import cpu_seconds
from benchmarks.node.results import StreamResult, Summary
from benchmarks.node.settings import StreamPlan
from benchmarks.node.target_stream import Stream, TargetStreams
from benchmarks.node.targets import pose_to_bytes, random_poses
from msg_tools.conversions.cdr import pose_stamped_from_bytes
from msg_tools.conversions.stamp import stamp_to_nanoseconds
from msg_tools.topics import TARGET_POSE

#: Commands that must have arrived before a stream begins.
_PRELUDE_COMMANDS = 20
_PRELUDE_TIMEOUT = 60.0
#: Processor time counts between these parts of a stream.
_CPU_FROM, _CPU_TO = 0.1, 0.9
#: Period at which the end of a stream is checked [s].
_LOOK_PERIOD = 0.05


def measure_streams(
    client: Client,
    streams: TargetStreams,
    plans: Sequence[StreamPlan],
    seconds: float,
    logs: Path,
    rng: np.random.Generator,
) -> list[StreamResult]:
    """Every plan with an ``ik_node`` for the gantry and with a null node, one after the other.

    Args:
        client: takes the commands.
        streams: publishes the targets.
        plans: what to publish.
        seconds: how long each stream lasts [s].
        logs: existing folder for what the nodes print.
        rng: draws the targets.

    Raises:
        NoCommand: if no command of a node arrives.
    """
    most = max(int(plan.rate * seconds) for plan in plans)
    first, *poses = random_poses(load_robot("gantry"), most + 1, rng)
    prelude, targets = pose_to_bytes(first), [pose_to_bytes(pose) for pose in poses]
    places = {float(pose[0]): index for index, pose in enumerate(poses)}
    results = []
    with ExitStack() as stack:
        nodes: dict[NodeVariant, tuple[Link, ChildProcess]] = {}
        for depth in sorted({plan.queue_depth for plan in plans}):
            for variant in (
                NodeVariant("ik_node", model="gantry", queue_depth=depth),
                NodeVariant(NULL, queue_depth=depth, marked=True),
            ):
                link = client.link(f"/stream_{len(nodes)}")
                stack.callback(link.destroy)
                if not variant.is_null:
                    link.listen_to_accepted_targets()
                nodes[variant] = link, stack.enter_context(variant.start(link.namespace, logs))
        for plan in plans:
            count = int(plan.rate * seconds)
            for variant, (link, process) in nodes.items():
                if variant.queue_depth != plan.queue_depth:
                    continue
                topic = f"{link.namespace}/{TARGET_POSE.name}"
                stream = Stream(topic, plan.rate, count, targets[:count], prelude)
                times, cpu = _streamed(client, streams, stream, link, process)
                commands = _null_commands(link) if variant.is_null else _commands(link)
                results.append(_result(variant, plan, times, commands, places, cpu))
                link.commands.clear()
                link.accepted_targets.clear()
    return results


def _streamed(
    client: Client, streams: TargetStreams, stream: Stream, link: Link, process: ChildProcess
) -> tuple[NDArray[np.int64], float]:
    """When the targets were published [ns], and the node's share of a core [%]."""
    start_prelude(client, streams, stream, [link])
    with no_garbage_collection():
        link.keeps = True
        streams.go()
        begin = time.perf_counter()
        duration = stream.count / stream.rate
        client.spin_for(_CPU_FROM * duration)
        used, since = cpu_seconds(process.pid), time.perf_counter()
        client.spin_for(begin + _CPU_TO * duration - time.perf_counter())
        used, since = cpu_seconds(process.pid) - used, time.perf_counter() - since
        while not streams.ended:
            client.spin_for(_LOOK_PERIOD)
        # Targets that still wait get their commands.
        client.quiet(link)
        link.keeps = False
    return streams.times(), 100.0 * used / since


def start_prelude(
    client: Client, streams: TargetStreams, stream: Stream, links: Sequence[Link]
) -> None:
    """Have the prelude of a stream published until commands of every node arrive.

    Raises:
        NoCommand: if those of one do not.
    """
    streams.prepare(stream)
    for link in links:
        wanted = link.received + _PRELUDE_COMMANDS
        arrived = client.spin_until(
            lambda link=link, wanted=wanted: link.received >= wanted,  # type: ignore[misc]
            _PRELUDE_TIMEOUT,
        )
        if not arrived:
            raise NoCommand(link.namespace, _PRELUDE_TIMEOUT)


def _commands(link: Link) -> list[tuple[float, int]]:
    """The x and stamp [ns] of every target that was accepted and has a command."""
    stamps = {_stamp_of_command(data) for data in link.commands}
    accepted = (pose_stamped_from_bytes(data) for data in link.accepted_targets)
    return [
        (float(target.poses[0, 0]), target.nanoseconds)
        for target in accepted
        if target.nanoseconds in stamps
    ]


def _null_commands(link: Link) -> list[tuple[float, int]]:
    """The same of a null node, whose commands carry both."""
    messages = (deserialize_message(data, JointState) for data in link.commands)
    return [
        (float(message.position[0]), stamp_to_nanoseconds(message.header.stamp))
        for message in messages
    ]


def _stamp_of_command(data: bytes) -> int:
    """The stamp of a ``joint_command`` [ns]."""
    return stamp_to_nanoseconds(deserialize_message(data, JointState).header.stamp)


def _result(
    variant: NodeVariant,
    plan: StreamPlan,
    times: NDArray[np.int64],
    commands: Sequence[tuple[float, int]],
    places: dict[float, int],
    cpu: float,
) -> StreamResult:
    ages = ages_of(times, commands, places)
    lasted = 1e-9 * float(times[-1] - times[0])
    return StreamResult(
        node=variant.name,
        queue_depth=plan.queue_depth,
        rate=plan.rate,
        reached_rate=(len(times) - 1) / lasted if lasted > 0 else 0.0,
        sent=len(times),
        answered=len(ages),
        age=Summary.of(1e3 * ages),
        cpu=cpu,
    )


def ages_of(
    times: NDArray[np.int64], commands: Sequence[tuple[float, int]], places: dict[float, int]
) -> FloatArray:
    """Ages of the targets when their commands were made, one for each command [s].

    Args:
        times: when each target was published [ns].
        commands: x of the target, and the stamp [ns] of its command.
        places: index of each target by its x. Others, such as the prelude, do not count.
    """
    stamps = {places[x]: stamp for x, stamp in commands if x in places and places[x] < len(times)}
    return np.array([1e-9 * (stamp - int(times[place])) for place, stamp in stamps.items()])
