"""The frame tree against answers of tf2's BufferCore, made by `make_tf2_answers.py`."""

import gzip
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from are_ros.errors import (
    DisconnectedFramesError,
    ExtrapolationToFutureError,
    ExtrapolationToPastError,
    FrameError,
    UnknownFrameError,
)
from are_ros.world.transforms.tree import STATIC, FrameTree

ANSWERS = json.loads(
    gzip.decompress((Path(__file__).parent / "data" / "tf2_answers.json.gz").read_bytes())
)
KINDS: dict[str, tuple[type[FrameError], ...]] = {
    "unknown": (UnknownFrameError,),
    "disconnected": (DisconnectedFramesError,),
    "past": (ExtrapolationToPastError,),
    "future": (ExtrapolationToFutureError,),
    "time": (ExtrapolationToPastError, ExtrapolationToFutureError),
}
TOLERANCE = 1e-7
"""tf2 takes the angle from an arc cosine, which is good to 1e-8 where rotations nearly agree."""


def fed(answers: dict[str, Any]) -> FrameTree:
    """Return a tree with the transforms of one oracle tree, in their order of arrival."""
    tree = FrameTree(ANSWERS["history_ns"])
    for sample in answers["transforms"]:
        pose = sample["translation"], sample["rotation"]
        if sample["static"]:
            tree.set_static(sample["parent"], sample["child"], *pose)
        else:
            tree.set_transform(sample["parent"], sample["child"], sample["stamp"], *pose)
    return tree


def gap(found: np.ndarray[Any, np.dtype[np.float64]], expected: list[float]) -> float:
    """Return the largest difference of two poses; a quaternion and its negative are the same."""
    wanted = np.array(expected)
    if found[3:] @ wanted[3:] < 0:
        wanted[3:] *= -1
    return float(np.abs(found - wanted).max())


@pytest.mark.parametrize("answers", ANSWERS["trees"])
def test_lookups_are_those_of_tf2(answers: dict[str, Any]) -> None:
    """Each query gives tf2's pose, or an error of tf2's kind."""
    tree = fed(answers)
    for query in answers["queries"]:
        asked = query["target"], query["source"]
        if "error" in query:
            with pytest.raises(KINDS[query["error"]]):
                tree.lookup(*asked, query["stamp"])
            continue
        found = tree.lookup(*asked, query["stamp"])
        pose = np.concatenate((found.translation_m, found.rotation_xyzw))
        assert gap(pose, query["pose"]) < TOLERANCE


@pytest.mark.parametrize("answers", ANSWERS["trees"])
def test_latest_common_times_are_those_of_tf2(answers: dict[str, Any]) -> None:
    """The latest common time is tf2's (0 stands for a static chain there), where it can be used.

    tf2 looks at newest samples only: where frames changed parents its time may be one at which its
    own lookup fails; ours is then earlier, and its lookup succeeds.
    """
    tree = fed(answers)
    for query in answers["latest"]:
        asked = query["target"], query["source"]
        if "error" in query:
            with pytest.raises(KINDS[query["error"]]):
                tree.latest_common_time(*asked)
            continue
        expected = query["stamp"] or STATIC
        try:
            ours = tree.latest_common_time(*asked)
        except FrameError:
            with pytest.raises(FrameError):
                tree.lookup(*asked, expected)
            continue
        tree.lookup(*asked, ours)
        if ours != expected:
            assert ours < expected
            with pytest.raises(FrameError):
                tree.lookup(*asked, expected)
