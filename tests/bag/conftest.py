"""Fixtures of the tests of recordings: those of the replay's, which write bags."""

from tests.replay.conftest import (
    as_ros1,
    factory,
    replay_sample,
    ros1_factory,
    run_are,
    sample_bag,
    sample_records,
    write_bag,
)

__all__ = (
    "as_ros1",
    "factory",
    "replay_sample",
    "ros1_factory",
    "run_are",
    "sample_bag",
    "sample_records",
    "write_bag",
)
