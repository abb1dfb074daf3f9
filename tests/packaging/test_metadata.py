"""What the package says of itself agrees with itself; only the entry points need ROS."""

from importlib import import_module
from importlib.metadata import distribution
from xml.etree import ElementTree

import pytest
import yaml
from support.processes import ROOT

from docs.parameter_tables import PARAMETER_TABLES

PACKAGE_XML = ElementTree.parse(ROOT / "package.xml").getroot()
ANNIK = distribution("annik_ros")
SCRIPTS = [entry for entry in ANNIK.entry_points if entry.group == "console_scripts"]


def test_every_place_of_the_version_has_the_same() -> None:
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert citation["version"] == PACKAGE_XML.findtext("version") == ANNIK.version


def test_changelog_tells_of_the_version() -> None:
    assert ANNIK.version in (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")


def test_package_xml_has_the_elements_that_ros_requires() -> None:
    assert PACKAGE_XML.tag == "package"
    assert PACKAGE_XML.get("format") == "3"
    assert PACKAGE_XML.findtext("name") == ANNIK.name == "annik_ros"
    assert PACKAGE_XML.findtext("license") == "Apache-2.0"
    assert PACKAGE_XML.findtext("export/build_type") == "ament_python"
    maintainer = PACKAGE_XML.find("maintainer")
    assert maintainer is not None
    assert "@" in maintainer.get("email", "")
    assert PACKAGE_XML.findtext("description")


def test_package_xml_names_no_dependency_twice() -> None:
    names = [element.text for element in PACKAGE_XML if element.tag.endswith("depend")]
    assert len(names) == len(set(names))


def test_package_xml_is_as_ros_reads_it() -> None:
    """By the parser of colcon and rosdep, which tells what is unusual too."""
    parser = pytest.importorskip("catkin_pkg.package")
    warnings: list[str] = []
    package = parser.parse_package(ROOT / "package.xml", warnings=warnings)
    package.validate(warnings=warnings)
    assert warnings == []
    assert {url.type for url in package.urls} == {"repository", "bugtracker"}
    assert package.maintainers


def test_there_is_a_script_for_every_node_and_for_the_command_line() -> None:
    assert {script.name for script in SCRIPTS} == {
        "annik",
        "bag_recorder",
        "example_collector",
        "fake_robot",
        "ik_node",
        "target_publisher",
        "viewer",
    }


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda script: script.name)
def test_script_leads_to_a_function(script) -> None:
    assert callable(getattr(import_module(script.module), script.attr))


@pytest.mark.parametrize(
    "package", ["annik_core", "annik_view", "annik_training", "annik_ros", "msg_tools"]
)
def test_import_package_says_that_it_is_typed(package) -> None:
    assert (ROOT / package / "py.typed").is_file()


@pytest.mark.parametrize("node", PARAMETER_TABLES)
def test_configuration_file_gives_every_parameter_its_default(node) -> None:
    text = (ROOT / "config" / f"{node}.yaml").read_text(encoding="utf-8")
    given = yaml.safe_load(text)["/**"]["ros__parameters"]
    rows = {row.name: row for row in PARAMETER_TABLES[node]}
    assert set(given) == set(rows)
    for name, row in rows.items():
        assert row.checked(given[name]) == row.default, name


@pytest.mark.parametrize(
    "path", sorted((ROOT / "launch").glob("*.launch.py")), ids=lambda path: path.name
)
def test_launch_file_compiles(path) -> None:
    compile(path.read_text(encoding="utf-8"), path.name, "exec")
