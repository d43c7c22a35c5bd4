"""The judge of depth images: what it accepts, and what it finds wrong."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, NamedTuple

import cv2
import numpy as np
import numpy.typing as npt
import pytest

from are_ros.checks.oracle.frames import Pose
from are_ros.checks.oracle.solids import Walls
from are_ros.checks.sensors import scan_pairs
from are_ros.checks.sensors.depth_images import (
    DepthFrame,
    Difference,
    box_triangles,
    changed_pixels,
    compared,
    info_topic,
    nearest_depths,
    rays_of,
)
from are_ros.checks.sensors.scan_pairs import Kept, Pairs, ScanPairs
from are_ros.world.cameras import CameraInfo

HERE = Pose(np.eye(3), np.zeros(3))
BOX = box_triangles() * (0.4, 0.3, 0.2) + (0.1, 0.0, 3.0)
"""Its front, at 2.8 m, is met by the pixels from 9 to 20 and from 8 to 15 (10 pixels per unit)."""


def info(model: str = "plumb_bob", d: tuple[float, ...] = ()) -> Any:
    """Return a CameraInfo of 32 x 24 pixels."""
    return SimpleNamespace(
        width=32, height=24, distortion_model=model, d=np.array(d), binning_x=0, binning_y=0,
        k=np.array([40.0, 0, 15.5, 0, 40.0, 11.5, 0, 0, 1]), r=np.eye(3).ravel(), p=np.zeros(12),
        roi=SimpleNamespace(x_offset=0, y_offset=0, width=0, height=0),
    )  # fmt: skip


def frame(depths_m: npt.NDArray[np.float64]) -> DepthFrame:
    """Return millimetres."""
    return DepthFrame(5, 7, "camera", np.rint(1e3 * depths_m).astype(np.uint16), (), 0)


def scene() -> tuple[DepthFrame, DepthFrame]:
    """Return depths of 4 m with a hole and something near, and what has to come out."""
    before = np.full((24, 32), 4.0)
    before[10:14, 15], before[10:14, 18] = 0.0, 1.0
    after = before.copy()
    hits = nearest_depths(rays_of(info(), rectified=False), HERE, [BOX])
    is_hit = (hits < before) | ((before == 0.0) & np.isfinite(hits))
    after[is_hit] = hits[is_hit]
    return frame(before), frame(after)


def judged(real: DepthFrame, output: DepthFrame, walls: Walls | None = None) -> Difference:
    """Return how an output differs from what the box makes of its input."""
    free = Walls(np.zeros(3), 0.0, np.ones(3), np.empty((0, 3), np.int64))
    rays = rays_of(info(), rectified=False)
    return compared(real, output, rays, HERE, [BOX], 10.0, walls or free)


def test_the_front_of_a_box_has_one_depth() -> None:
    """Depth is no distance: it is the same all over a plane across the axis."""
    hits = nearest_depths(rays_of(info(), rectified=False), HERE, [BOX])
    front = hits[np.isfinite(hits)]
    assert 60 < len(front) < 120
    assert np.median(front) == pytest.approx(2.8)


def test_what_follows_from_the_input_passes() -> None:
    """All pixels are looked at, none differs; without walls known, holes are left out."""
    real, output = scene()
    assert judged(real, output) == Difference(24 * 32, 0, 0, 0)
    rays = rays_of(info(), rectified=False)
    assert compared(real, output, rays, HERE, [BOX], 10.0, None).tested == 24 * 32 - 4


@pytest.mark.parametrize(
    ("change_mm", "difference"), [(1, (1, 0, 0)), (-1, (1, 0, 0)), (300, (0, 0, 1))]
)
def test_a_pixel_that_is_off_is_found(change_mm: int, difference: tuple[int, int, int]) -> None:
    """By a step, or by more: then it is told where."""
    real, output = scene()
    numbers = output.numbers.copy()
    numbers[12, 16] = numbers[12, 16] + np.int16(change_mm)
    found = judged(real, replace(output, numbers=numbers))
    assert found[1:4] == difference
    assert found.place == ((12, 16) if difference[2] else (-1, -1))


def test_what_did_not_become_an_artefact_is_found() -> None:
    """An output that is the input as it came: all of the box is missing."""
    real, output = scene()
    assert judged(real, real)[2:4] == (0, int((real.numbers != output.numbers).sum()))


@pytest.mark.parametrize(
    ("front_m", "beside_m", "difference"),
    [
        (2.8, 2e-6, (1, 0)),
        (2.8, 5e-5, (1, 0)),
        (2.8, 1e-4, (0, 1)),
        (0.2, 9e-6, (1, 0)),
        (0.2, 3e-5, (0, 1)),
    ],
)
def test_what_a_ray_close_beside_meets_is_at_an_edge(
    front_m: float, beside_m: float, difference: tuple[int, int]
) -> None:
    """The box begins a little beside the ray of a pixel, or plainly beside it."""
    ray = rays_of(info(), rectified=False)[12, 12]
    at_m = ray[0] * front_m + beside_m
    box = box_triangles() * (0.4, 0.3, 0.2) + (at_m + 0.4, 0.0, front_m + 0.2)
    real = frame(np.full((24, 32), 4.0))
    numbers = real.numbers.copy()
    is_hit = np.isfinite(nearest_depths(rays_of(info(), rectified=False), HERE, [box]))
    numbers[is_hit] = 1000 * front_m
    assert not is_hit[12, 12]
    numbers[12, 12] = 1000 * front_m
    output = replace(real, numbers=numbers)
    found = compared(real, output, rays_of(info(), rectified=False), HERE, [box], 10.0, None)
    assert found[2:4] == difference


@pytest.mark.parametrize("is_met", [True, False])
def test_a_pixel_exactly_on_an_edge_has_either_number(is_met: bool) -> None:
    """A camera as high as a flat top: rounding decides for a whole row, and none is a fault."""
    camera = info()
    camera.k[5] = 12.0
    rays = rays_of(camera, rectified=False)
    box = box_triangles() * (0.4, 0.3, 0.2) + (0.1, 0.3, 3.0)
    real = frame(np.full((24, 32), 4.0))
    numbers = real.numbers.copy()
    numbers[np.isfinite(nearest_depths(rays, HERE, [box]))] = 2800
    numbers[12, 12:23] = 2800 if is_met else 4000
    found = compared(real, replace(real, numbers=numbers), rays, HERE, [box], 10.0, None)
    assert found[1:4] == (0, 0, 0)
    numbers[13, 12:23] = 4000
    found = compared(real, replace(real, numbers=numbers), rays, HERE, [box], 10.0, None)
    assert found[1:4] == (0, 0, 11)


def test_walls_hide_from_holes_only() -> None:
    """A wall at 2 m: the hole stays, returns prove that there is none."""
    real, output = scene()
    wall = Walls(
        np.array((-5.0, -5.0, 2.0)), 0.0, np.array((10.0, 10.0, 0.1)), np.zeros((1, 3), int)
    )
    assert judged(real, output, wall)[3] + judged(real, output, wall)[2] == 4
    numbers = output.numbers.copy()
    numbers[10:14, 15] = 0
    assert judged(real, replace(output, numbers=numbers), wall)[1:4] == (0, 0, 0)


def test_pixels_only_come_nearer() -> None:
    """Or get a depth where they had none; all else stays."""
    real, output = scene()
    fault, which, unreturned = changed_pixels(real, output)
    assert fault == ""
    assert np.count_nonzero(unreturned) == 4
    assert 60 < len(which) < 120
    fault, which, _ = changed_pixels(output, real)
    assert fault.startswith("has 4 m in row ")
    assert len(which) == 0
    fault, _, _ = changed_pixels(real, replace(output, rest=("padding",)))
    assert fault == "has another size, encoding or padding than its input"


@pytest.mark.parametrize(
    ("model", "d"),
    [
        ("pinhole", ()),
        ("plumb_bob", (-0.2, 0.05, 1e-3, -2e-3, 0.01)),
        ("rational_polynomial", (0.3, 0.1, 5e-4, 2e-4, 0.01, 0.6, 0.2, 0.03)),
        ("equidistant", (-0.02, 0.01, -3e-3, 1e-3)),
    ],
)
def test_rays_are_where_opencv_projects_to_the_pixels(model: str, d: tuple[float, ...]) -> None:
    """To a thousandth of a pixel."""
    camera = info(model, d)
    rays, zeros = rays_of(camera, rectified=False).reshape(-1, 1, 3), np.zeros(3)
    project = cv2.fisheye.projectPoints if model == "equidistant" else cv2.projectPoints
    found = project(rays, zeros, zeros, camera.k.reshape(3, 3), np.array(d))[0].reshape(24, 32, 2)
    v, u = np.mgrid[:24, :32]
    np.testing.assert_allclose(found, np.stack((u, v), axis=2), atol=1e-3)


@pytest.mark.parametrize(
    ("model", "d"),
    [
        ("plumb_bob", (-0.45, 0.08, 0.0, 0.0, 0.0)),
        ("plumb_bob", (-0.4, 0.0, 3e-3, -2e-3)),
        ("rational_polynomial", (0.1, -0.3, 1e-3, 1e-3, 0.05, 0.2, 0.1, 0.0)),
    ],
)
def test_beyond_where_a_lens_folds_back_no_ray_is_known(model: str, d: tuple[float, ...]) -> None:
    """Though some slope far out may show the same pixel; up to there all rays are."""
    camera = info(model, d)
    camera.k[[0, 4]] = 13.0
    k, r, p = (tuple(getattr(camera, name).tolist()) for name in "krp")
    wanted = CameraInfo(32, 24, model, d, k, r, p).view(rectified=False).rays_to_depth()
    rays = rays_of(camera, rectified=False)
    is_known = ~np.isnan(wanted[:, :, 0])
    assert 0.2 < is_known.mean() < 0.95
    assert ((~np.isnan(rays[:, :, 0])) == is_known).all()
    np.testing.assert_allclose(rays[is_known], wanted[is_known], rtol=1e-6, atol=1e-6)


def test_rays_of_a_fisheye_are_known_as_far_as_depths_go() -> None:
    """To 89.94 degrees off the axis, as the node has it: pixels that it changes have a ray."""
    camera = info("equidistant", (-0.02, 0.01, -3e-3, 1e-3))
    camera.k[0], camera.k[2] = 5e3, 15.5 - 1.5752 * 5e3
    k, r, p = (tuple(getattr(camera, name).tolist()) for name in "krp")
    lens = CameraInfo(32, 24, "equidistant", tuple(camera.d.tolist()), k, r, p)
    wanted = lens.view(rectified=False).rays_to_depth()
    is_known = ~np.isnan(wanted[:, :, 0])
    assert 0.1 < is_known.mean() < 0.9
    rays = rays_of(camera, rectified=False)
    assert ((~np.isnan(rays[:, :, 0])) == is_known).all()
    np.testing.assert_allclose(rays[is_known], wanted[is_known], rtol=1e-3)


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("distortion_model", "kannala_brandt4"),
        ("d", np.array((0.1, 0.0, 0.0))),
        ("d", np.array((*np.zeros(12), 0.01, 0.0))),
        ("k", np.zeros(9)),
        ("width", 64),
        ("height", 0),
        ("header", SimpleNamespace(frame_id="")),
        (None, None),
    ],
)
def test_without_a_camera_info_of_use_an_image_has_to_stay_as_it_is(
    field: str | None, value: Any
) -> None:
    """It passes through, without a CameraInfo; with one of use, that has to be beside it."""
    (before, after), name = scene(), "/camera/depth/image_rect_raw"
    for output, is_right in ((before, field is not None), (after, False)):
        lens = info("plumb_bob", (0.1, 0.0, 0.0, 0.0, 0.0))
        lens.header = SimpleNamespace(frame_id="camera")
        if field is not None:
            setattr(lens, field, value)
        pairs, source = ScanPairs(), name.replace("rect_", "")
        pairs.infos[info_topic(source)] = lens
        pairs.add(source, before)
        pairs.add(f"/ar_builder{source}", output)
        assert pairs.pairs == 1
        assert (pairs.changed == []) == is_right
        assert len(pairs.kept_depths.kept) == (field is None)


@pytest.mark.parametrize(("most_bytes", "made"), [(10**8, 13), (12 * 24 * 32 * 24, 39), (0, 39)])
def test_rays_of_many_cameras_are_made_once_as_far_as_there_is_room(
    monkeypatch: pytest.MonkeyPatch, most_bytes: int, made: int
) -> None:
    """Those of a lens that distorts take seconds, and cameras take turns."""
    pairs, asked = ScanPairs(), list[Any]()
    monkeypatch.setattr(scan_pairs, "_MOST_RAYS_BYTES", most_bytes)

    def rays(one: Any, *, rectified: bool) -> npt.NDArray[np.float64]:
        asked.append((one, rectified))
        return np.full((24, 32, 3), one.k[0])

    monkeypatch.setattr(scan_pairs, "rays_of", rays)
    for _ in range(3):
        for focus in range(13):
            lens = info(d=(0.1, 0.0, 0.0, 0.0))
            lens.k[0] = focus
            assert pairs.rays(lens, rectified=False)[0, 0, 0] == focus
    assert len(asked) == made


def test_places_where_a_pixel_may_end_span_a_step() -> None:
    """Whatever depth was rounded to a number: a place is within a quarter of a step of it."""
    ab = (20.0 * 21.0, 1.0 - 20.0 * 21.0 / 10.0)
    true_m = np.random.default_rng(1).uniform(3.0, 8.0, (24, 32))
    numbers = np.rint(ab[0] / true_m + ab[1]).astype(np.uint16)
    output = DepthFrame(5, 7, "camera", numbers, (), 2, ab)
    lens, pairs = info(), ScanPairs()
    lens.header = SimpleNamespace(frame_id="camera")
    pairs.infos |= dict.fromkeys(("/camera_info", "/ar_builder/camera_info"), lens)
    pairs.add("/depth", replace(output, numbers=np.ones_like(numbers)))
    pairs.add("/ar_builder/depth", output)
    (changed,) = pairs.changed
    places_m = changed.changes.points_m[:, :, 2].reshape(24, 32, 3)
    step_m = true_m**2 / ab[0]
    off_m = np.abs(places_m - true_m[..., None]).min(axis=2)
    assert (off_m <= 0.3 * step_m).all()
    assert step_m.max() > 0.1


def test_what_is_kept_is_spread_over_a_recording() -> None:
    """At most forty, evenly apart."""
    kept = Kept[int](40)
    for number in range(1000):
        kept.add(number)
    steps = np.diff(kept.kept)
    assert 20 <= len(kept.kept) <= 40
    assert len(set(steps.tolist())) == 1
    assert info_topic("/a/depth/image/compressedDepth") == "/a/depth/camera_info"


class _Scan(NamedTuple):
    stamp_ns: int
    frame_id: str = "laser"


class _Cloud(NamedTuple):
    stamp_ns: int
    frame_id: str = "laser"


def test_a_sensor_that_is_not_augmented_drops_no_input_of_another() -> None:
    """A node that stands still sends what it made of a scan a hundred clouds later."""
    pairs = Pairs()
    for k in range(150):
        assert pairs.matched("/scan", _Scan(k), 2000) == []
        assert pairs.matched("/points", _Cloud(k), 100) == []
    found = [pairs.matched("/ar_builder/scan", _Scan(k), 2000) for k in range(150)]
    assert [len(one) for one in found] == [1] * 150
    late = [len(pairs.matched("/ar_builder/points", _Cloud(k), 100)) for k in range(150)]
    assert late == [0] * 50 + [1] * 100


@pytest.mark.parametrize("other", [{"kind": "mono16"}, {"frame_id": "thermal"}])
def test_an_image_of_16_bits_of_another_kind_or_frame_is_not_the_input_of_depths(
    other: dict[str, Any],
) -> None:
    """As that of an infrared camera beside one of depths, whose output has the name of its role."""
    pairs, depths = Pairs(), replace(frame(np.ones((24, 32))), kind="16UC1")
    for topic, image in (("/ir/image_raw", replace(depths, **other)), ("/depth/image_raw", depths)):
        assert pairs.matched(topic, image, 100) == []
    ((source, _, _, _),) = pairs.matched("/ar_builder/depth/image", depths, 100)
    assert source == "/depth/image_raw"
    assert pairs.unmatched() == []
