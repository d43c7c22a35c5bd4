"""Fixtures of the tests of `are export`: those of the replay's tests."""

from tests.replay.conftest import (
    factory,
    replay_sample,
    run_are,
    sample_bag,
    sample_records,
    sample_replay,
    write_bag,
)

__all__ = (
    "factory",
    "replay_sample",
    "run_are",
    "sample_bag",
    "sample_records",
    "sample_replay",
    "write_bag",
)
