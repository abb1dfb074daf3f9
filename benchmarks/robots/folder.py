"""The arms of a folder: URDFs, and their frames from an ``index.csv`` beside them."""

from __future__ import annotations

import csv
import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from annik_core.errors import AnnikError
from benchmarks.ik.peers.serial_chain import MOVING

INDEX = "index.csv"


class NoRobots(AnnikError):
    """There is no URDF in a folder."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        super().__init__(f"no file *.urdf in {folder}: give the folder that has them")


@dataclass(frozen=True)
class ArmFile:
    """A URDF, and the chain in it.

    Attributes:
        name: of the file, without ``.urdf``.
        urdf: its text.
        base_frame: where the chain begins.
        end_effector_frame: where it ends.
    """

    name: str
    urdf: str
    base_frame: str
    end_effector_frame: str


def arms_of(folder: Path) -> list[ArmFile]:
    """The arms of a folder by name, each between the frames of the index, or its longest chain.

    Raises:
        NoRobots: if there are none.
    """
    index = _index(folder / INDEX)
    arms = []
    for path in sorted(folder.glob("*.urdf")):
        urdf = path.read_text(encoding="utf-8")
        frames = index.get(path.stem) or longest_chain(urdf)
        arms.append(ArmFile(path.stem, urdf, *frames))
    if not arms:
        raise NoRobots(folder)
    return arms


def longest_chain(urdf: str) -> tuple[str, str]:
    """First and last link of the chain with most moving joints, of those the longest."""
    joints = ElementTree.fromstring(urdf).findall("joint")
    above = {_link(joint, "child"): joint for joint in joints}
    tips = [link for link in above if link not in {_link(joint, "parent") for joint in joints}]

    def chain(tip: str) -> tuple[int, int, str]:
        moving, length, link = 0, 0, tip
        while link in above and length < len(joints):
            joint = above[link]
            moving, length = moving + (joint.get("type") in MOVING), length + 1
            link = _link(joint, "parent")
        return moving, length, link

    tip = max(tips, key=lambda tip: chain(tip)[:2])
    return chain(tip)[2], tip


def _link(joint: ElementTree.Element, end: str) -> str:
    element = joint.find(end)
    return "" if element is None else element.get("link", "")


def _index(path: Path) -> Mapping[str, tuple[str, str]]:
    if not path.is_file():
        return {}
    with path.open(encoding="utf-8", newline="") as file:
        return {
            row["name"]: (row["base_frame"], row["end_effector_frame"])
            for row in csv.DictReader(file)
        }
