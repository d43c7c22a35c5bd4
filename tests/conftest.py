"""Fixtures that several test modules share."""

import os
import resource
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import pytest
from hypothesis import settings

from tests.ros import (
    NOT_SET_UP,
    RosWorld,
    import_rclpy_quietly,
    is_ros_available,
    keep_ros_apart,
)

# Kernels compile inside the first example; the same examples every time, so that CI is stable.
settings.register_profile("are", deadline=None, derandomize=True)
settings.load_profile("are")

keep_ros_apart()


@contextmanager
def full_disk() -> Iterator[None]:
    """Let files that are written in the block have 500 bytes: the system refuses the next one."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (500, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


@pytest.fixture(scope="session")
def real_data() -> Path:
    """Return the folder of real recordings, or skip where it is absent."""
    project = Path(__file__).resolve().parents[1]
    folder = Path(os.environ.get("ARE_REAL_DATA", project.parent / "shared" / "data"))
    if not folder.is_dir():
        pytest.skip("no real recordings: neither ARE_REAL_DATA nor ../shared/data is there")
    return folder


@pytest.fixture(scope="session")
def ros_available() -> None:
    """Skip where rclpy or the messages of ARE are missing; else rclpy can be imported."""
    if not is_ros_available():
        pytest.skip(NOT_SET_UP)
    import_rclpy_quietly()


@pytest.fixture
def ros(ros_available: None) -> Iterator[RosWorld]:  # noqa: ARG001 - it skips where there is none
    """Return a world of nodes, which is destroyed after the test."""
    with closing(RosWorld()) as world:
        yield world
