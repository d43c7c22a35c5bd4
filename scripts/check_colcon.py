"""Build both packages with colcon as README.md says, copied and linked, and test what was built.

Works in build/colcon, on a copy of the files that git knows or would add, in an environment that
holds what a robot has and no more: ROS, the package's own dependencies, colcon and pytest. For each
way of installing it runs README.md's line, `colcon test`, and scripts/check_installed.py on the
result. Exit status 0 if all is well, 1 at the first that is not, with a sentence.
"""

import hashlib
import os
import re
import shlex
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

PROJECT = Path(__file__).resolve().parents[1]
SCRATCH = PROJECT / "build" / "colcon"
SOURCE, VENV, KERNELS = SCRATCH / "src", SCRATCH / "venv", SCRATCH / "numba"
PYTHON = VENV / "bin" / "python"
STAND_INS = ("tf2_msgs", "map_msgs", "vision_msgs")
OF_ANOTHER_ROS = (
    *("AMENT_PREFIX_PATH", "CMAKE_PREFIX_PATH", "COLCON_PREFIX_PATH", "PYTHONPATH"),
    *("LD_LIBRARY_PATH", "_ROS_WHEELS_BOOTSTRAP_COMPLETE", "RMW_IMPLEMENTATION"),
)
FAILING_TEST = '"""No test."""\n\n\ndef test_that_fails():\n    assert False\n'
FAILED = 1


class CheckError(Exception):
    """Something is not as it should be; the message says what."""


def main() -> int:
    """Check both ways of installing, and return the exit status."""
    try:
        copy_sources()
        share_kernels()
        set_up_environment()
        for option in ("", "--symlink-install"):
            check_build(option)
        check_that_a_failure_counts()
    except CheckError as cause:
        print(cause, file=sys.stderr)
        return FAILED
    return 0


def copy_sources() -> None:
    """Copy what git knows, as it is now, and what it would add."""
    shutil.rmtree(SOURCE, ignore_errors=True)
    listed = ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
    try:
        done = subprocess.run(listed, cwd=PROJECT, capture_output=True, text=True, check=True)
    except (OSError, subprocess.CalledProcessError) as cause:
        raise CheckError(f"git has to say which files are the project's: {cause}") from cause
    files = done.stdout
    for name in filter(None, files.split("\0")):
        if (PROJECT / name).is_file():
            (SOURCE / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(PROJECT / name, SOURCE / name)


def share_kernels() -> None:
    """Begin with the kernels that are compiled beside the project's sources.

    All ways of installing have the same sources, so what one compiles serves the others.
    """
    shutil.rmtree(KERNELS, ignore_errors=True)
    for kernel in (PROJECT / "are_ros").rglob("__pycache__/*.nb?"):
        folder = KERNELS / kernel.parents[1].relative_to(PROJECT)
        folder.mkdir(parents=True, exist_ok=True)
        shutil.copy2(kernel, folder)


def set_up_environment() -> None:
    """Make the environment, unless it is there with the same packages; build the stand-ins."""
    constraints = SOURCE / "constraints" / "python{}.{}.txt".format(*sys.version_info)
    wanted = hashlib.sha256((SOURCE / "pyproject.toml").read_bytes() + constraints.read_bytes())
    stamp = VENV / "ready"
    if not stamp.is_file() or stamp.read_text(encoding="ascii") != wanted.hexdigest():
        run([sys.executable, "-m", "venv", "--clear", str(VENV)], "environment")
        pip = [str(PYTHON), "-m", "pip", "--quiet", "--disable-pip-version-check"]
        pins = {"PIP_CONSTRAINT": str(constraints), "PIP_BUILD_CONSTRAINT": str(constraints)}
        run([*pip, "install", f"{SOURCE}[ros,ros-build,colcon]"], "packages", **pins)
        run([*pip, "uninstall", "--yes", "are_ros"], "packages without are_ros")
        stamp.write_text(wanted.hexdigest(), encoding="ascii")
    run([str(PYTHON), "scripts/build_messages.py", *STAND_INS], "stand-ins")
    shutil.rmtree(SOURCE / "build", ignore_errors=True)


def check_build(option: str) -> None:
    """Build with README.md's line and an option, run colcon's tests, and look at what is there."""
    for name in ("build", "install", "log"):
        shutil.rmtree(SOURCE / name, ignore_errors=True)
    kind = option.removeprefix("--") or "copied"
    run(["bash", "-c", f"{line_of_the_readme()} {option}"], f"colcon build, {kind}")
    run_overlaid("python -m colcon test", f"colcon test, {kind}")
    summary = run_overlaid("python -m colcon test-result --verbose", f"colcon test-result, {kind}")
    counts = re.search(r"Summary: (\d+) tests.* (\d+) skipped", summary)
    if counts is None or int(counts[1]) == 0 or int(counts[2]) > 0:
        raise CheckError(f"colcon test ran nothing, or skipped some: {summary.strip()}")
    run_overlaid("python scripts/check_installed.py", f"what was installed, {kind}")


def check_that_a_failure_counts() -> None:
    """See `colcon test` fail where a test fails."""
    (SOURCE / "tests" / "smoke" / "test_that_fails.py").write_text(FAILING_TEST, encoding="ascii")
    try:
        run_overlaid("python -m colcon test", "colcon test, with a test that fails")
    except CheckError:
        return
    raise CheckError("colcon test passes where a test fails")


def line_of_the_readme() -> str:
    """Return the line of README.md that builds with colcon."""
    text = (SOURCE / "README.md").read_text(encoding="utf-8")
    lines = re.findall(r"^(?:\w+=\S+ )*python -m colcon build\b.*$", text, flags=re.MULTILINE)
    if len(lines) != 1:
        raise CheckError(f"README.md has {len(lines)} lines that build with colcon, not one")
    line: str = lines[0].partition("#")[0].strip()
    return line


def run_overlaid(line: str, name: str) -> str:
    """Run a line of bash with what colcon installed on top of the environment."""
    return run(["bash", "-c", f". install/setup.bash && {line}"], name)


def run(command: Sequence[str], name: str, **variables: str) -> str:
    """Run a command in the copy, and return its output; CheckError with its end if it fails."""
    started = time.monotonic()
    print(f"{name} ...", end=" ", flush=True)
    SCRATCH.mkdir(parents=True, exist_ok=True)
    done = subprocess.run(
        list(command),
        cwd=SOURCE,
        env=dict(environment()) | variables,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        check=False,
    )
    print(f"{time.monotonic() - started:.0f} s", flush=True)
    if done.returncode:
        end = "".join(done.stdout.splitlines(keepends=True)[-40:])
        raise CheckError(f"{end}\n{name} failed: {shlex.join(command)}")
    return done.stdout


def environment() -> Iterator[tuple[str, str]]:
    """Yield the variables under which the environment is the only ROS there is, on this machine."""
    yield from ((name, value) for name, value in os.environ.items() if name not in OF_ANOTHER_ROS)
    yield "PATH", os.pathsep.join([str(PYTHON.parent), os.environ.get("PATH", os.defpath)])
    yield "AMENT_PREFIX_PATH", str(VENV)
    yield "CMAKE_PREFIX_PATH", str(VENV)
    yield "COLCON_DEFAULTS_FILE", "colcon_defaults.yaml"
    yield "NUMBA_CACHE_DIR", str(KERNELS)


if __name__ == "__main__":
    sys.exit(main())
