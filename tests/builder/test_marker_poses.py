"""Poses of markers from those of artefacts."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from are_ros.builder.markers import marker_poses
from are_ros.world.rigid_transform import RigidTransform

ANGLES = st.floats(-4.0, 4.0)
METRES = st.floats(-1e3, 1e3)
TRANSFORMS = st.builds(RigidTransform.planar, METRES, METRES, ANGLES, METRES)


@given(transforms=st.lists(TRANSFORMS, max_size=5), seed=st.integers(0, 99))
def test_all_at_once_is_one_by_one(transforms: list[RigidTransform], seed: int) -> None:
    """Each marker is where its artefact's transform takes its offset, to the bit, and turned so."""
    offsets_m = np.random.default_rng(seed).normal(size=(len(transforms), 3, 3))
    poses = np.array([(*t.translation_m, *t.rotation_xyzw) for t in transforms]).reshape(-1, 7)
    found = marker_poses(poses, offsets_m).reshape(-1, 3, 7)
    assert len(found) == len(transforms)
    for transform, offsets, placed in zip(transforms, offsets_m, found, strict=True):
        np.testing.assert_array_equal(placed[:, :3], transform.apply(offsets))
        np.testing.assert_array_equal(placed[:, 3:], [transform.rotation_xyzw] * 3)
