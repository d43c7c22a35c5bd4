"""Setting up: each Python that will not do and each thing that is missing gets one sentence."""

import os
import subprocess
from pathlib import Path

import pytest

PROJECT = Path(__file__).resolve().parents[1]
SENTENCE = "no compiler: the replay works without."


def fake_python(path: Path, platform: str, *, can_build: bool = True) -> Path:
    """Write a program that answers as Python, pip and the scripts do, and return its path."""
    path.parent.mkdir(parents=True, exist_ok=True)
    check = "exit 0" if can_build else f"echo '{SENTENCE}' >&2; exit 3"
    cases = f"-c) echo {platform};; scripts/build_messages.py) [ -z $2 ] || {{ {check}; }};;"
    path.write_text(f"#!/bin/sh\ncase $1 in {cases} esac\n", encoding="ascii")
    path.chmod(0o755)
    return path


def make(*arguments: object) -> "subprocess.CompletedProcess[str]":
    """Run make in the project, and return what came of it."""
    own = {name: value for name, value in os.environ.items() if not name.startswith("MAKE")}
    return subprocess.run(
        ["make", *map(str, arguments)],
        cwd=PROJECT,
        env=own,
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.mark.parametrize(
    "platform",
    [
        *("CPython-3.9-Linux-x86_64-glibc", "CPython-3.14-Linux-x86_64-glibc"),
        *("CPython-3.12-Linux-aarch64-glibc", "CPython-3.12-Darwin-arm64-"),
        *("PyPy-3.11-Linux-x86_64-glibc", "CPython-3.12-Linux-x86_64-"),
    ],
)
@pytest.mark.parametrize("target", ["setup", "demo", "test", "colcon"])
def test_a_python_that_will_not_do_is_named(tmp_path: Path, platform: str, target: str) -> None:
    """With what would do, and before anything is made."""
    python = fake_python(tmp_path / "python", platform)
    done = make(f"PYTHON={python}", f"VENV={tmp_path / 'venv'}", target)
    assert done.returncode != 0
    (sentence,) = done.stderr.splitlines()
    assert "are_ros needs Python 3.10 to 3.13 on Linux x86-64" in sentence
    assert f"{python} is {platform}: make PYTHON=" in sentence
    assert not (tmp_path / "venv").exists()


def test_a_python_that_is_not_there_is_named(tmp_path: Path) -> None:
    """As one that will not do."""
    done = make("PYTHON=python0", f"VENV={tmp_path / 'venv'}", "demo")
    assert "python0 is not there" in done.stderr


def test_setting_up_runs_nothing(tmp_path: Path) -> None:
    """It makes what the demo needs, and the messages that the demo does without."""
    python = fake_python(tmp_path / "python", "CPython-3.12-Linux-x86_64-glibc")
    setup, demo = (
        make(f"PYTHON={python}", f"VENV={tmp_path / 'venv'}", "--dry-run", target).stdout
        for target in ("setup", "demo")
    )
    assert "build_messages.py" in setup
    shared, _, last = setup.rstrip("\n").rpartition("\n")
    assert demo.startswith(shared)
    assert last.endswith("scripts/build_messages.py; fi")
    assert "bin/are " in demo
    assert "bin/are " not in setup


@pytest.mark.parametrize("version", ["3.10", "3.11", "3.12", "3.13"])
def test_each_python_gets_its_own_versions(tmp_path: Path, version: str) -> None:
    """The pins of the Python at hand hold for what is installed and for what builds it."""
    python = fake_python(tmp_path / "python", f"CPython-{version}-Linux-x86_64-glibc")
    done = make(f"PYTHON={python}", f"VENV={tmp_path / 'venv'}", "--dry-run", "test")
    assert done.returncode == 0
    pins = f"constraints/python{version}.txt"
    assert done.stdout.count(f"PIP_CONSTRAINT={pins} PIP_BUILD_CONSTRAINT={pins}") == 4
    assert (PROJECT / pins).is_file()


def test_another_python_makes_the_environment_anew(tmp_path: Path) -> None:
    """And says so; the same one leaves it."""
    (tmp_path / "venv").mkdir()
    (tmp_path / "venv" / "pyvenv.cfg").write_text("version = 3.11.7\n", encoding="ascii")
    for version, is_said in (("3.12", True), ("3.11", False)):
        python = fake_python(tmp_path / "python", f"CPython-{version}-Linux-x86_64-glibc")
        done = make(f"PYTHON={python}", f"VENV={tmp_path / 'venv'}", "--dry-run", "demo")
        said = f"made with Python 3.11: it is made anew with {version}."
        assert (said in done.stdout) == is_said


@pytest.mark.parametrize("can_build", [True, False])
def test_without_a_compiler_the_environment_goes_without_ros(
    tmp_path: Path, *, can_build: bool
) -> None:
    """The sentence is shown and kept for the tests to skip with; with one, ROS is set up."""
    venv, platform = tmp_path / "venv", "CPython-3.11-Linux-x86_64-glibc"
    python = fake_python(venv / "bin" / "python", platform, can_build=can_build)
    done = make(f"PYTHON={python}", f"VENV={venv}", venv / "ready-for-ros")
    assert done.returncode == 0
    assert (venv / "ready-for-ros").exists() == can_build
    assert ("installing rclpy" in done.stdout) == can_build
    assert done.stderr == ("" if can_build else f"{SENTENCE}\n")
    kept = venv / "without-ros"
    assert (kept.read_text(encoding="ascii") if kept.exists() else "") == done.stderr
    again = make("--question", f"PYTHON={python}", f"VENV={venv}", venv / "ready-for-ros")
    assert again.returncode == (0 if can_build else 1)
