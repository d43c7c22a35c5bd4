"""Fixtures of the live tests: runs that several modules look at, made once."""

import time
from pathlib import Path
from types import SimpleNamespace

import pytest

from tests.record.live_runs import made_once, replay_of, run_demo
from tests.ros import import_rclpy_quietly, is_ros_available, running_s

PLAYED_S = 15


WITHOUT_IMAGES = ("--set", "sensors.images:=[]", "--set", "sensors.depths:=[]")


@pytest.fixture(scope="session")
def lockstep_run(ros_available: None, tmp_path_factory: pytest.TempPathFactory) -> Path:  # noqa: ARG001
    """Return the results of `are demo --lockstep` on the first seconds of the sample."""
    return made_once(
        tmp_path_factory,
        "demo_in_lockstep",
        lambda folder: run_demo(folder, "--lockstep", "--duration", PLAYED_S),
    )


@pytest.fixture(scope="session")
def free_run(ros_available: None, tmp_path_factory: pytest.TempPathFactory) -> Path:  # noqa: ARG001
    """Return the results of `are demo` on the same seconds, at a rate and with no lockstep.

    Without images: the first one that is painted takes most of a second, which is three of these.
    """
    return made_once(
        tmp_path_factory,
        "demo_at_a_rate",
        lambda folder: run_demo(folder, "--rate", 3, "--duration", PLAYED_S, *WITHOUT_IMAGES),
    )


@pytest.fixture(scope="session")
def replayed(lockstep_run: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the results of a replay of the same seconds with the same parameters."""
    return made_once(
        tmp_path_factory,
        "demo_replayed",
        lambda folder: replay_of(lockstep_run, folder, PLAYED_S),
    )


@pytest.fixture(autouse=True)
def running_clock(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let players and recorders of this process not count stalls of the machine as patience.

    They wait a second or two for subscribers to be found, and for one of two subscriptions to be of
    no use any more; the pace of what is played goes by the clock of the wall all the same.
    """
    if is_ros_available():
        import_rclpy_quietly()
        clock = SimpleNamespace(**{**vars(time), "monotonic": running_s})
        for module in ("inbox", "lockstep", "publishers"):
            monkeypatch.setattr(f"are_ros.record.{module}.time", clock)
