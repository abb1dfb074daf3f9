"""The meshes of a URDF: where they are looked for, and where they are drawn."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from annik_view.meshes import link_meshes
from annik_view.solvers import solver_of
from annik_view.state import ViewState

trimesh = pytest.importorskip("trimesh", reason="meshes need trimesh: pip install '.[view]'")

SIZE = (0.2, 0.04, 0.06)
VISUAL = """<visual>
  <origin xyz="0 0 0.1" rpy="0 0 1.5707963267948966"/>
  <geometry><mesh filename="{name}" scale="1 2 1"/></geometry>
</visual>"""
URDF = """<robot name="two">
<link name="base">{base}</link>
<link name="arm">{arm}</link>
<link name="tool"/>
<link name="camera">{arm}</link>
<joint name="turn" type="revolute">
  <parent link="base"/><child link="arm"/><axis xyz="0 0 1"/><origin xyz="0.3 0 0"/>
  <limit lower="-3" upper="3" effort="1" velocity="1"/>
</joint>
<joint name="slide" type="prismatic">
  <parent link="arm"/><child link="tool"/><axis xyz="0 0 1"/>
  <limit lower="0" upper="1" effort="1" velocity="1"/>
</joint>
<joint name="mount" type="fixed"><parent link="base"/><child link="camera"/></joint>
</robot>"""


@pytest.fixture
def package(tmp_path: Path) -> Path:
    """A package of a robot, as ROS packages are laid out."""
    folder = tmp_path / "two_description"
    for name in ("meshes", "urdf"):
        (folder / name).mkdir(parents=True)
    trimesh.creation.box(SIZE).export(folder / "meshes" / "box.stl")
    return folder


def written(package: Path, base: str, arm: str) -> Path:
    file = package / "urdf" / "two.urdf"
    texts = {"base": VISUAL.format(name=base), "arm": VISUAL.format(name=arm)}
    file.write_text(URDF.format(**texts), encoding="utf-8")
    return file


@pytest.mark.parametrize("name", ["package://two_description/meshes/box.stl", "../meshes/box.stl"])
def test_a_mesh_is_found_scaled_and_placed(package: Path, name: str) -> None:
    first, *_ = link_meshes(written(package, name, "missing.stl"))
    assert first.link == "base"
    # Twice as wide along y, turned by a quarter, and lifted.
    np.testing.assert_allclose(np.ptp(first.mesh.vertices, axis=0), [0.08, 0.2, 0.06], atol=1e-6)
    np.testing.assert_allclose(first.mesh.vertices.mean(axis=0), [0, 0, 0.1], atol=1e-6)


def test_a_sourced_ros_is_searched(
    package: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    share = tmp_path / "install" / "share"
    share.mkdir(parents=True)
    (share / "other").symlink_to(package)
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path / "install"))
    found = link_meshes(written(package, "package://other/meshes/box.stl", ""))
    assert [one.link for one in found] == ["base"]


def test_what_is_missing_or_damaged_is_left_out(package: Path) -> None:
    (package / "meshes" / "bad.stl").write_bytes(b"solid nothing")
    assert link_meshes(written(package, "../meshes/bad.stl", "package://no/box.stl")) == []
    assert link_meshes(package / "none.urdf") == []
    assert link_meshes("ur5e") == []


def test_a_mesh_moves_with_its_link(package: Path) -> None:
    name = "../meshes/box.stl"
    urdf = written(package, name, name)
    solver = solver_of(urdf, base_frame="base", end_effector_frame="tool")
    state = ViewState(solver, meshes=link_meshes(urdf))
    assert [one.link for one in state.meshes] == ["base", "arm", "camera"]
    state.show_joints([0.7, 0.2])
    base, arm, camera = state.mesh_poses()
    assert base == [0, 0, 0, 0, 0, 0, 1] and camera is None
    assert arm is not None
    expected = Rotation.from_rotvec([0, 0, 0.7]).as_quat()
    np.testing.assert_allclose(arm, [0.3, 0, 0, *expected], atol=1e-9)
