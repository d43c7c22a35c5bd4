"""Fixtures of the tests of `are fit`: those of the replay's tests, which write recordings."""

from tests.replay.conftest import (
    factory,
    replay_sample,
    run_are,
    sample_bag,
    sample_replay,
    write_bag,
)

__all__ = ("factory", "replay_sample", "run_are", "sample_bag", "sample_replay", "write_bag")
