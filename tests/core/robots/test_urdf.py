"""The chain of a URDF: found, or refused with the reason and the remedy. ROS-free."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.refused_definition import refused_definition
from support.urdf_texts import DECLARATION, J1, J2, TWO_JOINTS, joint, urdf

from annik_core.robots.errors import InvalidRobotDefinition, UnknownRobot
from annik_core.robots.library import load_robot
from annik_core.robots.urdf import serial_chain
from annik_core.robots.urdf_joint import CONTINUOUS_LIMIT
from annik_core.robots.urdf_text import MAX_LENGTH


def refused(text: str, *named: str, **frames: str) -> None:
    refused_definition(lambda: serial_chain(text, "test", **frames), *named)


class TestText:
    """Whatever way the text comes in, the same chain is read from it."""

    @pytest.mark.parametrize(
        "before",
        [
            DECLARATION,
            '<?xml version="1.0"?>',
            "<?xml version='1.0' encoding='UTF-16'?>",
            '<?xml version="1.0" encoding="ISO-8859-1"?>\n',
            f" \n\t{DECLARATION}",
            f"\ufeff{DECLARATION}",
            f"\ufeff\n{DECLARATION}",
            "<!-- made by <xacro> -->\n",
            "<!DOCTYPE robot>",
            "<?xml-model href='x'?>",
        ],
    )
    def test_what_may_stand_before_the_robot(self, before: str) -> None:
        """A parameter is text already, so an encoding that it declares means nothing."""
        assert serial_chain(before + TWO_JOINTS, "test") == serial_chain(TWO_JOINTS, "test")
        assert load_robot(before + TWO_JOINTS).joint_names == ("j1", "j2")

    @pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig"])
    @pytest.mark.parametrize("name", ["arm.urdf", "arm.xml"])
    def test_a_file_is_read_as_its_text(self, tmp_path: Path, encoding: str, name: str) -> None:
        path = tmp_path / name
        path.write_text(DECLARATION + TWO_JOINTS, encoding=encoding)
        for source in (path, str(path)):
            assert load_robot(source).definition_hash == load_robot(TWO_JOINTS).definition_hash

    def test_a_definition_beside_a_urdf(self, tmp_path: Path) -> None:
        (tmp_path / "arm.urdf").write_text(TWO_JOINTS)
        path = tmp_path / "arm.yaml"
        path.write_text("{kind: arm, name: mine, urdf_file: arm.urdf, joint_box: {j1: [0, 1]}}")
        robot = load_robot(path)
        assert robot.name == "mine"
        assert robot.joint_box.lower.tolist() == [0, -1]
        path.write_text("{kind: arm, urdf_file: other.urdf}")
        assert refused_definition(lambda: load_robot(path), "other.urdf").source == str(path)
        path.write_text("{kind: arm, urdf_file: .}")
        assert refused_definition(lambda: load_robot(path)).source == str(path)
        path.write_text("{kind: arm}")
        refused_definition(lambda: load_robot(path), "'urdf'", "missing")

    @pytest.mark.parametrize(
        "name", ["x" * 5000, "a\0b", "", "../gantry2", "no.urdf", "x.xacro", "y" * 300 + ".urdf"]
    )
    def test_a_name_that_is_no_file_lists_the_robots(self, name: str) -> None:
        with pytest.raises(UnknownRobot) as caught:
            load_robot(name)
        assert caught.value.name == name
        assert "ur5e" in caught.value.known

    def test_namespaces(self) -> None:
        """A default one, as Drake's, is part of every tag; a declared prefix is not."""
        plain = serial_chain(TWO_JOINTS, "test")
        for space in (
            'xmlns="http://drake.mit.edu"',
            'xmlns:xacro="http://www.ros.org/wiki/xacro"',
            'xmlns:g="http://g" version="1.0"',
        ):
            text = urdf("abc", J1, J2, attributes=f'name="arm" {space}')
            assert serial_chain(text, "test") == plain
        foreign = urdf(
            "abc", J1, J2, '<g:joint name="j1"/>', attributes='name="arm" xmlns:g="http://g"'
        )
        assert serial_chain(foreign, "test") == plain

    def test_comments_and_other_elements_are_passed_over(self) -> None:
        more = '<!-- <joint/> --><material name="m"/><gazebo><plugin/></gazebo><transmission/>'
        text = urdf("abc", J1, more, J2)
        assert serial_chain(text, "test") == serial_chain(TWO_JOINTS, "test")

    def test_a_robot_without_a_name(self) -> None:
        assert serial_chain(urdf("abc", J1, J2, attributes=""), "test").name == "robot"
        text = urdf("abc", J1, J2, attributes='name="two&#10;lines"')
        refused_definition(lambda: load_robot(text), "name", repr("two\nlines"), "not a name")

    @pytest.mark.parametrize(
        ("text", "named"),
        [
            ("", ["not XML"]),
            ("<robot", ["not XML"]),
            (TWO_JOINTS[:-3], ["not XML", "line 1, column"]),
            (TWO_JOINTS + "<robot/>", ["not XML"]),
            ('<robot name="\0"/>', ["not XML"]),
            ('<robot name="\ud800"/>', ["not XML"]),
            (urdf("abc", J1, J2, "<xacro:arm/>"), ["<xacro:arm>", "xacro FILE > robot.urdf"]),
            ("<sdf><model/></sdf>", ["not a URDF", "outermost element is <sdf>", "<robot>"]),
            ("<html/>", ["not a URDF", "outermost element is <html>"]),
            ("<robot/>", ["no links"]),
            ('<!DOCTYPE robot [<!ENTITY a "b">]>' + TWO_JOINTS, ["declares entities"]),
            (" " * MAX_LENGTH + "x", [f"{MAX_LENGTH + 1}", f"{MAX_LENGTH}"]),
            ("<robot>" + "<a>" * 100_000 + "</a>" * 100_000 + "</robot>", ["no links"]),
        ],
        ids=range(13),
    )
    def test_what_is_no_urdf(self, text: str, named: list[str]) -> None:
        refused(text, *named)

    @pytest.mark.parametrize("address", ["http://www.ros.org/wiki/xacro", "http://ros.org/xacro"])
    def test_xacro_is_to_be_expanded(self, address: str) -> None:
        text = urdf("abc", J1, "<xacro:arm/>", J2, attributes=f'name="x" xmlns:xacro="{address}"')
        refused(text, "it is xacro", "xacro FILE > robot.urdf")
        refused(
            f'<xacro:macro xmlns:xacro="{address}"/>', "it is xacro", "xacro FILE > robot.urdf"
        )

    @given(st.text(alphabet="<>/robtjinlkame=\"' !?-[]&;{}", max_size=60))
    def test_any_text_is_read_or_refused(self, text: str) -> None:
        with pytest.raises(InvalidRobotDefinition):
            serial_chain(f"<{text}", "test")


class TestNames:
    """Names are those of the file, whatever they are."""

    @pytest.mark.parametrize(
        "names",
        [
            ("a", "b", "c", "b", "c"),
            ("a", "b", "c", "a", "c"),
            ("universe", "b", "c", "j1", "j2"),
            ("a", "b", "universe", "j1", "j2"),
            ("a", "b", "c", "universe", "root_joint"),
            ("a", "b", "ü&amp;&lt;&quot;", "é", "日本"),
            ("a a", "b b", "c c", "j 1", "j 2"),
        ],
    )
    def test_the_kinematics_does_not_depend_on_them(self, names: tuple[str, ...]) -> None:
        """Joints may have the names of links, and both those that Pinocchio gives by itself."""
        a, b, c, j1, j2 = names
        robot = load_robot(urdf((a, b, c), joint(j1, a, b), joint(j2, b, c)))
        plain = load_robot(TWO_JOINTS)
        q = plain.joint_limits.upper[None] * 0.5
        assert (
            robot.forward_kinematics.poses(q).tolist()
            == plain.forward_kinematics.poses(q).tolist()
        )

    @pytest.mark.parametrize(
        ("text", "named"),
        [
            (urdf("abc", J1, joint("j1", "b", "c")), ["two joints", "'j1'"]),
            (urdf("abca", J1, J2), ["two links", "'a'"]),
            (urdf("abc", J1, joint("", "b", "c")), ["joint", "no name"]),
            (urdf("abc", J1, joint("j&#10;2", "b", "c")), ["joint", repr("j\n2")]),
            (urdf(("a", "b", " "), J1, joint("j2", "b", " ")), ["<child>", "joint 'j2'", "link"]),
            (urdf("abc", J1, joint("j2", "b", "")), ["joint 'j2'", "<child>", "no link"]),
            (urdf("abc", J1, joint("j2", "b", "z")), ["joint 'j2'", "link 'z'"]),
            (urdf("abc", J1, joint("j2", "z", "c")), ["joint 'j2'", "link 'z'"]),
            (urdf("abc", J1, '<joint name="j2" type="fixed"/>'), ["joint 'j2'", "<parent>"]),
            (urdf("abc", J1, J2.replace(' type="revolute"', "")), ["joint 'j2'", "no type"]),
        ],
        ids=range(10),
    )
    def test_names_that_are_none(self, text: str, named: list[str]) -> None:
        refused(text, *named)


class TestTree:
    """From the base frame to the end effector there is one way."""

    BRANCHED = urdf("abcd", J1, J2, joint("j3", "b", "d"))

    def test_the_only_root_and_the_only_tip_are_taken(self) -> None:
        chain = serial_chain(TWO_JOINTS, "test")
        assert (chain.base_frame, chain.end_effector_frame) == ("a", "c")
        assert chain.joint_names == ("j1", "j2")
        assert chain.joint_types == ("revolute", "revolute")

    def test_the_order_of_the_file_is_no_matter(self) -> None:
        assert serial_chain(urdf("cab", J2, J1), "test") == serial_chain(TWO_JOINTS, "test")

    def test_several_tips_are_named(self) -> None:
        refused(self.BRANCHED, "end_effector_frame", "c (2 joints), d (2 joints)")

    def test_tips_are_listed_with_their_moving_joints_the_most_first(self) -> None:
        flange = joint("flange", "a", "e", "fixed")
        text = urdf("abcdef", J1, J2, joint("j3", "b", "d", "fixed"), flange)
        refused(text, "c (2 joints), d (1 joint), e (0 joints)")

    def test_a_branch_can_be_chosen(self) -> None:
        chain = serial_chain(self.BRANCHED, "test", end_effector_frame="d")
        assert chain.joint_names == ("j1", "j3")
        assert "j2" not in chain.urdf

    def test_a_tip_below_the_base_is_taken(self) -> None:
        """Tips on other branches do not count."""
        text = urdf("abcd", J1, J2, joint("j3", "a", "d"))
        assert serial_chain(text, "test", base_frame="b").end_effector_frame == "c"

    def test_a_part_can_be_chosen(self) -> None:
        whole = urdf("abcd", J1, J2, joint("j3", "c", "d"))
        part = serial_chain(whole, "test", "b", "c")
        assert part.joint_names == ("j2",)
        assert part == serial_chain(urdf("bc", J2), "test")

    def test_frames_that_are_no_links(self) -> None:
        for frame in ("base_frame", "end_effector_frame"):
            refused(TWO_JOINTS, f"{frame} 'z' is not a link", ": a, b, c", **{frame: "z"})

    def test_many_links_are_not_all_listed(self) -> None:
        links = [f"l{number}" for number in range(50)]
        joints = [joint(f"j{i}", f"l{i}", f"l{i + 1}", "fixed") for i in range(49)]
        refused(urdf(links, *joints), "'z'", ", ".join(links[:12]) + ", ...", base_frame="z")

    def test_frames_that_no_joints_join(self) -> None:
        both = {"base_frame": "b", "end_effector_frame": "b"}
        refused(TWO_JOINTS, "base_frame 'b' is end_effector_frame 'b' too", **both)
        text = urdf("abcz", J1, J2)
        frames = {"base_frame": "z", "end_effector_frame": "c"}
        refused(text, "no joints lead from base_frame 'z'", "'c'", **frames)

    def test_a_base_with_nothing_below(self) -> None:
        refused(TWO_JOINTS, "nothing hangs on base_frame 'c'", base_frame="c")
        refused(urdf("a"), "nothing hangs on base_frame 'a'")

    def test_several_roots(self) -> None:
        text = urdf("abcxyz", J1, J2, joint("j3", "x", "y"))
        refused(text, "base_frame", "a, x")
        for frames in ({"base_frame": "a"}, {"end_effector_frame": "c"}):
            assert serial_chain(text, "test", **frames) == serial_chain(TWO_JOINTS, "test")

    def test_a_root_on_which_nothing_moves_is_no_base(self) -> None:
        text = urdf("abcxyz", J1, J2, joint("j3", "x", "y", "fixed"))
        assert serial_chain(text, "test") == serial_chain(TWO_JOINTS, "test")

    def test_two_parents(self) -> None:
        text = urdf("abc", J1, J2, joint("j3", "a", "c"))
        refused(text, "link 'c' hangs on two joints, 'j2' and 'j3'")

    @pytest.mark.parametrize(
        ("text", "frames", "named"),
        [
            (urdf("ab", J1, joint("j2", "b", "a")), {}, "a ring through a, b:"),
            (urdf("ab", J1, joint("j2", "b", "a")), {"base_frame": "a"}, "a ring through a, b:"),
            (
                urdf("ab", J1, joint("j2", "b", "a")),
                {"base_frame": "a", "end_effector_frame": "b"},
                "a ring through b, a:",
            ),
            (
                urdf("a", joint("j1", "a", "a")),
                {"base_frame": "a", "end_effector_frame": "a"},
                "joint 'j1' forms a ring from link 'a' to itself",
            ),
            (
                urdf("abcd", J1, J2, joint("j3", "b", "d"), joint("j4", "d", "c")),
                {},
                "link 'c' hangs on two joints, 'j2' and 'j4':",
            ),
            (
                urdf("abcde", J1, J2, joint("j3", "c", "d"), joint("j4", "a", "d")),
                {"base_frame": "a", "end_effector_frame": "c"},
                "a ring through c, a",
            ),
        ],
        ids=range(6),
    )
    def test_a_ring(
        self, text: str, frames: dict[str, str], named: str, capfd: pytest.CaptureFixture[str]
    ) -> None:
        """Whatever part is asked for."""
        problem = refused_definition(lambda: load_robot(text, **frames)).problem
        assert named in problem
        assert capfd.readouterr() == ("", "")

    def test_a_large_tree_takes_no_time(self) -> None:
        """Thousands of links, one below the other and one beside the other."""
        count = 5_000
        links = [f"l{number}" for number in range(count + 1)]
        comb = [joint(f"j{i}", "l0", f"l{i + 1}", "fixed") for i in range(count)]
        refused(urdf(links, *comb), "end_effector_frame")
        line = [joint(f"j{i}", f"l{i}", f"l{i + 1}", "fixed") for i in range(count)]
        refused(urdf(links, *line), "5000 joints", "more than 256")

    def test_numbers_off_the_chain_do_not_matter(self) -> None:
        finger = joint("j3", "b", "d", "prismatic", origin='rpy="0 0"', limit='lower="none"')
        chain = serial_chain(urdf("abcd", J1, J2, finger), "test", None, "c")
        assert chain.joint_names == ("j1", "j2")


class TestJoints:
    """What moves, and what is refused because it can't be one of an arm's."""

    @staticmethod
    def second(**changes: str) -> str:
        return urdf("abc", J1, joint("j2", "b", "c", **changes))

    @pytest.mark.parametrize(
        ("limit", "named"),
        [
            ("", ["no lower limit", "<limit"]),
            ('upper="1"', ["no lower limit", "<limit"]),
            ('lower="1"', ["no upper limit", "<limit", "continuous"]),
            ('lower="1" upper="0"', ["lower limit 1.0 above its upper limit 0.0"]),
            ('lower="x" upper="0"', ["lower limit 'x'", "not a number"]),
            ('lower="nan" upper="0"', ["lower limit 'nan'", "not a number"]),
            ('lower="1_0" upper="20"', ["lower limit '1_0'", "not a number"]),
            ('lower="0" upper="inf"', ["upper limit", "inf", "--joint-box j2="]),
            ('lower="-1e308" upper="1"', ["lower limit", "-1e+308", "--joint-box j2="]),
            ('lower="" upper="0"', ["no lower limit", "<limit"]),
            ('lower="${-pi}" upper="0"', ["lower", "'${-pi}'", "xacro FILE"]),
        ],
    )
    @pytest.mark.parametrize("kind", ["revolute", "prismatic"])
    def test_limits_that_are_none(self, kind: str, limit: str, named: list[str]) -> None:
        refused(self.second(kind=kind, limit=limit), "joint 'j2'", *named)

    def test_no_limit_element_at_all(self) -> None:
        text = self.second().replace('<limit lower="-1" upper="1"/>', "")
        refused(text, "joint 'j1'", "revolute", "no lower limit")

    @pytest.mark.parametrize(
        "limit", ["", 'lower="-1" upper="1"', 'lower="-inf" upper="inf"', 'lower="3" upper="0"']
    )
    def test_limits_of_a_continuous_joint_mean_nothing(self, limit: str) -> None:
        chain = serial_chain(self.second(kind="continuous", limit=limit), "test")
        assert (chain.lower[1], chain.upper[1]) == (-CONTINUOUS_LIMIT, CONTINUOUS_LIMIT)
        assert chain.joint_types == ("revolute", "continuous")

    @pytest.mark.parametrize("kind", ["floating", "planar", "spherical", "Revolute"])
    def test_kinds_that_no_arm_has(self, kind: str) -> None:
        refused(self.second(kind=kind), "'j2'", kind, "fixed, continuous, prismatic, revolute")

    @pytest.mark.parametrize(
        "axis",
        ["0 0 0", "-0 0 0", "1e-200 0 0", "1e-160 1e-160 0", "1e300 0 1e300", "1e308 1e308 1e308"],
    )
    def test_an_axis_that_is_no_direction(self, axis: str) -> None:
        """Such as those whose length Pinocchio can't compute."""
        refused(self.second(axis=f'xyz="{axis}"'), "joint 'j2'", "axis", "not a direction")

    @pytest.mark.parametrize("axis", ["nan 0 1", "inf 0 0", "0 1", "0 0 1 0", "", "0,0,1", "z"])
    def test_an_axis_that_is_not_three_numbers(self, axis: str) -> None:
        text = self.second(axis=f'xyz="{axis}"')
        refused(text, "joint 'j2'", f"xyz '{axis}' in its <axis>", "not three numbers")

    @pytest.mark.parametrize("key", ["xyz", "rpy"])
    @pytest.mark.parametrize(
        "value", ["nan 0 0", "0 0 1e300", "-2e6 0 0", "0 inf 0", "0 0", "a b c", "0;0;0"]
    )
    def test_an_origin_that_is_not_three_numbers(self, key: str, value: str) -> None:
        text = self.second(origin=f'{key}="{value}"')
        refused(text, "joint 'j2'", f"{key} '{value}' in its <origin>", "not three numbers")

    @pytest.mark.parametrize("kind", ["revolute", "prismatic"])
    @pytest.mark.parametrize("length", ["2", "1e-30", "1e30"])
    def test_the_length_of_an_axis_means_nothing(self, kind: str, length: str) -> None:
        q = load_robot(TWO_JOINTS).joint_limits.upper[None] * 0.5
        poses = [
            load_robot(self.second(kind=kind, axis=f'xyz="0 {x} 0"'))
            .forward_kinematics.poses(q)[0]
            .tolist()
            for x in ("1", length)
        ]
        assert poses[1] == pytest.approx(poses[0], abs=1e-15)

    def test_what_is_left_out_has_the_value_that_the_standard_gives_it(self) -> None:
        bare = self.second().replace('<axis xyz="0 0 1"/>', "").replace("<origin", "<ignored")
        given = urdf(
            "abc",
            *(
                joint(*names, origin='xyz="0 0 0" rpy="0 0 0"', axis='xyz="1 0 0"')
                for names in (("j1", "a", "b"), ("j2", "b", "c"))
            ),
        )
        assert serial_chain(bare, "test") == serial_chain(given, "test")

    def test_a_mimic_joint_on_the_chain_is_refused(self) -> None:
        text = self.second(more='<mimic joint="j1" multiplier="2"/>')
        refused(text, "joint 'j2'", "mimics joint 'j1'", "end_effector_frame")
        assert serial_chain(text, "test", end_effector_frame="b").joint_names == ("j1",)

    def test_a_mimic_joint_made_fixed_is_no_matter(self) -> None:
        text = self.second(kind="fixed", more='<mimic joint="j1"/>')
        assert serial_chain(text, "test").joint_names == ("j1",)

    @pytest.mark.parametrize(
        "other",
        [
            joint("g", "c", "d", more='<mimic joint="j1"/>'),
            joint("g", "c", "d", "floating"),
            joint("g", "c", "d", "planar", axis='xyz="0 0 0"'),
            joint("g", "c", "d", limit='lower="2" upper="1"'),
            joint("g", "c", "d", limit=""),
        ],
        ids=["mimic", "floating", "planar", "limits", "no limits"],
    )
    def test_joints_off_the_chain_are_no_matter(self, other: str) -> None:
        text = urdf("abcd", J1, J2, other)
        chain = serial_chain(text, "test", end_effector_frame="c")
        assert chain == serial_chain(TWO_JOINTS, "test")

    def test_only_fixed_joints(self) -> None:
        fixed = [joint("j1", "a", "b", "fixed"), joint("j2", "b", "c", "fixed")]
        refused(urdf("abc", *fixed), "nothing moves between base_frame 'a' and", "'c'")

    def test_more_joints_than_any_arm_has(self) -> None:
        joints = [joint(f"j{i}", f"l{i}", f"l{i + 1}") for i in range(33)]
        links = [f"l{number}" for number in range(34)]
        refused_definition(lambda: load_robot(urdf(links, *joints)), "33 joints, more than 32")
        assert load_robot(urdf(links[:-1], *joints[:-1])).dof == 32


numbers = st.floats(-1e3, 1e3)
triples = st.tuples(numbers, numbers, numbers)


@given(triples, triples, st.tuples(numbers, numbers).map(sorted))
def test_the_chain_written_anew_is_the_chain(
    xyz: tuple[float, ...], rpy: tuple[float, ...], bounds: list[float]
) -> None:
    """To the last bit, and so is what is written of that."""
    text = urdf(
        "abc",
        J1,
        joint(
            "j2",
            "b",
            "c",
            origin=f'xyz="{" ".join(map(repr, xyz))}" rpy="{" ".join(map(repr, rpy))}"',
            limit=f'lower="{bounds[0]!r}" upper="{bounds[1]!r}"',
        ),
    )
    chain = serial_chain(text, "test")
    assert (chain.lower[1], chain.upper[1]) == tuple(bounds)
    assert serial_chain(chain.urdf, "test") == chain


def test_a_continuous_joint_is_written_as_one() -> None:
    """Without limits."""
    chain = serial_chain(urdf("abc", J1, joint("j2", "b", "c", "continuous", limit="")), "test")
    assert serial_chain(chain.urdf, "test") == chain
    assert chain.urdf.count("lower=") == 1


def test_only_what_moves_the_end_effector_is_kept() -> None:
    heavy = "<visual><geometry><mesh filename='a.stl'/></geometry></visual><inertial/>"
    text = urdf("abcd", J1, J2, joint("j3", "a", "d"))
    text = text.replace('<link name="b"/>', f'<link name="b">{heavy}</link>')
    chain = serial_chain(text, "test", end_effector_frame="c")
    assert chain == serial_chain(TWO_JOINTS, "test")
    assert "mesh" not in chain.urdf


@pytest.mark.parametrize(
    ("text", "frames"),
    [
        (TWO_JOINTS, {}),
        (urdf("abcd", J1, J2, joint("j3", "b", "d", "floating")), {"end_effector_frame": "c"}),
        (urdf("abc", J1, joint("j2", "b", "c", "continuous", limit="")), {}),
        (urdf("abc", J1, joint("j2", "b", "c", more='<mimic joint="j1"/>')), {}),
        (urdf("abc", J1, joint("j2", "b", "c", axis='xyz="0 0 0"')), {}),
        (urdf("abc", J1, joint("j2", "b", "c", limit="")), {}),
        (urdf("abc", J1, J2), {"base_frame": "z"}),
        ("<robot>", {}),
        ("<robot/>", {}),
    ],
    ids=range(9),
)
def test_nothing_is_printed(
    text: str, frames: dict[str, str], capfd: pytest.CaptureFixture[str]
) -> None:
    """Pinocchio's reader tells the terminal what it does not like."""
    try:
        robot = load_robot(text, **frames)
    except InvalidRobotDefinition:
        pass
    else:
        robot.forward_kinematics.poses(robot.joint_box.centre[None])
    assert capfd.readouterr() == ("", "")
