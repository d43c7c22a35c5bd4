"""Fixtures of the tests of `are export`: those of the replay's tests."""

from tests.replay.conftest import replay_sample, run_are, sample_bag, sample_replay

__all__ = ("replay_sample", "run_are", "sample_bag", "sample_replay")
