"""Fixtures of the tests of checks: those of the replay's tests, which write recordings."""

from tests.replay.conftest import replay_sample, run_are, sample_bag, sample_replay

__all__ = ("replay_sample", "run_are", "sample_bag", "sample_replay")
