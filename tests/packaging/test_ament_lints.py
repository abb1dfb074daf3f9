"""The linters that ROS users run, on what is installed; with this project's configuration.

``ament_copyright`` asks for thirteen lines of licence at the head of every file. It does not apply
here: the licence is stated once, in LICENSE and package.xml.
"""

from __future__ import annotations

import shutil
import subprocess

import pytest
from support.processes import PATIENCE, ROOT
from support.source_tree import IMPORT_PACKAGES

PATHS = (*IMPORT_PACKAGES, "examples", "launch", "setup.py")


@pytest.fixture(autouse=True)
def in_the_checkout(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)


def test_flake8(capsys: pytest.CaptureFixture[str]) -> None:
    """``ament_flake8 --config setup.cfg``."""
    ament_flake8 = pytest.importorskip("ament_flake8.main")
    code = ament_flake8.main(argv=["--config", "setup.cfg", *PATHS])
    assert code == 0, capsys.readouterr().out


def test_pep257(capsys: pytest.CaptureFixture[str]) -> None:
    """``ament_pep257 --convention google --add-ignore D105 D107``."""
    ament_pep257 = pytest.importorskip("ament_pep257.main")
    options = ["--convention", "google", "--add-ignore", "D105", "D107", "--"]
    assert ament_pep257.main(argv=[*options, *PATHS]) == 0, capsys.readouterr().err


def test_the_licence_is_the_one_that_package_xml_names() -> None:
    first_lines = (ROOT / "LICENSE").read_text(encoding="utf-8").split(maxsplit=6)
    assert first_lines[:4] == ["Apache", "License", "Version", "2.0,"]


@pytest.mark.process
def test_package_xml_is_valid() -> None:
    """``xmllint --schema``, where it is installed and the schema can be fetched."""
    if shutil.which("xmllint") is None:
        pytest.skip("no xmllint: apt install libxml2-utils")
    schema = "http://download.ros.org/schema/package_format3.xsd"
    result = subprocess.run(
        ["xmllint", "--noout", "--schema", schema, ROOT / "package.xml"],
        capture_output=True,
        text=True,
        timeout=PATIENCE,
        check=False,
    )
    if "failed to load" in result.stderr:
        pytest.skip("the schema can't be fetched")
    assert result.returncode == 0, result.stderr
