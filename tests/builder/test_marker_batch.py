"""Markers as values."""

import numpy as np
import pytest

from are_ros.builder.markers import (
    DELETE_ALL,
    NO_MARKERS,
    MarkerAction,
    MarkerBatch,
    MarkerKind,
    MarkerLook,
)

LOOK = MarkerLook("body", MarkerKind.CUBE)


def test_numbers_are_those_of_visualization_msgs() -> None:
    """Kinds and actions carry the message's constants."""
    assert [kind.value for kind in MarkerKind] == [0, 1, 9, 11]
    assert [action.value for action in MarkerAction] == [0, 2, 3]


def test_a_batch_is_true_when_there_are_markers() -> None:
    """It has a length, and poses that cannot be changed."""
    assert not NO_MARKERS
    assert len(MarkerBatch.unposed([LOOK, LOOK], [1, 2])) == 2
    assert [look.action for look in DELETE_ALL.looks] == [MarkerAction.DELETEALL]
    with pytest.raises(ValueError, match="read-only"):
        DELETE_ALL.poses[0, 0] = 1.0


def test_batches_follow_each_other() -> None:
    """Looks and poses stay together; nothing before or after changes nothing."""
    batch = MarkerBatch((LOOK,), np.array([1]), np.arange(7.0)[None])
    both = DELETE_ALL.followed_by(batch)
    assert both.looks == (*DELETE_ALL.looks, LOOK)
    np.testing.assert_array_equal(both.poses, [[0, 0, 0, 0, 0, 0, 1], [0, 1, 2, 3, 4, 5, 6]])
    assert both.ids.tolist() == [0, 1]
    assert NO_MARKERS.followed_by(batch).looks == (LOOK,)
    assert batch.followed_by(NO_MARKERS).looks == (LOOK,)
