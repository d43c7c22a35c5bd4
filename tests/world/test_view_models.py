"""View models against OpenCV's forward projection, and their bounds against their own rays."""

import math
from pathlib import Path
from typing import cast

import cv2
import numpy as np
import numpy.typing as npt
import pytest

from are_ros.errors import ParameterError
from are_ros.messages.images.image import read_camera_info
from are_ros.world.cameras import (
    FisheyeView,
    OmnidirectionalView,
    PinholeView,
    ViewModel,
)

Floats = npt.NDArray[np.float64]

MILD = (-0.32, 0.11, 0.0006, -0.0004, -0.02)
RATIONAL = (0.5, 0.05, 0.001, -0.0007, 0.002, 0.8, 0.15, 0.01)
PRISM = (*RATIONAL, 0.001, -0.0005, 0.0008, 0.0003)


def _pinhole(distortion: tuple[float, ...], focal: float = 130.0) -> PinholeView:
    padded = (*distortion, *([0.0] * (14 - len(distortion))))
    return PinholeView(160, 120, focal, focal + 1.0, 81.5, 58.2, padded)


def _projected(view: PinholeView | FisheyeView, rays: Floats) -> Floats:
    """Return the pixels (N, 2) of rays (N, 3), by OpenCV."""
    k = np.array([[view.fx, 0.0, view.cx], [0.0, view.fy, view.cy], [0.0, 0.0, 1.0]])
    points, d, zero = rays.reshape(-1, 1, 3), np.array(view.distortion), np.zeros(3)
    if isinstance(view, FisheyeView):
        pixels = cv2.fisheye.projectPoints(points, zero, zero, k, d)[0]
    else:
        pixels = cv2.projectPoints(points, zero, zero, k, d)[0]
    return cast("Floats", pixels.reshape(-1, 2))


@pytest.mark.parametrize("distortion", [(), MILD, RATIONAL, PRISM])
def test_every_pinhole_ray_projects_back_to_its_pixel(distortion: tuple[float, ...]) -> None:
    """OpenCV projects the ray of pixel (u, v) to (u, v), within float32's rounding."""
    view = _pinhole(distortion)
    rays = view.directions()
    assert rays.dtype == np.float32
    assert rays.shape == (120, 160, 3)
    np.testing.assert_allclose(np.linalg.norm(rays, axis=2), 1.0, atol=1e-6)
    pixels = _projected(view, rays.reshape(-1, 3).astype(np.float64))
    v, u = np.divmod(np.arange(160 * 120), 160)
    np.testing.assert_allclose(pixels, np.stack((u, v), axis=1), atol=1e-3)


def test_pixels_beyond_the_fold_of_a_lens_have_no_ray() -> None:
    """Barrel distortion r (1 - 0.3 r^2) reaches 0.703 at most: pixels beyond it have zero rays."""
    rays = _pinhole((-0.3, 0.0, 0.0, 0.0), focal=60.0).directions()
    v, u = np.mgrid[0:120, 0:160]
    radius = np.hypot((u - 81.5) / 60.0, (v - 58.2) / 61.0)
    reach = (1.0 - 0.3 / 0.9) / math.sqrt(0.9)
    np.testing.assert_array_equal(rays.any(axis=2), radius <= reach)


@pytest.mark.parametrize("distortion", [(0.0, 0.0, 0.0, 0.0), (0.05, -0.01, 0.004, -0.001)])
def test_every_fisheye_ray_projects_back_to_its_pixel(
    distortion: tuple[float, float, float, float],
) -> None:
    """OpenCV's fisheye projects the rays in front of the camera back to their pixels."""
    view = FisheyeView(160, 120, 60.0, 61.0, 81.5, 58.2, distortion)
    rays = view.directions().reshape(-1, 3).astype(np.float64)
    front = rays[:, 2] > 0.05
    assert front.mean() > 0.9
    v, u = np.divmod(np.arange(160 * 120), 160)
    pixels = np.stack((u, v), axis=1)
    np.testing.assert_allclose(_projected(view, rays[front]), pixels[front], atol=2e-3)


def test_a_fisheye_sees_behind_itself_up_to_straight_back() -> None:
    """An ideal equidistant lens has theta = radius / f; beyond pi there is no ray."""
    rays = FisheyeView(101, 101, 12.0, 12.0, 50.0, 50.0).directions()
    np.testing.assert_allclose(rays[50, 50], (0.0, 0.0, 1.0))
    theta = 30.0 / 12.0
    np.testing.assert_allclose(rays[50, 80], (math.sin(theta), 0.0, math.cos(theta)), atol=1e-6)
    assert rays[50, 50 + 37].any()
    assert not rays[50, 50 + 38].any()


def test_the_default_pinhole_spans_its_field_of_view() -> None:
    """The image's outer edges, half a pixel beyond the last centres, are at +- hfov / 2."""
    view = PinholeView.from_field_of_view(640, 480, math.pi / 2)
    assert (639.5 - view.cx) / view.fx == pytest.approx(1.0)
    assert (-0.5 - view.cx) / view.fx == pytest.approx(-1.0)
    assert view.fx == view.fy
    ray = view.directions()[0, 639]
    assert ray[0] > 0 > ray[1]


@pytest.mark.parametrize("arguments", [(0, 480, 1.0), (640, 480, math.pi), (640, 480, 0.0)])
def test_an_impossible_pinhole_is_refused(arguments: tuple[int, int, float]) -> None:
    """A size or field of view outside the domain is refused."""
    with pytest.raises(ParameterError, match="pinhole"):
        PinholeView.from_field_of_view(*arguments)


def test_the_omnidirectional_view_goes_all_around() -> None:
    """The middle looks forward, a quarter on looks right, the first row highest up."""
    view = OmnidirectionalView(360, 91, -0.6, 0.6)
    rays = view.directions().astype(np.float64)
    np.testing.assert_allclose(np.linalg.norm(rays, axis=2), 1.0, atol=1e-6)
    azimuth = np.arctan2(rays[45, :, 0], rays[45, :, 2])
    np.testing.assert_allclose(azimuth, np.deg2rad(np.arange(360) - 179.5), atol=1e-6)
    np.testing.assert_allclose(rays[45, 180, 1], 0.0, atol=1e-6)
    assert math.asin(-rays[0, 0, 1]) == pytest.approx(0.6, abs=0.02)
    np.testing.assert_allclose(np.diff(np.arcsin(rays[:, 0, 1]), n=2), 0.0, atol=1e-6)


def test_an_impossible_omnidirectional_view_is_refused() -> None:
    """Elevations out of order are refused."""
    with pytest.raises(ParameterError, match="omnidirectional"):
        OmnidirectionalView(360, 90, 0.5, 0.1)


def test_views_are_values_whose_rays_are_made_once() -> None:
    """Equal numbers make equal views; the rays are read-only and kept."""
    view, again = _pinhole(MILD), _pinhole(MILD)
    assert view == again
    assert hash(view) == hash(again)
    assert view.directions() is view.directions()
    assert not view.directions().flags.writeable


TURNED = tuple(cv2.Rodrigues(np.array([0.0, -0.1, 0.02]))[0].reshape(-1).tolist())

VIEWS: list[ViewModel] = [
    _pinhole(()),
    _pinhole(MILD),
    PinholeView(160, 120, 90.0, 90.0, 80.0, 60.0, (), TURNED),
    FisheyeView(160, 120, 40.0, 41.0, 80.0, 60.0, (0.01, 0.0, 0.0, 0.0)),
    OmnidirectionalView(180, 60, -0.9, 0.7),
]


def test_a_real_camera_reproduces_its_pixels(real_data: Path) -> None:
    """Three calibrations of a Raspberry Pi camera project back to their pixels."""
    from rosbags.highlevel import AnyReader

    for bag in sorted((real_data / "ubiquity-raspicam").glob("*.bag")):
        with AnyReader([bag]) as reader:
            chosen = [c for c in reader.connections if c.msgtype.endswith("CameraInfo")]
            connection, _, raw = next(reader.messages(chosen))
            message = reader.deserialize(raw, connection.msgtype)
        view = read_camera_info(message).view(rectified=False)
        assert any(view.distortion)
        rays = view.directions()[::40, ::40]
        assert rays.any(axis=2).all()
        v, u = np.mgrid[0 : view.height : 40, 0 : view.width : 40]
        pixels = _projected(view, rays.reshape(-1, 3).astype(np.float64))
        np.testing.assert_allclose(pixels, np.stack((u.ravel(), v.ravel()), axis=1), atol=1e-2)
