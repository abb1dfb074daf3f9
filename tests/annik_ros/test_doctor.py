"""What ``annik doctor`` finds. Without ROS, except where it is there."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest
from support.processes import run_python

from annik_core.installation import default_model_path
from annik_core.kernel import StaleKernel
from annik_ros import doctor
from annik_ros.doctor import Finding, Verdict


def test_this_installation_is_well(capsys: pytest.CaptureFixture[str]) -> None:
    """Every line says what it is about, and nothing is wrong."""
    findings = [
        finding
        for check in (doctor.check_python, doctor.check_libraries, doctor.check_models)
        for finding in check()
    ]
    assert not [finding for finding in findings if finding.verdict is Verdict.BAD]
    assert any("onnxruntime" in finding.what for finding in findings)
    assert any("model gantry: 6 joints" in finding.what for finding in findings)


def test_a_ros_that_is_not_there_is_named_with_its_remedy(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """One finding, no traceback."""
    monkeypatch.setitem(sys.modules, "rclpy", None)
    (finding,) = doctor.check_ros()
    assert finding.verdict is Verdict.BAD
    assert "source /opt/ros/jazzy/setup.bash" in finding.remedy


def test_another_distribution_is_noted(monkeypatch: pytest.MonkeyPatch) -> None:
    """It may work."""
    pytest.importorskip("rclpy")
    monkeypatch.setenv("ROS_DISTRO", "humble")
    assert any("humble" in finding.what for finding in doctor.check_ros())


def test_a_missing_library_is_wrong(monkeypatch: pytest.MonkeyPatch) -> None:
    """With the command that installs it."""
    monkeypatch.setattr(doctor, "_LIBRARIES", ("no-such-library",))
    finding = next(iter(doctor.check_libraries()))
    assert (finding.verdict, finding.remedy) == (Verdict.BAD, "pip install no-such-library")


@pytest.mark.parametrize(
    ("kernel", "verdict"),
    [(object(), Verdict.GOOD), (None, Verdict.NOTE)],
    ids=["built", "missing"],
)
def test_a_missing_kernel_is_noted(
    monkeypatch: pytest.MonkeyPatch, kernel: object, verdict: Verdict
) -> None:
    """Annik works without it; the remedy is a compiler."""
    monkeypatch.setattr(doctor, "compiled_kernel", lambda: kernel)
    (finding,) = doctor.check_kernel()
    assert finding.verdict is verdict
    assert ("g++" in finding.remedy) == (kernel is None)


def test_a_kernel_of_other_sources_is_wrong(monkeypatch: pytest.MonkeyPatch) -> None:
    """With the command that compiles it again."""

    def stale() -> None:
        raise StaleKernel(Path("compiled.so"), "0" * 64, "1" * 64)

    monkeypatch.setattr(doctor, "compiled_kernel", stale)
    (finding,) = doctor.check_kernel()
    assert finding.verdict is Verdict.BAD
    assert "./run setup" in finding.remedy


def test_a_spoiled_model_is_wrong(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """By name, with what is wrong with the file."""
    path = tmp_path / "gantry.onnx"
    path.write_bytes(default_model_path().read_bytes()[:500])
    monkeypatch.setattr(doctor, "model_path", lambda _: path)
    findings = list(doctor.check_models())
    assert all(finding.verdict is Verdict.BAD for finding in findings)
    assert "model gantry can't be used" in findings[0].what


@pytest.mark.parametrize(
    ("verdict", "code"), [(Verdict.GOOD, 0), (Verdict.NOTE, 0), (Verdict.BAD, 1)]
)
def test_the_exit_code_says_whether_something_is_wrong(
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    verdict: Verdict,
    code: int,
) -> None:
    """A note is not."""
    finding = Finding(verdict, "the moon", "look up")
    monkeypatch.setattr(doctor, "CHECKS", (lambda: iter([finding]),))
    assert doctor.main() == code
    assert "the moon" in capsys.readouterr().out


@pytest.mark.ros
@pytest.mark.process
def test_a_target_makes_its_round_trip() -> None:
    """To an ik_node that the doctor starts, and ends."""
    pytest.importorskip("rclpy")
    result = run_python("-m", "annik_ros.doctor")
    assert result.returncode == 0, result.stdout + result.stderr
    assert "first command of ik_node" in result.stdout
