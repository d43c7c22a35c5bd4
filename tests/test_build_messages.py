"""The script that builds the messages: what it misses, what it builds anew, what it says."""

import os
import subprocess
import sys
import sysconfig
from collections.abc import Callable
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from typing import Any

import pytest

PROJECT = Path(__file__).resolve().parents[1]
SCRIPT = PROJECT / "scripts" / "build_messages.py"
PACKAGES = ["tf2_msgs", "map_msgs", "vision_msgs", "are_msgs"]


def load(path: Path) -> Any:
    """Return a script as a module."""
    specification = spec_from_file_location(path.stem, path)
    assert specification is not None
    assert specification.loader is not None
    module = module_from_spec(specification)
    specification.loader.exec_module(module)
    return module


def make_executable(path: Path, text: str = "#!/bin/sh\n") -> None:
    """Write a program."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")
    path.chmod(0o755)


@pytest.fixture
def script(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    """Return the script, on a project and an environment of its own that are nearly empty."""
    module = load(SCRIPT)
    for folder in (*module.PACKAGES.values(), module.SHARED):
        (tmp_path / "msg_defs" / folder).mkdir(parents=True)
        (tmp_path / "msg_defs" / folder / "some.txt").write_text(folder, encoding="ascii")
    places = {"include": tmp_path / "include", "scripts": tmp_path / "bin"}
    monkeypatch.setattr(module, "PROJECT", tmp_path)
    monkeypatch.setattr(sys, "prefix", str(tmp_path / "prefix"))
    monkeypatch.setattr(sysconfig, "get_path", lambda name: str(places[name]))
    monkeypatch.chdir(tmp_path)
    return module


@pytest.fixture
def built(script: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Return the names of the packages that the script builds, as it goes; all builds succeed."""
    names: list[str] = []

    def build(package: str) -> bool:
        names.append(package)
        (tmp_path / "prefix" / "share" / package).mkdir(parents=True, exist_ok=True)
        return True

    monkeypatch.setattr(script, "build", build)
    return names


@pytest.mark.parametrize("arguments", [[], ["--check"], ["are_msgs"]])
def test_without_a_compiler_one_sentence_says_all(tmp_path: Path, arguments: list[str]) -> None:
    """What is missing, what for, how to install it, and what works without; status 3."""
    kept = {name: value for name, value in os.environ.items() if name not in ("CC", "CXX")}
    done = subprocess.run(
        [sys.executable, SCRIPT, *arguments],
        env=kept | {"PATH": str(tmp_path)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 3
    assert done.stdout == ""
    (sentence,) = done.stderr.splitlines()
    named = ("a C compiler (cc)", "a C++ compiler (c++)", "messages of the live node")
    assert all(part in sentence for part in named)
    assert "sudo apt install build-essential python3." in sentence
    assert sentence.endswith("the replay works without.")


def test_compilers_are_sought_as_cmake_does(script: Any, tmp_path: Path) -> None:
    """By their usual names, or as CC and CXX say, whose first word is the program."""
    make_executable(tmp_path / "include" / "Python.h")
    path = {"PATH": str(tmp_path / "bin")}
    assert list(script.missing_tools(path)) == ["a C compiler (cc)", "a C++ compiler (c++)"]
    make_executable(tmp_path / "bin" / "gcc")
    assert list(script.missing_tools(path)) == ["a C++ compiler (c++)"]
    make_executable(tmp_path / "bin" / "mine")
    assert not list(script.missing_tools(path | {"CXX": "mine -O1"}))
    named = script.missing_tools(path | {"CC": "theirs", "CXX": "mine"})
    assert list(named) == ["a C compiler (theirs)"]


def test_headers_of_python_are_sought_too(script: Any, tmp_path: Path) -> None:
    """A Python of Debian has them in a package of their own."""
    for name in ("cc", "c++"):
        make_executable(tmp_path / "bin" / name)
    (missing,) = script.missing_tools({"PATH": str(tmp_path / "bin")})
    assert missing == f"the headers of Python {script.version()} (Python.h)"
    assert f"built with {missing}, which this machine lacks" in script.sentence([missing])
    assert "built with a, b and c, which" in script.sentence(["a", "b", "c"])


def test_a_second_time_nothing_is_built(script: Any, built: list[str]) -> None:
    """The stamps beside what was installed say that it is there."""
    assert script.build_all(PACKAGES) == 0
    assert script.build_all(PACKAGES) == 0
    assert built == PACKAGES


@pytest.mark.parametrize(
    ("changed", "again"),
    [
        ("msg_defs/compat/map_msgs/some.txt", ["map_msgs"]),
        ("msg_defs/are_msgs/new.msg", ["are_msgs"]),
        ("msg_defs/are_msgs/cmake/some.txt", PACKAGES),
        ("prefix/share/tf2_msgs/built_from.sha256", ["tf2_msgs"]),
    ],
)
def test_what_changed_is_built_anew(
    script: Any, built: list[str], tmp_path: Path, changed: str, again: list[str]
) -> None:
    """A definition, a new file, what all share, or a stamp."""
    script.build_all(PACKAGES)
    built.clear()
    (tmp_path / changed).write_text("something else", encoding="ascii")
    script.build_all(PACKAGES)
    assert built == again


def test_other_versions_build_all_anew(
    script: Any, built: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of what takes part in building, or of Python."""
    script.build_all(PACKAGES)
    monkeypatch.setattr(script, "versions", lambda: iter(["ros-rclpy==99\n"]))
    script.build_all(PACKAGES)
    monkeypatch.setattr(sys, "version", "3.99")
    script.build_all(PACKAGES)
    assert built == 3 * PACKAGES


def test_versions_are_those_of_the_tools(script: Any) -> None:
    """The headers of numpy take part; pytest does not."""
    names = {line.partition("==")[0] for line in script.versions()}
    assert "numpy" in names
    assert "pytest" not in names


@pytest.fixture
def fake_tools(tmp_path: Path) -> Callable[[str, int], None]:
    """Return a function that puts a program of a name and exit status into the environment."""

    def make(name: str, status: int) -> None:
        text = f'#!/bin/sh\necho "{name}: $@ in $CMAKE_PREFIX_PATH"\nexit {status}\n'
        make_executable(tmp_path / "bin" / name, text)

    return make


def test_a_build_says_one_line_and_keeps_a_log(
    script: Any,
    tmp_path: Path,
    fake_tools: Callable[[str, int], None],
    capsys: pytest.CaptureFixture[str],
) -> None:
    """The tools are those of the environment, and find it."""
    fake_tools("cmake", 0)
    fake_tools("ninja", 0)
    assert script.build("are_msgs")
    said = capsys.readouterr()
    assert (said.out, said.err) == ("building are_msgs ... 0 s\n", "")
    (log,) = tmp_path.glob("build/messages/python3.*/are_msgs.log")
    text = log.read_text(encoding="utf-8")
    assert f"-DCMAKE_INSTALL_PREFIX={tmp_path / 'prefix'}" in text
    assert f"install in {tmp_path / 'prefix'}" in text


@pytest.mark.parametrize("tools", [{"cmake": 1}, {"cmake": 0, "ninja": 2}, {"cmake": 0}])
def test_a_build_that_fails_names_its_log(
    script: Any,
    tmp_path: Path,
    fake_tools: Callable[[str, int], None],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    tools: dict[str, int],
) -> None:
    """One sentence, status 1, no stamp, and nothing after it is tried; so if a tool is absent."""
    monkeypatch.setenv("PATH", "/bin")
    for name, status in tools.items():
        fake_tools(name, status)
    assert script.build_all(PACKAGES) == 1
    said = capsys.readouterr()
    log = Path("build", "messages", f"python{script.version()}", "tf2_msgs.log")
    assert said.err == f"tf2_msgs could not be built: {log} says why.\n"
    assert "map_msgs" not in said.out
    assert "cmake: " in log.read_text(encoding="utf-8")
    assert not list(tmp_path.rglob("*.sha256"))


def test_another_ros_is_not_seen(script: Any) -> None:
    """What was sourced before stays outside; the environment's own tools come first."""
    sourced = {"PYTHONPATH": "/opt/ros", "AMENT_PREFIX_PATH": "/opt/ros", "PATH": "/usr/bin"}
    variables = script.build_environment(sourced)
    assert "PYTHONPATH" not in variables
    assert variables["AMENT_PREFIX_PATH"] == variables["CMAKE_PREFIX_PATH"] == sys.prefix
    assert variables["PATH"].split(os.pathsep)[1:] == ["/usr/bin"]
