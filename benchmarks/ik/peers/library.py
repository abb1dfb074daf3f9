"""The solvers that the benchmark knows."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType

from benchmarks.ik.peers import (
    eaik,
    ik_geo,
    ikpy,
    kdl,
    optik,
    pinocchio_clik,
    roboticstoolbox,
    trac_ik,
)
from benchmarks.ik.peers.peer import Peer, PeerUnavailable
from benchmarks.ik.peers.problem import IkProblem

#: By name, in the order of the tables: the numerical ones, then the closed forms.
PEERS: Mapping[str, Callable[[IkProblem], Peer]] = MappingProxyType(
    {
        kdl.NAME: kdl.make,
        trac_ik.NAME: trac_ik.make,
        roboticstoolbox.ONE_START: roboticstoolbox.make,
        roboticstoolbox.WITH_RESTARTS: roboticstoolbox.make_with_restarts,
        optik.NAME: optik.make,
        pinocchio_clik.NAME: pinocchio_clik.make,
        ikpy.NAME: ikpy.make,
        eaik.NAME: eaik.make,
        ik_geo.NAME: ik_geo.make,
    }
)


def available_peers(problem: IkProblem) -> tuple[list[Peer], list[tuple[str, str]]]:
    """The solvers that are installed and can do a problem's robot.

    Returns:
        Them, in the order of :data:`PEERS`; and the name of each other one with the reason.

    Raises:
        InvalidRobotDefinition: if the problem itself is at fault.
    """
    ready: list[Peer] = []
    skipped: list[tuple[str, str]] = []
    for name, make in PEERS.items():
        try:
            ready.append(make(problem))
        except PeerUnavailable as unavailable:
            skipped.append((name, unavailable.reason))
    return ready, skipped
