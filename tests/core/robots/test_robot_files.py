"""Robots from files: of any name and encoding, by their content; and what is no file to read."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from support.refused_definition import refused_definition
from support.urdf_texts import TWO_JOINTS, joint, urdf

from annik_core.robots.errors import UnknownRobot
from annik_core.robots.library import load_robot, packaged_robots
from annik_core.robots.urdf_text import MAX_LENGTH, decoded

DEFINITION = "{kind: arm, urdf_file: arm.urdf}"
UMLAUTS = urdf(("a", "b", "Flansch_ä"), joint("Gelenk_ü", "a", "b"), joint("j2", "b", "Flansch_ä"))


class TestEncodings:
    """By the byte-order mark, else by the XML declaration, else UTF-8."""

    @pytest.mark.parametrize(
        "encoding",
        [
            "utf-8",
            "ISO-8859-1",
            "iso-8859-15",
            "windows-1252",
            "cp1252",
            "Latin-1",
            "UTF-16",
            "utf-16-le",
            "utf-16-be",
            "utf-32",
            "mac-roman",
        ],
    )
    @pytest.mark.parametrize("quote", ["'", '"'])
    def test_as_declared(self, tmp_path: Path, encoding: str, quote: str) -> None:
        text = f"<?xml version='1.0' encoding={quote}{encoding}{quote}?>\n<!-- ° -->{UMLAUTS}"
        path = tmp_path / "arm.urdf"
        path.write_bytes(text.encode(encoding))
        robot = load_robot(path)
        assert robot.joint_names == ("Gelenk_ü", "j2")
        assert robot.end_effector_frame == "Flansch_ä"

    @pytest.mark.parametrize(
        "encoding", ["utf-8-sig", "utf-16", "utf-32", "utf-16-le", "utf-16-be"]
    )
    @pytest.mark.parametrize("declared", ["", "<?xml version='1.0' encoding='ISO-8859-1'?>"])
    def test_a_mark_or_zeros_count_before_the_declaration(
        self, tmp_path: Path, encoding: str, declared: str
    ) -> None:
        path = tmp_path / "arm.urdf"
        path.write_bytes((declared + UMLAUTS).encode(encoding))
        assert load_robot(path).joint_names == ("Gelenk_ü", "j2")

    @pytest.mark.parametrize(
        "declared", ["UTF-16", "UTF-32", "nonsense", "rot13", "punycode", "hex"]
    )
    def test_a_declaration_that_can_not_be_true(self, tmp_path: Path, declared: str) -> None:
        path = tmp_path / "arm.urdf"
        path.write_text(f"<?xml version='1.0' encoding='{declared}'?>{UMLAUTS}", encoding="utf-8")
        assert load_robot(path).joint_names == ("Gelenk_ü", "j2")

    def test_bytes_of_another_encoding_matter_on_the_chain_only(self, tmp_path: Path) -> None:
        path = tmp_path / "arm.urdf"
        path.write_bytes(
            f"<!-- 90° --><material name='grün'/>{TWO_JOINTS}".encode("latin-1").replace(
                b"<material name='gr\xfcn'/>", b""
            )
        )
        assert load_robot(path).definition_hash == load_robot(TWO_JOINTS).definition_hash
        path.write_bytes(UMLAUTS.encode("latin-1"))
        refused_definition(lambda: load_robot(path), "Gelenk_", "UTF-8")

    def test_of_any_bytes_there_is_a_text(self) -> None:
        for content in (b"", b"\0", b"\0\0\0", b"\xff\xfe", b"\xff\xfe<", bytes(range(256))):
            assert isinstance(decoded(content), str)

    def test_of_a_definition(self, tmp_path: Path) -> None:
        (tmp_path / "arm.urdf").write_bytes(UMLAUTS.encode("utf-16"))
        for encoding in ("utf-8", "utf-8-sig", "utf-16"):
            (tmp_path / "arm.yaml").write_bytes(DEFINITION.encode(encoding))
            assert load_robot(tmp_path / "arm.yaml").joint_names == ("Gelenk_ü", "j2")


class TestNames:
    """A file that is there is read, whatever its name is."""

    @pytest.mark.parametrize(
        "name",
        [
            "arm",
            "arm.URDF",
            "arm.Xml",
            "arm.urdf.xacro",
            "arm.txt",
            "robot_description",
            "a.b.c",
            "arm.yaml",
            "arm 1",
            "-arm",
            "ur5",
            ".arm",
        ],
    )
    def test_of_a_urdf(self, tmp_path: Path, name: str, monkeypatch: pytest.MonkeyPatch) -> None:
        (tmp_path / name).write_text(f"\n {TWO_JOINTS}")
        monkeypatch.chdir(tmp_path)
        for source in (tmp_path / name, str(tmp_path / name), name, Path(name), f"./{name}"):
            assert load_robot(source).definition_hash == load_robot(TWO_JOINTS).definition_hash

    @pytest.mark.parametrize("name", ["arm", "arm.YAML", "arm.txt", "arm.yml"])
    def test_of_a_definition(self, tmp_path: Path, name: str) -> None:
        (tmp_path / "arm.urdf").write_text(TWO_JOINTS)
        (tmp_path / name).write_text(DEFINITION)
        assert load_robot(tmp_path / name).joint_names == ("j1", "j2")

    def test_of_the_home_folder(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setenv("HOME", str(tmp_path))
        (tmp_path / "arm").write_text(TWO_JOINTS)
        (tmp_path / "arm.yaml").write_text("{kind: arm, urdf_file: ~/arm}")
        for source in ("~/arm", Path("~/arm"), "~/arm.yaml"):
            assert load_robot(source).joint_names == ("j1", "j2")
        with pytest.raises(UnknownRobot):
            load_robot("~nobody_of_this_name/arm")

    def test_a_packaged_name_is_the_packaged_robot(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        packaged = load_robot("scara").definition_hash
        (tmp_path / "scara").write_text(TWO_JOINTS)
        monkeypatch.chdir(tmp_path)
        assert load_robot("scara").definition_hash == packaged
        assert load_robot("./scara").joint_names == ("j1", "j2")

    @pytest.mark.parametrize(
        ("name", "nearest"), [("ur5", "ur5e"), ("UR5E", "ur5e"), ("pandas", "panda")]
    )
    def test_the_nearest_packaged_name_is_listed_first(self, name: str, nearest: str) -> None:
        with pytest.raises(UnknownRobot) as caught:
            load_robot(name)
        assert caught.value.known[0] == nearest
        assert sorted(caught.value.known) == sorted(packaged_robots())


class TestNoFileToRead:
    """Folders, pipes and devices are named as what they are, at once."""

    def test_a_folder(self, tmp_path: Path) -> None:
        refused_definition(lambda: load_robot(tmp_path), str(tmp_path), "directory")
        refused_definition(lambda: load_robot("."), "directory")

    def test_a_pipe(self, tmp_path: Path) -> None:
        os.mkfifo(tmp_path / "arm.urdf")
        (tmp_path / "link").symlink_to(tmp_path / "arm.urdf")
        (tmp_path / "arm.yaml").write_text(DEFINITION)
        for name in ("arm.urdf", "link", "arm.yaml"):
            refused_definition(lambda name=name: load_robot(tmp_path / name), "pipe")

    def test_a_device(self, tmp_path: Path) -> None:
        (tmp_path / "arm.urdf").symlink_to("/dev/zero")
        refused_definition(lambda: load_robot(tmp_path / "arm.urdf"), "device")

    def test_a_link_to_a_file_is_the_file(self, tmp_path: Path) -> None:
        (tmp_path / "arm").write_text(TWO_JOINTS)
        (tmp_path / "link").symlink_to("arm")
        assert load_robot(tmp_path / "link").joint_names == ("j1", "j2")

    def test_a_file_that_may_not_be_read(self, tmp_path: Path) -> None:
        path = tmp_path / "arm.urdf"
        path.write_text(TWO_JOINTS)
        path.chmod(0)
        if os.access(path, os.R_OK):
            pytest.skip("this user may read everything")
        refused_definition(lambda: load_robot(path), "Permission denied")

    def test_a_file_that_is_too_large(self, tmp_path: Path) -> None:
        path = tmp_path / "arm.urdf"
        with path.open("wb") as file:
            file.truncate(MAX_LENGTH + 1)
        refused_definition(lambda: load_robot(path), str(MAX_LENGTH))

    @pytest.mark.parametrize(
        "content", [b"", b"\0\1\2", b"solid mesh", b"1", b"[1, 2]", b"\x89PNG"]
    )
    @pytest.mark.parametrize("name", ["arm.urdf", "arm.yaml", "arm"])
    def test_a_file_of_something_else(self, tmp_path: Path, name: str, content: bytes) -> None:
        (tmp_path / name).write_bytes(content)
        refused_definition(lambda: load_robot(tmp_path / name))
