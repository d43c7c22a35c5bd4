"""Everybody as the others see them, against a slow twin."""

import math

import numpy as np
import numpy.typing as npt
import pytest

from are_ros.artefacts.artefact import Artefact, GroundPose, Origin, PoseHistory
from are_ros.artefacts.behaviours.situation import Fellow
from are_ros.artefacts.catalogue import CatalogueRow
from are_ros.artefacts.onlookers import Onlookers
from are_ros.artefacts.shapes import Shape

ROW = CatalogueRow(0, "somebody", "person", (0.3, 0.5, 1.7), (0.0, 0.0, 0.0), Shape.PERSON)


def left_half(me: Fellow, x_m: float, y_m: float) -> bool:
    """See what is to the left, unless one is the third."""
    return me.id != 3 and x_m < 0.0 < abs(y_m) + 1.0


def crowd(
    count: int, seed: int = 1
) -> tuple[Onlookers, dict[int, Artefact], npt.NDArray[np.float64]]:
    """Return so many people anywhere within 20 m, ids 3, 6, 9 ...; x, y, z, yaw, speed."""
    rng = np.random.default_rng(seed)
    numbers: npt.NDArray[np.float64] = rng.uniform(-10.0, 10.0, (count, 5))
    ids = np.arange(3, 3 * count + 3, 3)
    living = {}
    for artefact_id, (x, y, z, yaw, _) in zip(ids.tolist(), numbers.tolist(), strict=True):
        history = PoseHistory(0, GroundPose(x, y, z, yaw))
        living[artefact_id] = Artefact(artefact_id, ROW, Origin.RANDOM, 0, history)
    radii_m = 0.2 + 0.01 * np.arange(count, dtype=np.float64)
    view = Onlookers(living, ids, numbers[:, :4], numbers[:, 4], radii_m, left_half)
    return view, living, numbers


def test_a_fellow_is_what_the_arrays_say() -> None:
    """Pose, velocity along the heading, radius, behaviour and activity, made once."""
    view, living, numbers = crowd(5)
    living[9].behaviour, living[9].activity = "walking", "pausing"
    fellow = view.fellow(9)
    assert fellow is not None
    x, y, _, yaw, speed = numbers[2].tolist()
    assert (fellow.x_m, fellow.y_m, fellow.yaw_rad) == (x, y, yaw)
    assert (fellow.vx_mps, fellow.vy_mps) == pytest.approx(
        (speed * math.cos(yaw), speed * math.sin(yaw))
    )
    assert fellow.radius_m == pytest.approx(0.22)
    assert (fellow.behaviour, fellow.activity) == ("walking", "pausing")
    assert (fellow.class_name, fellow.label) == ("person", "somebody")
    assert view.fellow(9) is fellow
    living[9].activity = "walking on"
    assert fellow.activity == "pausing"


def test_who_does_not_live_is_nobody() -> None:
    """Neither an id that never was, nor one between two, nor one that has gone."""
    view, living, _ = crowd(3)
    assert [view.fellow(i) for i in (0, 4, 99)] == [None] * 3
    del living[6]
    assert view.fellow(6) is None


@pytest.mark.parametrize("radius_m", [0.0, 2.0, 7.0, 50.0])
def test_who_is_near_comes_nearest_first(radius_m: float) -> None:
    """The same as by sorting all."""
    view, _, numbers = crowd(60)
    for x_m, y_m in ((0.0, 0.0), (-9.0, 4.0), (200.0, 0.0)):
        distances = np.hypot(numbers[:, 0] - x_m, numbers[:, 1] - y_m)
        order = [int(i) for i in np.argsort(distances, kind="stable") if distances[i] <= radius_m]
        assert [f.id for f in view.within(x_m, y_m, radius_m)] == [3 * i + 3 for i in order]


def test_others_are_expected_where_their_velocity_takes_them() -> None:
    """All but oneself within the radius now, with their radii; standing ones where they are."""
    view, _, numbers = crowd(40)
    me = view.fellow(30)
    assert me is not None
    points, radii = view.expected(me, 6.0, 2.0)
    expected = {
        3 * i + 3: (x + 2.0 * v * math.cos(yaw), y + 2.0 * v * math.sin(yaw))
        for i, (x, y, _, yaw, v) in enumerate(numbers.tolist())
        if 3 * i + 3 != 30 and math.hypot(x - me.x_m, y - me.y_m) <= 6.0
    }
    assert len(expected) > 5
    found = {
        round((radius - 0.2) / 0.01) * 3 + 3: p for radius, p in zip(radii, points, strict=True)
    }
    assert found.keys() == expected.keys()
    for artefact_id, point in expected.items():
        assert found[artefact_id].tolist() == pytest.approx(point)


def test_alone_nobody_is_expected() -> None:
    """Empty arrays of the right shapes."""
    view, _, _ = crowd(1)
    me = view.fellow(3)
    assert me is not None
    points, radii = view.expected(me, 6.0, 2.0)
    assert (points.shape, radii.shape) == ((0, 2), (0,))


def test_seeing_is_asked_with_who_looks() -> None:
    """The callable gets the fellow and the point."""
    view, _, _ = crowd(2)
    third, sixth = view.fellow(3), view.fellow(6)
    assert third is not None
    assert sixth is not None
    assert view.sees(sixth, -1.0, 2.0)
    assert not view.sees(sixth, 1.0, 2.0)
    assert not view.sees(third, -1.0, 2.0)
