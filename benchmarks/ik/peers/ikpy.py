"""IKPy with its default optimiser, scipy's least_squares by finite differences.

Targets are the position and all three axes of the orientation, with scipy's default tolerances
(1e-8 on the change of cost, step and gradient; IKPy sets none) and number of evaluations. It
starts at the centre of the joint box and is given the joint box as its bounds. It reports no
failure. Locked joints are fixed in its chain.
"""

from __future__ import annotations

from types import ModuleType
from typing import Any

import numpy as np

from annik_core.pose import FloatArray
from benchmarks.ik.peers.peer import Kind, Peer, imported, installed_version
from benchmarks.ik.peers.pose_matrix import pose_matrix, roll_pitch_yaw
from benchmarks.ik.peers.problem import IkProblem, free_chain

NAME = "IKPy"


class _Ikpy(Peer):
    name = NAME
    kind: Kind = "numerical"
    settings = "least_squares with scipy's defaults, no restart, start at box centre, bounds = box"

    def __init__(
        self, chain_module: ModuleType, link_module: ModuleType, problem: IkProblem
    ) -> None:
        self._problem = problem
        self.version = installed_version("ikpy")
        links = _links(link_module, problem)
        # The first link is the base and the last the tip: neither moves.
        moving = [False, *([True] * len(problem.free)), False]
        self._chain = chain_module.Chain(links, active_links_mask=moving)

    def solve(self, pose: FloatArray, start: FloatArray | None = None) -> FloatArray | None:
        """See :meth:`benchmarks.ik.peers.peer.Peer.solve`."""
        begin = np.concatenate([[0.0], self._problem.free_of(start), [0.0]])
        found = self._chain.inverse_kinematics_frame(
            pose_matrix(pose), initial_position=begin, orientation_mode="all"
        )
        return self._problem.with_locked(np.asarray(found[1:-1], dtype=np.float64))


def make(problem: IkProblem) -> Peer:
    """IKPy for a problem.

    Raises:
        PeerUnavailable: if IKPy is not installed.
    """
    remedy = "pip install ikpy"
    return _Ikpy(
        imported(NAME, "ikpy.chain", remedy), imported(NAME, "ikpy.link", remedy), problem
    )


def _links(link_module: ModuleType, problem: IkProblem) -> list[Any]:
    chain = free_chain(problem)
    links = [link_module.OriginLink()]
    for column, joint in enumerate(chain.joints):
        motion = {"translation" if joint.prismatic else "rotation": joint.axis}
        links.append(
            link_module.URDFLink(
                name=joint.name,
                origin_translation=joint.placement[:3, 3],
                origin_orientation=np.array(roll_pitch_yaw(joint.placement[:3, :3])),
                bounds=tuple(float(bounds[column]) for bounds in problem.free_box),
                joint_type="prismatic" if joint.prismatic else "revolute",
                **motion,
            )
        )
    links.append(
        link_module.URDFLink(
            name="tip",
            origin_translation=chain.tip[:3, 3],
            origin_orientation=np.array(roll_pitch_yaw(chain.tip[:3, :3])),
            joint_type="fixed",
        )
    )
    return links
