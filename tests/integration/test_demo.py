"""The demo as its user runs it: every process real, every file there, every figure good enough."""

from __future__ import annotations

import json
import os
import signal
import sys
import time
from pathlib import Path

import pytest
from rich.console import Console
from rosbags.rosbag2 import Reader
from support.processes import LONG_PATIENCE, ROOT, Process, run_python, wait_until
from support.robot_recording import RobotRecording

from annik_core.errors import AnnikError, InvalidValue

PICTURES = ("errors.png", "path.png", "histogram.png", "latency.png")


def processes_mentioning(text: str) -> list[str]:
    """Command lines of running processes that hold a text."""
    found = []
    for entry in Path("/proc").iterdir():
        try:
            line = (entry / "cmdline").read_bytes().replace(b"\0", b" ").decode()
        except (OSError, UnicodeDecodeError):
            continue
        if text in line and entry.name != str(os.getpid()):
            found.append(line)
    return found


@pytest.mark.slow
def test_demo(tmp_path: Path) -> None:
    folder = tmp_path / "demo"
    begun = time.monotonic()
    result = run_python("-m", "examples.demo", "--out", folder, patience=LONG_PATIENCE)
    duration = time.monotonic() - begun
    assert result.returncode == 0, result.stdout + result.stderr
    assert processes_mentioning(str(folder)) == []

    results = json.loads((folder / "results.json").read_text(encoding="utf-8"))
    assert (
        results["targets_sent"] == results["targets_answered"] == results["targets_paired"] == 141
    )
    assert results["targets_refused"] == 0
    assert results["position_error_mm"]["max"] < 0.25
    assert results["orientation_error_deg"]["max"] < 0.1
    assert 0 < results["latency_us"]["p50"] <= results["latency_us"]["p99"]
    assert results["training"]["examples"] == 179
    # Two seconds on an idle machine.
    assert 0 < results["training"]["seconds"] < min(duration, 150.0)

    for name in ("model.onnx", "report.html", "bag/metadata.yaml", *PICTURES):
        assert (folder / name).stat().st_size > 0
    with Reader(folder / "bag") as bag:
        counts = {connection.topic: connection.msgcount for connection in bag.connections}
    assert counts["/target_pose"] == counts["/joint_command"] == 141
    assert counts["/tracking_error/position"] == counts["/tracking_error/orientation"] == 141


@pytest.mark.parametrize(
    ("signal_number", "code"), [(signal.SIGTERM, 128 + 15), (signal.SIGINT, 128 + 2)]
)
def test_an_interrupted_demo_leaves_no_process(
    tmp_path: Path, signal_number: int, code: int
) -> None:
    folder = tmp_path / "demo"
    command = (sys.executable, "-m", "examples.demo", "--out", str(folder))
    process = Process(*command, log=tmp_path / "demo.log")
    try:
        wait_until(
            lambda: not process.is_running or len(processes_mentioning(str(folder))) == 2,
            "the training of the demo",
        )
        process.signal(signal_number)
        assert process.wait_for_exit() == code
    finally:
        process.kill()
    assert "Traceback" not in process.log
    assert processes_mentioning(str(folder)) == []


@pytest.mark.slow
def test_the_demo_of_an_arm(tmp_path: Path) -> None:
    folder = tmp_path / "demo"
    arguments = ("-m", "examples.demo", "--model", "ur5e", "--out", folder)
    result = run_python(*arguments, patience=LONG_PATIENCE)
    assert result.returncode == 0, result.stdout + result.stderr
    results = json.loads((folder / "results.json").read_text(encoding="utf-8"))
    assert results["targets_sent"] == results["targets_paired"] == 141
    assert results["targets_refused"] == 0
    assert results["position_error_mm"]["max"] < 1e-3
    assert "training" not in results


def test_a_model_that_is_missing_ends_the_demo_before_it_touches_anything(tmp_path: Path) -> None:
    folder = tmp_path / "demo"
    result = run_python("-m", "examples.demo", "--model", "no.onnx", "--out", folder)
    assert result.returncode == 1
    assert "no.onnx" in result.stderr and "Traceback" not in result.stderr
    assert not folder.exists()


def test_a_model_in_the_folder_of_the_demo_is_not_deleted(tmp_path: Path) -> None:
    (tmp_path / ".annik_demo").touch()
    model = tmp_path / "model.onnx"
    model.write_bytes((ROOT / "models" / "gantry.onnx").read_bytes())
    result = run_python("-m", "examples.demo", "--model", model, "--out", tmp_path)
    assert result.returncode == 1
    assert "--model" in result.stderr and model.exists()


def test_a_demo_with_refused_targets_fails(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The report is there, and the error says why."""
    from examples import demo

    recording = RobotRecording(count=9, refused=range(9))
    recording.add_diagnostics({"outside workspace": 9})
    monkeypatch.setattr(
        demo, "drive", lambda started, name, bag, *others: recording.write(bag) and None
    )
    with pytest.raises(AnnikError, match=r"0 of 141 targets .* outside workspace"):
        demo.run_demo(tmp_path / "demo", "gantry", Console())
    assert "outside workspace" in capsys.readouterr().out
    assert (tmp_path / "demo" / "report.html").is_file()


def test_a_folder_with_other_files_is_not_emptied(tmp_path: Path) -> None:
    photo = tmp_path / "photo.jpg"
    photo.write_text("dear")
    result = run_python("-m", "examples.demo", "--out", tmp_path)
    assert result.returncode == 1
    assert "--out" in result.stderr and "folder of a demo" in result.stderr
    assert photo.read_text() == "dear"


def test_a_folder_that_another_demo_uses_is_found_before_training(tmp_path: Path) -> None:
    """Nothing of the other is touched; after it the folder is free."""
    from examples import demo
    from examples.demonstration import emptied

    folder = tmp_path / "demo"
    for _ in range(2):
        with emptied(folder) as logs:
            (logs / "train.log").touch()
            with pytest.raises(InvalidValue, match="running") as refused:
                demo.run_demo(folder, None, Console())
            assert (refused.value.name, refused.value.value) == ("--out", str(folder))
            assert [path.name for path in logs.iterdir()] == ["train.log"]


def test_two_demos_at_once_have_different_domains(tmp_path: Path) -> None:
    """Also while others of the same process number modulo 101 are at work."""
    from examples.demonstration import processes

    show = ["-c", "import os; print(os.environ['ROS_DOMAIN_ID'])"]
    with processes(tmp_path) as first, processes(tmp_path) as second:
        for name, started in (("first", first), ("second", second)):
            started.start(name, show).wait(60.0)
    domains = [int((tmp_path / f"{name}.log").read_text()) for name in ("first", "second")]
    assert len(set(domains)) == 2 and all(0 < domain <= 101 for domain in domains)
