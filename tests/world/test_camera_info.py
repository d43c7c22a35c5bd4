"""View models from CameraInfo: regions, binning, rectification, and what is refused."""

import math
from dataclasses import replace

import cv2
import numpy as np
import pytest

from are_ros.errors import InputError
from are_ros.world.cameras import CameraInfo, FisheyeView, PinholeView

INFO = CameraInfo(
    width=64,
    height=48,
    distortion_model="plumb_bob",
    d=(-0.2, 0.05, 0.001, -0.002, 0.0),
    k=(50.0, 0.0, 31.0, 0.0, 52.0, 24.5, 0.0, 0.0, 1.0),
    r=(1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0),
    p=(45.0, 0.0, 30.0, -4.5, 0.0, 46.0, 23.0, 0.0, 0.0, 0.0, 1.0, 0.0),
)


def test_the_raw_image_uses_k_and_d() -> None:
    """Without rectification the view has K's numbers and D's coefficients, padded to 14."""
    view = INFO.view(rectified=False)
    assert isinstance(view, PinholeView)
    assert (view.fx, view.fy, view.cx, view.cy) == (50.0, 52.0, 31.0, 24.5)
    assert view.distortion == (*INFO.d, *([0.0] * 9))


def test_the_rectified_image_uses_p_and_turns_back_by_r() -> None:
    """A rectified pixel's ray, turned by R, has the slopes that P gives; D plays no part."""
    rotation, _ = cv2.Rodrigues(np.array([0.02, -0.1, 0.05]))
    view = replace(INFO, r=tuple(rotation.reshape(-1).tolist())).view(rectified=True)
    ray = rotation @ view.directions()[7, 11]
    assert ray[:2] / ray[2] == pytest.approx([(11 - 30) / 45, (7 - 23) / 46], abs=1e-6)


def test_a_fisheye_is_rectified_to_a_pinhole() -> None:
    """The equidistant model gives a fisheye view of the raw image, a pinhole of the rectified."""
    info = replace(INFO, distortion_model="equidistant", d=(0.01, 0.0, 0.0, 0.0))
    assert isinstance(info.view(rectified=False), FisheyeView)
    assert isinstance(info.view(rectified=True), PinholeView)


def test_a_region_and_binning_pick_the_same_rays() -> None:
    """A pixel of a region of interest, binned by 2, looks along the ray of its full-image pixel."""
    whole = INFO.view(rectified=False).directions()
    part = replace(INFO, roi=(10, 6, 40, 32), binning_x=2, binning_y=2).view(rectified=False)
    assert (part.width, part.height) == (20, 16)
    np.testing.assert_allclose(part.directions(), whole[6:38:2, 10:50:2], atol=1e-6)


def test_equal_infos_are_equal_and_make_equal_views() -> None:
    """A camera_info that repeats itself is recognised without computing anything."""
    again = replace(INFO, width=64)
    assert again == INFO
    assert again.view(rectified=False) == INFO.view(rectified=False)
    assert replace(INFO, width=63).view(rectified=False) != INFO.view(rectified=False)


@pytest.mark.parametrize("model", ["", "none", "pinhole", "plumb_bob", "rational_polynomial"])
def test_no_coefficients_mean_no_distortion(model: str) -> None:
    """An empty D is an undistorted camera whatever the model is called."""
    view = replace(INFO, distortion_model=model, d=()).view(rectified=False)
    assert isinstance(view, PinholeView)
    assert view.distortion == ()


@pytest.mark.parametrize(
    ("info", "rectified", "sentence"),
    [
        (replace(INFO, width=0), False, "front: width, height are 0 and 48"),
        (replace(INFO, k=(0.0,) * 9), False, "front: k is all zeros, so this camera is not calib"),
        (replace(INFO, p=(0.0,) * 12), True, "front: p is all zeros"),
        (replace(INFO, k=(-1.0, *INFO.k[1:])), False, "front: k has focal lengths -1.0 and 52.0"),
        (replace(INFO, k=(math.nan, *INFO.k[1:])), False, "front: k has a number that is not fin"),
        (replace(INFO, d=(math.inf, 0.0, 0.0, 0.0, 0.0)), True, "front: d has a number that is n"),
        (replace(INFO, k=INFO.k[:8]), False, "front: k has 8 numbers, not 9"),
        (replace(INFO, distortion_model="fov"), False, "front: distortion_model 'fov' is unknown"),
        (replace(INFO, d=(0.1,) * 8), False, "front: d has 8 coefficients, and 'plumb_bob' takes"),
        (replace(INFO, distortion_model=""), False, "front: distortion_model is '', and d is not"),
        (replace(INFO, roi=(40, 0, 30, 48)), False, "front: roi (40, 0, 30, 48) (x, y, width, he"),
        (replace(INFO, roi=(64, 0, 0, 0)), False, "front: roi (64, 0, 0, 0)"),
        (replace(INFO, binning_x=65), False, "front: binning_x, binning_y of 65 and 1 leave no"),
        (replace(INFO, binning_y=-1), False, "front: binning_x, binning_y are 0, -1"),
        (replace(INFO, width=1 << 20, height=1 << 20), False, "front: width, height give"),
        (replace(INFO, r=(0.0,) * 9), True, "front: r is no rotation"),
        (
            replace(INFO, distortion_model="rational_polynomial", d=(0.0,) * 12 + (0.1, 0.0)),
            False,
            "front: d has coefficients of a tilted sensor",
        ),
    ],
)
def test_a_bad_info_is_refused_with_field_and_reason(
    info: CameraInfo, rectified: bool, sentence: str
) -> None:
    """Each fault is named by source, field and reason."""
    with pytest.raises(InputError) as caught:
        replace(info, source="front").view(rectified=rectified)
    assert str(caught.value).startswith(sentence)
