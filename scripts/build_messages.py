"""Build ARE's messages, and stand-ins for three packages of ROS, into this Python's environment.

Run by make with the environment's own Python, which holds rclpy and the generators of messages (the
extras ros and ros-build). A package that was built from the same files, by the same Python with the
same versions, is left as it is. With --check it only looks for what building takes.

Exit status 0: all are there; 1: a build failed, and the sentence names its log; 3: a compiler or
Python's headers are missing, and nothing was tried.
"""

import argparse
import hashlib
import os
import re
import shlex
import shutil
import subprocess
import sys
import sysconfig
import time
from collections.abc import Iterator, Mapping, Sequence
from importlib.metadata import distributions
from pathlib import Path

PROJECT = Path(__file__).resolve().parents[1]
STAND_INS = ("tf2_msgs", "map_msgs", "vision_msgs")
PACKAGES = {name: f"compat/{name}" for name in STAND_INS} | {"are_msgs": "are_msgs"}
SHARED = "are_msgs/cmake"  # the stand-ins include it
TOOLS = re.compile(r"ros-.*|catkin-pkg|cmake|empy|lark-parser|ninja|numpy|setuptools")
OF_ANOTHER_ROS = ("PYTHONPATH", "PYTHONHOME", "COLCON_PREFIX_PATH", "CMAKE_GENERATOR")
COMPILERS = {"CC": ("C", "cc", "gcc", "clang"), "CXX": ("C++", "c++", "g++", "clang++")}
FAILED, INCOMPLETE = 1, 3


def main() -> int:
    """Do what the command line says, and return the exit status."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("packages", nargs="*", metavar="PACKAGE", help=", ".join(PACKAGES))
    parser.add_argument("--check", action="store_true", help="only look for compilers and headers")
    arguments = parser.parse_args()
    missing = list(missing_tools(os.environ))
    if missing:
        print(sentence(missing), file=sys.stderr)
        return INCOMPLETE
    if arguments.check:
        return 0
    return build_all(arguments.packages or list(PACKAGES))


def missing_tools(environment: Mapping[str, str]) -> Iterator[str]:
    """Yield what building takes and this machine lacks."""
    path = environment.get("PATH")
    for variable, (language, *usual) in COMPILERS.items():
        names = shlex.split(environment.get(variable, ""))[:1] or usual
        if not any(shutil.which(name, path=path) for name in names):
            yield f"a {language} compiler ({names[0]})"
    if not Path(sysconfig.get_path("include"), "Python.h").is_file():
        yield f"the headers of Python {version()} (Python.h)"


def sentence(missing: Sequence[str]) -> str:
    """Say what is missing, what for, how to get it, and what works without."""
    listed = " and ".join([", ".join(missing[:-1]), missing[-1]] if missing[1:] else missing)
    return (
        f"The ROS messages of the live node are built with {listed}, which this machine lacks (on "
        f"Debian or Ubuntu: sudo apt install build-essential python{version()}-dev); the replay "
        "works without."
    )


def version() -> str:
    """Return this Python's version as 3.11."""
    return "{}.{}".format(*sys.version_info)


def build_all(packages: Sequence[str]) -> int:
    """Build the packages that are not up to date, in order; return the exit status."""
    for package in packages:
        stamp = Path(sys.prefix, "share", package, "built_from.sha256")
        digest = digest_of(package)
        if stamp.is_file() and stamp.read_text(encoding="ascii") == digest:
            continue
        stamp.unlink(missing_ok=True)
        if not build(package):
            return FAILED
        stamp.write_text(digest, encoding="ascii")
    return 0


def digest_of(package: str) -> str:
    """Return a hash of everything that a package is built from, this Python included."""
    digest = hashlib.sha256(f"{sys.version} {sys.prefix}".encode())
    for line in sorted(versions()):
        digest.update(line.encode())
    for folder in (PACKAGES[package], SHARED):
        root = PROJECT / "msg_defs" / folder
        for path in sorted(path for path in root.rglob("*") if path.is_file()):
            digest.update(f"\0{path.relative_to(root)}\0".encode() + path.read_bytes())
    return digest.hexdigest()


def versions() -> Iterator[str]:
    """Yield name and version of all that takes part in building messages."""
    for distribution in distributions():
        if TOOLS.fullmatch(distribution.name):
            yield f"{distribution.name}=={distribution.version}\n"


def build(package: str) -> bool:
    """Build and install one package; False, with a sentence, if that fails."""
    folder = PROJECT / "build" / "messages" / f"python{version()}" / package
    log = folder.with_suffix(".log")
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    print(f"building {package}", end=" ... ", flush=True)
    started = time.monotonic()
    if not succeed(commands(package, folder), log):
        print("failed", flush=True)
        print(f"{package} could not be built: {os.path.relpath(log)} says why.", file=sys.stderr)
        return False
    print(f"{time.monotonic() - started:.0f} s")
    return True


def commands(package: str, folder: Path) -> Sequence[Sequence[str]]:
    """Return the commands that configure, build and install a package into this environment."""
    source = PROJECT / "msg_defs" / PACKAGES[package]
    options = {
        "CMAKE_BUILD_TYPE": "Release",
        "CMAKE_INSTALL_PREFIX": sys.prefix,
        "Python3_EXECUTABLE": sys.executable,
        "BUILD_TESTING": "OFF",
    }
    defined = [f"-D{name}={value}" for name, value in options.items()]
    return (
        ["cmake", "-S", str(source), "-B", str(folder), "-G", "Ninja", *defined],
        ["ninja", "-C", str(folder), "install"],
    )


def succeed(steps: Sequence[Sequence[str]], log: Path) -> bool:
    """Run commands until one fails, their output in the log; tell whether none did."""
    environment = build_environment(os.environ)
    with log.open("w", encoding="utf-8") as file:
        for step in steps:
            file.write(f"$ {shlex.join(step)}\n")
            file.flush()
            tool = shutil.which(step[0], path=environment["PATH"])
            if tool is None:
                file.write(f"{step[0]} is not there: the extra ros-build brings it along\n")
                return False
            command = [tool, *step[1:]]
            done = subprocess.run(command, env=environment, stdout=file, stderr=file, check=False)
            if done.returncode:
                return False
    return True


def build_environment(environment: Mapping[str, str]) -> dict[str, str]:
    """Return the variables of a build that sees this environment and no other ROS."""
    own = {name: value for name, value in environment.items() if name not in OF_ANOTHER_ROS}
    own["PATH"] = os.pathsep.join([sysconfig.get_path("scripts"), environment.get("PATH", "")])
    return own | {"AMENT_PREFIX_PATH": sys.prefix, "CMAKE_PREFIX_PATH": sys.prefix}


if __name__ == "__main__":
    sys.exit(main())
