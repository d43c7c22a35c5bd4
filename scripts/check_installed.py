"""Test what `ros2 run` and `ros2 launch` find after colcon's install/setup.bash was sourced.

Run as `python scripts/check_installed.py`, on a robot as in CI: both packages are in the index, the
files that are named on command lines are there once, the launch file can be loaded, and ar_builder
starts, gets active and ends with status 0 on SIGINT (in a ROS domain of its own, on this machine
only, so that nothing on a robot notices). Exit status 0, or 1 with a sentence.
"""

import importlib.util
import os
import py_compile
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType

PACKAGES = ("are_msgs", "are_ros")
EXECUTABLES = ("ar_builder", "ar_guard", "are")
SHARED = ("ar_builder.launch.py", "are.yaml", "nav2_are.yaml", "are.rviz")
START_S, END_S = 300.0, 15.0
APART = {"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST", "ROS_DOMAIN_ID": str(30 + os.getpid() % 11)}
FAILED = 1


class CheckError(Exception):
    """Something is not as it should be; the message says what."""


def main() -> int:
    """Check everything, and return the exit status."""
    os.environ.update(APART)
    try:
        prefixes = {name: prefix_of(name) for name in PACKAGES}
        check_executables(prefixes["are_ros"] / "lib" / "are_ros")
        files = {name: only(prefixes["are_ros"] / "share" / "are_ros", name) for name in SHARED}
        check_launch_file(files["ar_builder.launch.py"])
        check_ros2(files["ar_builder.launch.py"])
        check_node(prefixes["are_ros"] / "lib" / "are_ros" / "ar_builder", files["are.yaml"])
    except CheckError as cause:
        print(cause, file=sys.stderr)
        return FAILED
    print("installed as ros2 run and ros2 launch want it")
    return 0


def prefix_of(package: str) -> Path:
    """Return where the ament index has a package; CheckError unless it can be imported there."""
    try:
        from ament_index_python.packages import get_package_prefix

        prefix = Path(get_package_prefix(package))
    except (ImportError, OSError) as cause:
        raise CheckError("no ROS is sourced: . install/setup.bash, then again") from cause
    except LookupError as cause:
        raise CheckError(f"the ament index does not have {package}") from cause
    if find_spec(package) is None:
        raise CheckError(f"{package} cannot be imported")
    return prefix


def check_executables(folder: Path) -> None:
    """Find the executables where ros2 run looks for them."""
    for name in EXECUTABLES:
        if not os.access(folder / name, os.X_OK):
            raise CheckError(f"{folder} has no executable {name}")


def only(folder: Path, name: str) -> Path:
    """Return the one file of a name below a folder: ros2 launch refuses two."""
    found = sorted(path for path in folder.rglob(name) if "msg_defs" not in path.parts)
    if len(found) != 1:
        raise CheckError(f"{name} is {len(found)} times below {folder}")
    return found[0]


def check_launch_file(path: Path) -> None:
    """Compile the launch file, and load it where ROS's launch is."""
    with tempfile.TemporaryDirectory() as folder:
        try:
            py_compile.compile(str(path), cfile=str(Path(folder, "compiled")), doraise=True)
        except py_compile.PyCompileError as cause:
            raise CheckError(f"the launch file is no Python: {cause}") from cause
    if find_spec("launch_ros") is not None:
        loaded(path).generate_launch_description()


def loaded(path: Path) -> ModuleType:
    """Return the module that a file is."""
    specification = importlib.util.spec_from_file_location("ar_builder_launch", path)
    if specification is None or specification.loader is None:
        raise CheckError(f"{path} cannot be imported")
    module = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(module)
    return module


def check_ros2(launch_file: Path) -> None:
    """Ask ros2 itself, where it is there."""
    if shutil.which("ros2") is None:
        return
    found = output_of(["ros2", "pkg", "executables", "are_ros"])
    if "are_ros ar_builder" not in found.splitlines():
        raise CheckError(f"ros2 pkg executables does not list ar_builder, but: {found}")
    arguments = output_of(["ros2", "launch", "are_ros", launch_file.name, "--show-args"])
    if "params_file" not in arguments:
        raise CheckError(f"ros2 launch does not show the arguments, but: {arguments}")


def output_of(command: Sequence[str]) -> str:
    """Return what a command prints; CheckError if it fails."""
    done = subprocess.run(list(command), capture_output=True, text=True, check=False)
    if done.returncode:
        raise CheckError(f"{' '.join(command)} failed: {done.stderr}")
    return done.stdout


def check_node(executable: Path, parameters: Path) -> None:
    """Start the node as ros2 run does, wait until it is active, and end it."""
    command = [str(executable), "--ros-args", "--params-file", str(parameters)]
    with tempfile.TemporaryFile("w+") as log:
        process = subprocess.Popen(
            [*command, "-p", "autostart:=true"], stdout=log, stderr=subprocess.STDOUT
        )
        try:
            reached = is_active(process)
            process.send_signal(signal.SIGINT)
            status = process.wait(timeout=END_S)
        except subprocess.TimeoutExpired as cause:
            raise CheckError(f"ar_builder does not end within {END_S:.0f} s of SIGINT") from cause
        finally:
            process.kill()
            log.seek(0)
            said = log.read()
    if not reached or status:
        raise CheckError(f"{said}\nar_builder ended with status {status}, active before: {reached}")


def is_active(process: "subprocess.Popen[bytes]") -> bool:
    """Wait until the node /ar_builder says that it is active; False if it ends before that."""
    import rclpy
    from lifecycle_msgs.msg import State
    from lifecycle_msgs.srv import GetState

    rclpy.init(args=[])
    node = rclpy.create_node("check_installed")
    client = node.create_client(GetState, "/ar_builder/get_state")
    deadline_s = time.monotonic() + START_S
    try:
        while process.poll() is None and time.monotonic() < deadline_s:
            if not client.wait_for_service(timeout_sec=0.5):
                continue
            future = client.call_async(GetState.Request())
            rclpy.spin_until_future_complete(node, future, timeout_sec=2.0)
            response = future.result() if future.done() else None
            if response and response.current_state.id == State.PRIMARY_STATE_ACTIVE:
                return True
        return False
    finally:
        node.destroy_node()
        rclpy.shutdown()


if __name__ == "__main__":
    sys.exit(main())
