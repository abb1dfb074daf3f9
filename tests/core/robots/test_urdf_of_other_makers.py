"""URDFs of many makers: what is off the chain refuses nothing, what is on it is never dropped."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from support.refused_definition import refused_definition
from support.urdf_texts import J1, J2, TWO_JOINTS, joint, planar_arm, urdf

from annik_core.pose import FloatArray, pose_distance
from annik_core.robots.library import load_robot, robot_from_definition
from annik_core.robots.urdf import serial_chain

XACRO = 'xmlns:xacro="http://www.ros.org/wiki/xacro"'
AXIS = '<axis xyz="0 0 1"/>'
CASES = Path(__file__).parents[4] / "shared" / "cases"


def refused(text: str, *named: str, **frames: str) -> None:
    refused_definition(lambda: serial_chain(text, "test", **frames), *named)


def second(more: str = "", **changes: str) -> str:
    return urdf("abc", J1, joint("j2", "b", "c", more=more, **changes))


def origin(attributes: str, more: str = "") -> str:
    text = joint("j2", "b", "c", origin=attributes)
    return urdf("abc", J1, text.replace("</joint>", f"{more}</joint>"))


class TestOffTheChain:
    """What has no part in the kinematics of the chain."""

    @pytest.mark.parametrize(
        "more",
        [
            "<gazebo><controller:gz_ros name='x'/></gazebo>",
            "<drake:proximity_properties><drake:mu value='1'/></drake:proximity_properties>",
            "<gazebo><plugin drake:x='1' gz:y='2'/></gazebo>",
            "<xacro:property name='unused' value='${pi / 2}'/>",
            "<xacro:arg name='prefix' default='$(env HOME)'/>",
            "<xacro:macro name='m' params='p'><joint name='${p}'/></xacro:macro>",
            "<property name='unused' value='1'/>",
            "<macro name='m' params='p'><joint name='${p}'/></macro>",
            "<link name='d'><visual><geometry><xacro:box/></geometry></visual></link>",
            "<link name='d'><visual><origin xyz='${x} 0 0'/></visual></link>",
            "<link name='d'><inertial><mass value='nan'/></inertial></link>",
            "<link name='d'><inertial><mass value=''/></inertial></link>",
            "<gazebo><xacro:if value='1'><x/></xacro:if></gazebo>",
            "<!-- a -- b -- c ---><!-----><!-- <!ENTITY a 'b'> & <robot> -->",
            "<!-- <!-- twice --><?php echo '-->' ?>",
            "<link name='R&D'/><material name='black & white &nbsp;'/>",
            "<gazebo><![CDATA[ <joint name='j1'> <!-- & ]]></gazebo>",
            "<g:joint name='j1'/>",
            "<link name=''/><link/><link name='a&#10;b'/>",
            "<link name='d'/><link name='d'/>",
            "<transmission><joint name='j2'><mechanicalReduction>50</mechanicalReduction></joint>"
            "</transmission>",
            "<gazebo reference='j2'><pose>1 2 3 0 0 0</pose></gazebo>",
            "<frame name='tool' link='c' xyz='0 0 1' rpy='0 0 0'/>",
            "<ros2_control><joint name='j9'><param name='mimic'>j1</param></joint></ros2_control>",
        ],
    )
    def test_elements_that_are_no_joints_are_passed_over(self, more: str) -> None:
        text = urdf("abc", J1, more, J2)
        assert serial_chain(text, "test") == serial_chain(TWO_JOINTS, "test")
        assert serial_chain(text.replace("<robot", f"<robot {XACRO}"), "test", "a", "c") == (
            serial_chain(TWO_JOINTS, "test")
        )

    @pytest.mark.parametrize(
        "other",
        [
            "<joint/>",
            "<joint name='x'/>",
            "<joint name='j3' type='revolute'><parent link='c'/></joint>",
            joint("j3", "c", "nowhere"),
            joint("", "c", "d"),
            joint("j3", "c", "d", "", origin='xyz="1" quat_xyzw="0 0 0 0"'),
            joint("j3", "d", "e") + joint("j3", "d", "f"),
            joint("j3", "d", "e") + joint("j4", "e", "d"),
            joint("j3", "d", "e") + joint("j4", "f", "e"),
            joint("${prefix}", "c", "d", "${kind}", origin='xyz="${x} 0 0"'),
            "<drake:joint name='j3' type='ball'><parent link='c'/><child link='d'/></drake:joint>",
            "<xacro:gripper parent='c'/>",
            "<xacro:include filename='$(find gripper)/gripper.xacro'/>",
            "<include filename='gripper.xacro'/>",
            "<xacro:if value='1'><joint name='j3'/></xacro:if>",
        ],
    )
    def test_joints_off_a_chain_with_both_ends_given_are_passed_over(self, other: str) -> None:
        """In a tree nothing else can lie between its ends."""
        text = urdf("abcdef", J1, other, J2)
        assert serial_chain(text, "test", "a", "c") == serial_chain(TWO_JOINTS, "test")

    @pytest.mark.parametrize(
        "more",
        [
            "<axis xyz=''/>",
            "<axis xyz='nan nan nan'/>",
            "<axis xyz='0 0 0'/>",
            "<axis/>",
            "<limit lower='' upper='' effort='' velocity=''/>",
            "<limit lower='nan' upper='-inf'/>",
            "<limit lower='${x}'/>",
            "<mimic joint='j1'/>",
            "<safety_controller soft_lower_limit='x'/>",
            "<calibration rising=''/><dynamics damping='' friction='nan'/>",
        ],
    )
    def test_what_a_fixed_joint_does_not_need(self, more: str) -> None:
        bare = "<parent link='c'/><child link='d'/><origin xyz='0 0 0.1'/>"
        fixed = f"<joint name='flange' type='fixed'>{bare}{more}</joint>"
        plain = urdf("abcd", J1, J2, fixed.replace(more, ""))
        assert serial_chain(urdf("abcd", J1, J2, fixed), "test") == serial_chain(plain, "test")

    @pytest.mark.parametrize(
        "more",
        [
            "<dynamics damping='' friction='x'/>",
            "<calibration rising='nan' falling=''/>",
            "<limit lower='-1' upper='1'/>",
            "<xacro:property name='x' value='1'/>",
            "<hardwareInterface>x</hardwareInterface><drake:acceleration value='1'/>",
            "<safety_controller k_velocity='' soft_lower_limit='' soft_upper_limit=''/>",
            "<safety_controller k_velocity='10' soft_lower_limit='0' soft_upper_limit='0'/>",
        ],
    )
    def test_what_a_joint_of_the_chain_has_beside_its_kinematics(self, more: str) -> None:
        assert serial_chain(second(more), "test") == serial_chain(TWO_JOINTS, "test")

    def test_zeros_mean_nothing_in_any_format(self) -> None:
        text = second(axis='xyz="0 0 1" rpy="0 0 0"')
        assert serial_chain(text, "test") == serial_chain(TWO_JOINTS, "test")

    def test_a_continuous_joint_with_limits_that_are_none(self) -> None:
        for limit in ('lower="" upper="nan"', 'lower="${-pi}" upper="x"', 'lower="-inf"'):
            serial_chain(second(kind="continuous", limit=limit), "test")

    @pytest.mark.parametrize("end", ["\0", "\n\0\0", " \t\r\n"])
    def test_what_follows_the_last_element(self, end: str) -> None:
        assert serial_chain(TWO_JOINTS + end, "test") == serial_chain(TWO_JOINTS, "test")

    @pytest.mark.parametrize(
        "before",
        [
            "<!DOCTYPE robot SYSTEM 'robot.dtd'>",
            "<!DOCTYPE robot PUBLIC '-//x//y' 'http://x/robot.dtd' [<!ELEMENT robot ANY>]>",
            "<!-- licence -->\n<?xml version='1.1'?>\n",
            "<?xml version='1.0' standalone='no'?><?xml-stylesheet href='x'?>",
        ],
    )
    def test_what_precedes_the_robot(self, before: str) -> None:
        assert serial_chain(before + TWO_JOINTS, "test") == serial_chain(TWO_JOINTS, "test")


class TestNeverDropped:
    """What carries kinematics is honoured or refused."""

    @pytest.mark.parametrize(
        "quaternion",
        [
            (0, 0, 0.7071, 0.7071),
            (0.5, -0.5, 0.5, 0.5),
            (0, 0.70710678, 0, 0.70710678),
            (1, 0, 0, 0),
        ],
    )
    def test_a_quaternion_is_the_rotation_that_it_is(self, quaternion: tuple[float, ...]) -> None:
        text = origin(f'xyz="1 2 3" quat_xyzw="{" ".join(map(str, quaternion))}"')
        roll_pitch_yaw = Rotation.from_quat(quaternion).as_euler("xyz").tolist()
        same = origin(f'xyz="1 2 3" rpy="{" ".join(map(repr, roll_pitch_yaw))}"')
        q = np.array([[0.3, -0.7]])
        poses = [load_robot(one).forward_kinematics.poses(q) for one in (text, same)]
        assert np.abs(poses[0] - poses[1]).max() < 1e-12

    @pytest.mark.parametrize(
        ("text", "named"),
        [
            (origin('rpy="0 0 0" quat_xyzw="0 0 0 1"'), ["rpy", "quat_xyzw"]),
            (origin('quat_xyzw="0 0 0 0"'), ["quat_xyzw", "norm 0"]),
            (origin('quat_xyzw="0 0 1 1"'), ["quat_xyzw", "1.41421"]),
            (origin('quat_xyzw="0 0 1"'), ["quat_xyzw", "'0 0 1'", "four"]),
            (origin('quat_xyzw="0 0 nan 1"'), ["quat_xyzw", "four"]),
            (origin('quat_wxyz="1 0 0 0"'), ["quat_wxyz", "<origin>"]),
            (origin('xyz="0 0 1" euler="0 0 90"'), ["euler", "<origin>"]),
            (origin('xyz="0 0 1" degrees="true"'), ["degrees", "<origin>"]),
            (origin('xyz="" rpy="0 0 0"'), ["xyz ''", "three"]),
            (origin('xyz="1,0 2,0 0"'), ["xyz '1,0 2,0 0'", "three"]),
            (origin('xyz="1_0 0 0"'), ["xyz '1_0 0 0'", "three"]),
            (origin('xyz="${x} 0 0"'), ["${x}", "xacro FILE"]),
            (origin('xyz="$(arg x) 0 0"'), ["$(arg x)", "xacro FILE"]),
            (origin('xyz="&pi; 0 0"'), ["&pi;", "three"]),
            (origin('xyz="0 0 1"', "<origin xyz='0 0 2'/>"), ["two different <origin>"]),
            (origin('xyz="0 0 1"', "<xacro:insert_block name='o'/>"), ["insert_block", "xacro"]),
            (origin('xyz="0 0 1"', "<insert_block name='o'/>"), ["insert_block", "xacro"]),
            (origin('xyz="0 0 1"', "<pose>0 0 1 0 0 0</pose>"), ["<pose>"]),
            (origin('xyz="0 0 1"', "<axis2/>"), ["<axis2>"]),
            (origin('xyz="0 0 1"', "<drake:screw_thread_pitch value='1'/>"), ["screw_thread"]),
            (second(axis='xyz="0 0 1" rpy="0 0 1"'), ["rpy", "<axis>"]),
            (second(axis='xyz="0 0 1" xyz_expressed_in="b"'), ["xyz_expressed_in", "<axis>"]),
            (second("<axis xyz='1 0 0'/>"), ["two different <axis>"]),
            (second("<limit lower='-2' upper='1'/>"), ["two different <limit>"]),
            (second("<mimic joint='j1' multiplier='2'/>"), ["mimics", "'j1'"]),
            (
                second().replace('<axis xyz="0 0 1"/>', "<axis>0 0 1</axis>", 2),
                ["<axis>", "0 0 1"],
            ),
            (
                second().replace('<axis xyz="0 0 1"/>', "<axis><xyz>0 0 1</xyz></axis>", 2),
                ["<axis>", "<xyz>"],
            ),
            (
                urdf(
                    "abc",
                    J1,
                    "<drake:joint name='j2' type='planar'><parent link='b'/><child "
                    "link='c'/></drake:joint>",
                ),
                ["'j2'", "<drake:joint>"],
            ),
            (
                second().replace(
                    "</robot>",
                    "<ros2_control><joint name='j2'><param name='mimic'>j1</param></joint>"
                    "</ros2_control></robot>",
                ),
                ["'j2'", "mimics"],
            ),
            *(
                (second(kind=kind), ["'j2'", kind])
                for kind in (
                    "floating",
                    "planar",
                    "ball",
                    "universal",
                    "screw",
                    "Fixed",
                    "${type}",
                )
            ),
        ],
    )
    def test_is_refused(self, text: str, named: list[str]) -> None:
        refused(text, *named)

    @pytest.mark.parametrize(
        "element",
        [
            "<xacro:arm/>",
            "<xacro:include filename='arm.xacro'/>",
            "<include filename='arm.xacro'/>",
            "<xacro:unless value='0'><joint/></xacro:unless>",
            "<xacro:insert_block name='x'/>",
            f"<x:arm {XACRO.replace('xacro=', 'x=')}/>",
        ],
    )
    def test_what_xacro_could_add_to_the_chain(self, element: str) -> None:
        """It may have another root or the tip, so that a default would be another chain."""
        root = f'name="arm" {XACRO.replace("xacro=", "x=")}'
        for frames in ({}, {"base_frame": "a"}, {"end_effector_frame": "c"}):
            refused(urdf("abc", J1, element, J2, attributes=root), "xacro FILE", **frames)
        frames = {"base_frame": "a", "end_effector_frame": "d"}
        refused(urdf("abc", J1, element, J2, attributes=root), "'d'", "xacro FILE", **frames)

    @pytest.mark.parametrize("names", [("a", "${p}b", "c"), ("a", "b", "$(arg p)c")])
    def test_names_that_xacro_would_make(self, names: tuple[str, ...]) -> None:
        first, middle, last = names
        text = urdf(names, joint("j1", first, middle), joint("j2", middle, last))
        refused(text, "xacro FILE")

    def test_a_joint_that_is_not_understood_does_not_move_the_ends(self) -> None:
        """By default the chain would end before it, or begin after it."""
        for broken in (joint("j3", "c", "x"), joint("j0", "x", "a"), "<joint name='j3'/>"):
            refused(urdf("abc", J1, J2, broken), "joint 'j")

    def test_a_ring_beside_the_chain_holds_its_joints(self) -> None:
        text = urdf("abcd", J1, J2, joint("j3", "c", "d"), joint("j4", "a", "d"))
        refused(text, "ring", base_frame="a", end_effector_frame="c")

    def test_a_name_that_two_joints_have(self) -> None:
        refused(
            urdf("abcd", J1, J2, joint("j2", "a", "d")),
            "two joints",
            "'j2'",
            base_frame="a",
            end_effector_frame="c",
        )

    def test_soft_limits_are_the_limits(self) -> None:
        """Such an arm is a whole robot; a joint whose interval is given has its hard limits."""
        soft = "<safety_controller soft_lower_limit='-0.5' soft_upper_limit='7' k_velocity='1'/>"
        robot = load_robot(second(soft))
        assert (robot.joint_box.lower[1], robot.joint_box.upper[1]) == (-0.5, 1.0)
        assert (robot.joint_limits.lower[1], robot.joint_limits.upper[1]) == (-0.5, 1.0)
        assert robot.has_whole_box
        assert robot_from_definition(robot.definition, "").joint_limits.lower[1] == -0.5
        for low in (-1.0, -0.75):
            boxed = load_robot(second(soft), joint_box={"j2": [low, 1]})
            assert (boxed.joint_box.lower[1], boxed.joint_limits.lower[1]) == (low, -1.0)
        for low, high in (("2", "3"), ("x", "1"), ("nan", "1")):
            wrong = soft.replace("'-0.5'", f"'{low}'").replace("'7'", f"'{high}'")
            refused(second(wrong), "'j2'", "soft")


class TestInfiniteLimits:
    """Named, with what to give; and what is given counts."""

    @pytest.mark.parametrize("kind", ["revolute", "prismatic"])
    @pytest.mark.parametrize(
        "limit", ["", 'lower="-inf" upper="inf"', 'lower="-1e+16" upper="1e16"', 'lower=" "']
    )
    def test_the_joint_box_gives_them(self, kind: str, limit: str) -> None:
        text = second(kind=kind, limit=limit)
        refused(text, "joint 'j2'", kind, "lower limit", "--joint-box j2=LOWER:UPPER")
        robot = load_robot(text, joint_box={"j2": [-0.5, 0.25]})
        for bounds in (robot.joint_limits, robot.joint_box):
            assert (bounds.lower[1], bounds.upper[1]) == (-0.5, 0.25)
        again = load_robot(second(kind=kind, limit='lower="-0.5" upper="0.25"'))
        assert again.definition_hash == robot.definition_hash

    def test_a_limit_that_is_one_stays(self) -> None:
        text = second(limit='lower="-2" upper="inf"')
        limits = load_robot(text, joint_box={"j2": ["-90deg", "90 deg"]}).joint_limits
        assert (limits.lower[1], limits.upper[1]) == (-2.0, math.pi / 2)

    def test_of_a_definition(self, tmp_path: Path) -> None:
        (tmp_path / "arm.urdf").write_text(second(limit=""))
        path = tmp_path / "arm.yaml"
        path.write_text("{kind: arm, urdf_file: arm.urdf, joint_box: {j2: [0, 1]}}")
        assert load_robot(path, end_effector_frame="c").joint_limits.upper[1] == 1.0


class TestUnits:
    """Intervals in degrees and millimetres, where a unit says so."""

    @pytest.mark.parametrize(
        ("given", "expected"),
        [
            (["-45deg", "45 deg"], [-math.pi / 4, math.pi / 4]),
            (["-45\N{DEGREE SIGN}", "0.5rad"], [-math.pi / 4, 0.5]),
            (["-1", " 1.0e0 "], [-1, 1]),
            (["-5e-1 RAD", 0.5], [-0.5, 0.5]),
        ],
    )
    def test_of_angles(self, given: list[object], expected: list[float]) -> None:
        box = load_robot(TWO_JOINTS, joint_box={"j2": given}).joint_box
        assert [box.lower[1], box.upper[1]] == expected

    def test_of_lengths(self) -> None:
        text = second(kind="prismatic")
        box = load_robot(text, joint_box={"j2": ["-150mm", "12 cm"]}).joint_box
        assert [box.lower[1], box.upper[1]] == pytest.approx([-0.15, 0.12], abs=1e-15)
        for wrong in ("90deg", "1rad", "1 km", "mm", "", "1 2", "infm", "1e999m"):
            refused_definition(
                lambda wrong=wrong: load_robot(text, joint_box={"j2": [wrong, 1]}),
                "joint_box of j2",
                repr(wrong),
                "mm",
            )

    def test_the_limits_in_a_refusal_can_be_typed_back(self) -> None:
        limit = 2.0 * math.pi / 3.0
        text = second(limit=f'lower="{-limit!r}" upper="{limit!r}"')
        refused_definition(
            lambda: load_robot(text, joint_box={"j2": [-2.1, 0]}), f"[{-limit!r}, {limit!r}]"
        )


class TestUpAndDownTheTree:
    """The base frame may be anywhere; the chain goes up the tree, down it, or both."""

    TREE = urdf(
        ("world", "a", "b", "c", "d", "e", "f"),
        joint("fix", "world", "a", "fixed", origin='xyz="1 2 3" rpy="0.3 -0.4 0.5"'),
        joint("left", "a", "b", axis='xyz="0 1 0"'),
        joint("slide", "b", "c", "prismatic", axis='xyz="1 2 3"', limit='lower="-1" upper="2"'),
        joint("flange", "c", "d", "fixed"),
        joint("right", "a", "e", axis='xyz="1 0 1"', limit='lower="-3" upper="1"'),
        joint("end", "e", "f", axis='xyz="0 -1 1"'),
    )

    @staticmethod
    def matrix(pose: FloatArray) -> FloatArray:
        transform = np.eye(4)
        transform[:3, :3], transform[:3, 3] = Rotation.from_quat(pose[3:]).as_matrix(), pose[:3]
        return transform

    def from_world(self, tip: str, positions: dict[str, float]) -> FloatArray:
        robot = load_robot(self.TREE, end_effector_frame=tip)
        q = np.array([[positions[name] for name in robot.joint_names]])
        return self.matrix(robot.forward_kinematics.poses(q)[0])

    @pytest.mark.parametrize(
        ("base", "tip", "joints"),
        [
            ("d", "f", ("slide", "left", "right", "end")),
            ("f", "d", ("end", "right", "left", "slide")),
            ("d", "world", ("slide", "left")),
            ("c", "a", ("slide", "left")),
            ("e", "c", ("right", "left", "slide")),
        ],
    )
    def test_is_the_same_motion_seen_from_elsewhere(
        self, base: str, tip: str, joints: tuple[str, ...]
    ) -> None:
        robot = load_robot(self.TREE, base_frame=base, end_effector_frame=tip)
        assert robot.joint_names == joints
        assert (robot.base_frame, robot.end_effector_frame) == (base, tip)
        rng = np.random.default_rng(1)
        for q in robot.joint_limits.sample(5, rng):
            positions = dict(zip(joints, q.tolist(), strict=True))
            ends = [
                np.eye(4)
                if end == "world"
                else self.from_world(end, positions)
                if end != "a"
                else self.fixed_to_world()
                for end in (base, tip)
            ]
            expected = np.linalg.inv(ends[0]) @ ends[1]
            found = self.matrix(robot.forward_kinematics.poses(q[np.newaxis])[0])
            assert np.abs(found - expected).max() < 1e-12

    def fixed_to_world(self) -> FloatArray:
        transform = np.eye(4)
        transform[:3, :3] = Rotation.from_euler("xyz", [0.3, -0.4, 0.5]).as_matrix()
        transform[:3, 3] = 1, 2, 3
        return transform

    def test_keeps_limits_and_types(self) -> None:
        robot = load_robot(self.TREE, base_frame="d", end_effector_frame="f")
        assert robot.joint_types == ("prismatic", "revolute", "revolute", "revolute")
        assert robot.joint_limits.lower.tolist() == [-1, -1, -3, -1]
        assert robot.joint_limits.upper.tolist() == [2, 1, 1, 1]

    def test_written_anew_is_the_chain(self) -> None:
        chain = serial_chain(self.TREE, "test", "d", "f")
        assert serial_chain(chain.urdf, "test") == chain

    def test_names_that_are_taken(self) -> None:
        text = urdf(
            ("a", "j1 reversed", "c"), joint("j1", "a", "j1 reversed"), joint("j2", "a", "c")
        )
        chain = serial_chain(text, "test", "j1 reversed", "c")
        assert chain.joint_names == ("j1", "j2")
        assert load_robot(text, base_frame="j1 reversed", end_effector_frame="c").dof == 2

    def test_the_root_of_the_tip_is_the_default(self) -> None:
        text = urdf("abcxy", J1, J2, joint("j3", "x", "y"))
        assert serial_chain(text, "test", None, "y").base_frame == "x"

    @given(st.floats(-math.pi, math.pi), st.floats(-1.5707963267948966, 1.5707963267948966))
    def test_back_and_forth_is_nothing(self, roll: float, pitch: float) -> None:
        """At a pitch of 90 degrees too."""
        there = joint("j1", "a", "b", origin=f'xyz="1 2 3" rpy="{roll!r} {pitch!r} 0.7"')
        text = urdf("abc", there, J2)
        q = np.array([[0.4, -0.3]])
        down = load_robot(text).forward_kinematics.poses(q)[0]
        up = load_robot(text, base_frame="c", end_effector_frame="a").forward_kinematics.poses(
            q[:, ::-1].copy()
        )[0]
        product = self.matrix(down) @ self.matrix(up)
        assert np.abs(product - np.eye(4)).max() < 1e-12


class TestAttacks:
    """Bounded, whatever it declares."""

    @pytest.mark.parametrize(
        "declaration",
        [
            '<!ENTITY a "1"><!ENTITY b "&a;&a;&a;&a;"><!ENTITY c "&b;&b;&b;&b;">',
            '<!ENTITY % p "x"> %p;',
            '<!ENTITY f SYSTEM "file:///etc/passwd">',
        ],
    )
    def test_entities_are_refused(self, declaration: str) -> None:
        text = f"<!DOCTYPE robot [{declaration}]>{TWO_JOINTS}"
        refused(text.replace('name="arm"', 'name="&c;"'), "entities")

    def test_beginnings_without_an_end(self) -> None:
        for begin in ("<!--", "<![CDATA[", "<?", "<!-- -->", "&", "<a "):
            refused(f"<robot>{begin * 200_000}", "XML")


@pytest.mark.skipif(not CASES.is_dir(), reason="../shared/cases is not beside this checkout")
class TestCases:
    """The recorded cases."""

    @pytest.mark.parametrize(
        "folder", ["urdf_irrelevant_parts", "urdf_encoding", "urdf_file_name"]
    )
    def test_load_as_the_same_arm(self, folder: str) -> None:
        hashes = {load_robot(path).definition_hash for path in (CASES / folder).iterdir()}
        plain = load_robot(CASES / "urdf_file_name" / "arm.URDF")
        assert hashes == {plain.definition_hash}

    def test_a_quaternion(self) -> None:
        turned = load_robot(CASES / "urdf_quat_xyzw" / "quat_origin.urdf")
        q = np.array([[0.1, 0.2, 0.5]])
        plain = load_robot(CASES / "urdf_file_name" / "arm.URDF").forward_kinematics.poses(
            q + np.array([math.pi / 2, 0, 0])
        )
        distance, angle = pose_distance(turned.forward_kinematics.poses(q), plain)
        assert max(distance.item(), angle.item()) < 1e-12

    def test_infinite_limits(self) -> None:
        path = CASES / "infinite_limits" / "inf_lim.urdf"
        refused_definition(lambda: load_robot(path), "'j1'", "--joint-box j1=")
        assert load_robot(path, joint_box={"j1": [-1, 1]}).joint_limits.upper[0] == 1.0


def test_planar_arm_by_its_hand() -> None:
    """From hand to base the arm's position is the mirror of its own."""
    robot = load_robot(planar_arm(), base_frame="hand", end_effector_frame="base")
    pose = robot.forward_kinematics.poses(np.zeros((1, 3)))[0]
    assert pose.tolist() == pytest.approx([-2, 0, 0, 0, 0, 0, 1], abs=1e-15)
