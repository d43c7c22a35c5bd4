"""Images of depths beside their inputs, and computed anew: shared with nothing that it judges.

Which pixels changed, and whether they may; where the pixels look, from the CameraInfo, the lens
models turned round slowly; and the depths pixel by pixel and triangle by triangle. There is nothing
in it that could be quick.
"""

import itertools
import math
import struct
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from are_ros.checks.oracle.frames import Pose
from are_ros.checks.oracle.solids import Walls
from are_ros.messages.common import read_time

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

_ROUNDS: Final = 40
_CLOSE_PX: Final = 1e-6
_STEP: Final = 1e-6
_STILL: Final = 1e-12
"""A round that changes no slope by more is the last one."""
_FARTHEST_RAD: Final = math.acos(1e-3)
"""89.94 degrees: farther off the axis there is no depth."""
_LENSES: Final = {
    **dict.fromkeys(("", "none", "pinhole", "plumb_bob"), (0, 4, 5)),
    "rational_polynomial": (0, 8, 12, 14),
    "equidistant": (0, 4),
}
"""How many coefficients a lens may have. Of others nothing is known, and their images stay."""
_TRANSPORTS: Final = frozenset(("compressed", "compressedDepth", "theora", "zstd", "ffmpeg"))


def name_parts(topic: str) -> tuple[str, str]:
    """Return the namespace of an image's topic, and its name without the transport."""
    parts = topic.split("/")
    if parts[-1] in _TRANSPORTS:
        parts.pop()
    return "/".join(parts[:-1]), parts[-1]


def info_topic(topic: str, given: Mapping[str, str] = MappingProxyType({})) -> str:
    """Return the topic of an image's CameraInfo: the given one of the image, else that beside."""
    return given.get(topic) or f"{name_parts(topic)[0]}/camera_info"


def rays_of(info: Any, *, rectified: bool) -> Floats:
    """Return the rays (H, W, 3) of a CameraInfo's image to a depth of 1 m; NaN where none is known.

    ValueError for a lens that is not known.
    """
    number = {name: np.asarray(getattr(info, name), np.float64) for name in "dkrp"}
    x_off, y_off = info.roi.x_offset, info.roi.y_offset
    across, down = max(info.binning_x, 1), max(info.binning_y, 1)
    width = (info.roi.width or info.width - x_off) // across
    height = (info.roi.height or info.height - y_off) // down
    matrix = number["p"].reshape(3, 4)[:, :3] if rectified else number["k"].reshape(3, 3)
    fx, fy = matrix[0, 0] / across, matrix[1, 1] / down
    cx, cy = (matrix[0, 2] - x_off) / across, (matrix[1, 2] - y_off) / down
    v, u = np.mgrid[:height, :width].astype(np.float64)
    flat = np.stack(((u - cx) / fx, (v - cy) / fy), axis=2)
    if rectified:
        rays = np.concatenate((flat, np.ones((height, width, 1))), axis=2)
        return np.asarray(rays @ number["r"].reshape(3, 3))
    slopes = _undistorted(flat, info.distortion_model, number["d"], _CLOSE_PX / max(fx, fy))
    return np.concatenate((slopes, np.ones((height, width, 1))), axis=2)


def _undistorted(flat: Floats, model: str, d: Floats, close: float) -> Floats:
    """Return the slopes (H, W, 2) that a lens shows at `flat`; NaN where none is that `close`."""
    is_flat = model in {"", "none", "pinhole"}
    if len(d) not in _LENSES.get(model, ()) or d[12:].any() or (is_flat and d.any()):
        raise ValueError(f"the lens {model!r} with {d} is not known here")
    if model == "equidistant":
        return _from_angles(flat, np.resize(d, 4) if len(d) else np.zeros(4), close)
    if not d.any():
        return flat
    k = np.zeros(14)
    k[: len(d)] = d
    slopes, farthest = _radially_undistorted(flat, k)
    steps = _STEP * np.eye(2)
    with np.errstate(all="ignore"):  # where no slope shows what the pixel shows
        for _ in range(_ROUNDS):
            lacks = flat - _shown(slopes, k)
            (a, c), (b, d) = (
                np.moveaxis(_shown(slopes + step, k) - _shown(slopes - step, k), 2, 0)
                for step in steps
            )
            u, v = np.moveaxis(2.0 * _STEP * lacks / (a * d - b * c)[..., None], 2, 0)
            change = np.stack((d * u - b * v, a * v - c * u), axis=2)
            slopes += change
            if not (np.abs(change) > _STILL).any():
                break
        is_known = np.abs(_shown(slopes, k) - flat).max(axis=2) < close
        is_known &= (a * d - b * c > 0.0) & (np.hypot(slopes[..., 0], slopes[..., 1]) <= farthest)
    slopes[~is_known] = np.nan
    return slopes


def _radially_undistorted(flat: Floats, k: Floats) -> tuple[Floats, float]:
    """Return the slopes (H, W, 2) that the radial part alone shows at `flat`, and the farthest.

    Beyond that it shows other slopes at the same places: the image folds back. By bisection.
    """

    def shown(far: Floats) -> Floats:
        upper, lower = _radial(far * far, k)
        return np.where(lower > 0.0, far * upper / lower, -np.inf)

    far = np.tan(np.linspace(0.0, _FARTHEST_RAD, 200_000))
    with np.errstate(divide="ignore", invalid="ignore"):
        grows = np.diff(shown(far)) > 0.0
        farthest = float(far[-1] if grows.all() else far[grows.argmin()])
        radius = np.hypot(flat[..., 0], flat[..., 1])
        found = _bisected(shown, radius, farthest)
    return flat * (found / np.maximum(radius, 1e-300))[..., None], farthest


def _radial(r2: Floats, k: Floats) -> tuple[Floats, Floats]:
    """Return numerator and denominator of the radial part."""
    upper = 1.0 + k[0] * r2 + k[1] * r2**2 + k[4] * r2**3
    return upper, 1.0 + k[5] * r2 + k[6] * r2**2 + k[7] * r2**3


def _bisected(shown: Callable[[Floats], Floats], wanted: Floats, most: float) -> Floats:
    """Return from 0 to `most` where a growing function has the values wanted."""
    low, high = np.zeros_like(wanted), np.full_like(wanted, most)
    for _ in range(60):
        middle = 0.5 * (low + high)
        is_less = shown(middle) < wanted
        low, high = np.where(is_less, middle, low), np.where(is_less, high, middle)
    return low


def _shown(slopes: Floats, k: Floats) -> Floats:
    """Return where a lens shows slopes (H, W, 2)."""
    x, y = slopes[..., 0], slopes[..., 1]
    with np.errstate(over="ignore", invalid="ignore"):
        r2 = x * x + y * y
        upper, lower = _radial(r2, k)
        aside_x = 2.0 * k[2] * x * y + k[3] * (r2 + 2.0 * x * x) + k[8] * r2 + k[9] * r2**2
        aside_y = k[2] * (r2 + 2.0 * y * y) + 2.0 * k[3] * x * y + k[10] * r2 + k[11] * r2**2
        return np.stack((x * upper / lower + aside_x, y * upper / lower + aside_y), axis=2)


def _from_angles(flat: Floats, k: Floats, close: float) -> Floats:
    """Return the slopes (H, W, 2) of a fisheye's image; NaN from 89.94 degrees off the axis on."""

    def shown(angle: Floats) -> Floats:
        return np.asarray(angle * (1.0 + sum(k[i] * angle ** (2 * i + 2) for i in range(4))))

    radius = np.hypot(flat[..., 0], flat[..., 1])
    found = _bisected(shown, radius, _FARTHEST_RAD)
    angle = np.where(np.abs(shown(found) - radius) < close, found, np.nan)
    scale = np.where(radius > 0.0, np.tan(angle) / np.maximum(radius, 1e-300), 1.0)
    return flat * scale[..., None]


_KINDS: Final = {"16UC1": "u2", "mono16": "u2", "32FC1": "f4"}
_HEADER: Final = struct.Struct("<iff")
_MILLIMETRES, _METRES, _INVERSE = range(3)


@dataclass(frozen=True, eq=False)
class DepthFrame:
    """The depths of an image: numbers (H, W) as they are stored, and what they mean.

    `rest` is all else that has to stay: sizes, names, bytes of padding. `kind` is the encoding:
    other images of 16 bits, which are none of depths, may have another.
    """

    stamp_ns: int
    at_ns: int
    frame_id: str
    numbers: NDArray[Any]
    rest: tuple[Any, ...]
    code: int
    ab: tuple[float, float] = (0.0, 0.0)
    kind: str = ""

    @property
    def depths_m(self) -> Floats:
        """The depths (H, W): NaN where there is none, -inf where the pixel says too close."""
        stored = self.numbers.astype(np.float64)
        if self.code == _METRES:
            is_some = np.isfinite(stored) & (np.nan_to_num(stored) > 0.0)
            return np.where(is_some | np.isneginf(stored), stored, np.nan)
        none = stored == 0.0
        stored[none] = np.nan
        if self.code == _MILLIMETRES:
            return stored / 1000.0
        return self.ab[0] / (stored - self.ab[1])

    def half_steps_m(self, depths_m: Floats) -> Floats:
        """Return half of what neighbouring numbers are apart at depths [m]."""
        if self.code == _MILLIMETRES:
            return np.full_like(depths_m, 5e-4)
        if self.code == _METRES:
            return 1e-7 * np.abs(depths_m)
        return 0.5 * depths_m * depths_m / self.ab[0]

    @property
    def farthest_m(self) -> float:
        """The largest depth that there is a number for."""
        last = self.ab[0] / (1.0 - self.ab[1]) if self.code == _INVERSE else np.inf
        return 65.535 if self.code == _MILLIMETRES else last

    def numbers_of(self, depths_m: Floats) -> Floats:
        """Return the numbers, unrounded, of depths [m], finite or 0."""
        if self.code == _METRES:
            return depths_m
        if self.code == _MILLIMETRES:
            return 1000.0 * depths_m
        return self.ab[0] / np.maximum(depths_m, 1e-9) + self.ab[1]

    @classmethod
    def of_message(cls, message: Any, at_ns: int) -> "DepthFrame | None":
        """Return the depths of an Image or CompressedImage; None of one that holds none.

        ValueError where the message is malformed.
        """
        if not holds_depths(message):
            return None
        when = read_time(message.header.stamp), at_ns, str(message.header.frame_id).lstrip("/")
        if hasattr(message, "format"):
            return cls._of_compressed(message, *when)
        kind = np.dtype((">" if message.is_bigendian else "<") + _KINDS[message.encoding])
        rows = np.asarray(message.data, np.uint8).reshape(message.height, message.step)
        used = message.width * kind.itemsize
        numbers = np.ascontiguousarray(rows[:, :used]).view(kind)
        sizes = message.height, message.width, message.step
        rest = (*sizes, message.encoding, bool(message.is_bigendian), rows[:, used:].tobytes())
        code = _METRES if message.encoding == "32FC1" else _MILLIMETRES
        return cls(*when, numbers, rest, code, kind=message.encoding)

    @classmethod
    def _of_compressed(cls, message: Any, stamp_ns: int, at_ns: int, frame_id: str) -> "DepthFrame":
        import cv2

        data = np.asarray(message.data, np.uint8)
        try:
            numbers = cv2.imdecode(data[_HEADER.size :], cv2.IMREAD_UNCHANGED)
        except cv2.error:  # no data, or of a size that cannot be
            numbers = None
        if numbers is None or numbers.ndim != 2:
            raise ValueError("its PNG cannot be decoded")
        _, a, b = _HEADER.unpack(data[: _HEADER.size].tobytes())
        is_inverse = str(message.format).partition(";")[0].strip() == "32FC1"
        rest = (numbers.shape, message.format, data[: _HEADER.size].tobytes())
        code = _INVERSE if is_inverse else _MILLIMETRES
        return cls(stamp_ns, at_ns, frame_id, numbers, rest, code, (a, b), message.format)


def holds_depths(message: Any) -> bool:
    """Tell whether an Image or CompressedImage says that it is one of depths."""
    if not hasattr(message, "format"):
        return message.encoding in _KINDS
    encoding, _, transport = str(message.format).partition(";")
    return "compressedDepth" in transport and encoding.strip() in _KINDS


def changed_pixels(real: DepthFrame, output: DepthFrame) -> tuple[str, NDArray[np.int64], Bools]:
    """Return a fault or "", which pixels (M,) changed, in one row, and which had no return.

    Pixels may only come nearer, or get a depth where they had none.
    """
    none = np.empty(0, np.int64), np.empty(0, np.bool_)
    if output.rest != real.rest:
        return ("has another size, encoding or padding than its input", *none)
    one = np.ascontiguousarray(real.numbers).view(f"V{real.numbers.itemsize}").ravel()
    other = np.ascontiguousarray(output.numbers).view(f"V{output.numbers.itemsize}").ravel()
    which = np.flatnonzero(one != other)
    before, after = real.depths_m.ravel()[which], output.depths_m.ravel()[which]
    had = np.isfinite(before)
    is_inside = (~np.isfinite(after)) & had
    wrong = np.isneginf(before) | (had & ~is_inside & ~(after < before)) | (~had & np.isnan(after))
    if wrong.any():
        first = int(np.argmax(wrong))
        row, column = divmod(int(which[first]), real.numbers.shape[1])
        numbers = f"{after[first]:g} m in row {row}, column {column}"
        return (f"has {numbers}, where its input has {before[first]:g} m", *none)
    return "", which, ~had


@dataclass(frozen=True, eq=False)
class DepthPair:
    """An image of depths and what came out, with the CameraInfo that was known then."""

    topic: str
    real: DepthFrame
    output: DepthFrame
    info: Any
    is_rectified: bool


_NEAR_M: Final = 1e-3
_GRAZING_M: Final = 1e-4

_BESIDE: Final = 2e-5
"""Rays so far beside one of a pixel, per metre of depth, are as good: about a hundredth of a pixel.
At an edge they may meet something else, and rounding decides."""

_EXACTLY: Final = 1e-9
"""Where rays so close meet something else, a pixel lies on an edge, and either number is right: a
camera that is as high as a flat top has such pixels in a whole row."""

_SLACK: Final = 1.5e-5
"""By such a share of its size a triangle may be met beside it: bodies are without cracks, for which
their triangles overlap by a hundred thousandth."""

_MOST_PAIRS: Final = 1_000_000
"""Up to so many pairs of a ray and a triangle it is looked at all at once which may meet."""

_ALIKE: Final = 1e-4
"""Depths on a slope that such rays meet differ by such a share."""


class Difference(NamedTuple):
    """How an image differs from the one computed anew: numbers of pixels.

    `tested` of them have a ray, and do not lie exactly on an edge. `by_a_step` differ by one step
    of the encoding. `at_edges` are as a ray has it that is a hundredth of a pixel beside theirs, or
    a triangle's edge; `others` not.
    The first of those is at `place` (row, column), (-1, -1) if there is none.
    """

    tested: int
    by_a_step: int
    at_edges: int
    others: int
    place: tuple[int, int] = (-1, -1)


def nearest_depths(
    rays: Floats,
    camera: Pose,
    shapes: Sequence[Floats],
    limits_m: Floats | None = None,
    slack: float = 0.0,
) -> Floats:
    """Return the depth (H, W) [m] at which rays (H, W, 3) meet triangles (F, 3, 3) first, or inf.

    The triangles are in the map; `camera` is its pose there. Hits beyond `limits_m` (H, W) do not
    matter, and may be left out. Beside a triangle, up to `slack` of its size, it is met, too.
    """
    flat = rays.reshape(-1, 3)
    depths = np.full(len(flat), np.inf)
    limits = depths.copy() if limits_m is None else limits_m.ravel()
    for triangles in shapes:
        corners = (triangles - camera.translation_m) @ camera.rotation
        near = _within(flat, corners.reshape(-1, 3), slack)
        near = near[limits[near] >= _least_depth_m(rays, corners)]
        rays_near, depths_near = flat[near], depths[near]
        for corner in _those_near(rays_near, corners, slack):
            which = _within(rays_near, corner, slack)
            met = _met(rays_near[which], corner, slack)
            depths_near[which] = np.minimum(depths_near[which], met)
        depths[near] = depths_near
    return depths.reshape(rays.shape[:2])


def _those_near(rays: Floats, corners: Floats, slack: float) -> Floats:
    """Return the triangles (F, 3, 3) that any of the rays (N, 3) may meet, as `_within` does.

    All where there are too many pairs to be looked at.
    """
    if len(rays) * len(corners) > _MOST_PAIRS or (rays[:, 2] != 1.0).any():
        return corners
    least_m = corners[:, :, 2].min(axis=1)
    is_in_front = least_m > _NEAR_M
    ahead = corners[is_in_front]
    seen = ahead[:, :, :2] / ahead[:, :, 2:]
    beside = 1e-6 + slack * np.ptp(ahead, axis=1).max(axis=1) / least_m[is_in_front]
    low, high = seen.min(axis=1) - beside[:, None], seen.max(axis=1) + beside[:, None]
    at = rays[:, None, :2]
    is_near = ((at >= low) & (at <= high)).all(axis=2).any(axis=0)
    kept = corners[:, :, 2].max(axis=1) > 0.0
    kept[is_in_front] = is_near
    found: Floats = corners[kept]
    return found


def _least_depth_m(rays: Floats, corners: Floats) -> float:
    """Return the least depth of corners (..., 3) in front of a camera whose rays go 1 m deep."""
    return float(corners[..., 2].min()) if (rays[..., 2] == 1.0).all() else -np.inf


def _within(rays: Floats, corners: Floats, slack: float) -> NDArray[np.int64]:
    """Return which rays (N, 3) may meet what has these corners (M, 3), all of the camera's frame.

    None of what is behind the camera. All where a corner is, or rays do not go along the axis.
    """
    if (rays[:, 2] == 1.0).all() and corners[:, 2].max() <= 0.0:
        return np.empty(0, np.int64)
    if corners[:, 2].min() <= _NEAR_M or (rays[:, 2] != 1.0).any():
        return np.arange(len(rays))
    seen = corners[:, :2] / corners[:, 2:]
    beside = 1e-6 + slack * np.ptp(corners, axis=0).max() / corners[:, 2].min()
    low, high = seen.min(axis=0) - beside, seen.max(axis=0) + beside
    x, y = rays[:, 0], rays[:, 1]
    return np.flatnonzero((x >= low[0]) & (x <= high[0]) & (y >= low[1]) & (y <= high[1]))


def _met(rays: Floats, corner: Floats, slack: float) -> Floats:
    """Return the depths at which rays (N, 3) from 0 meet a triangle (3, 3), inf if they do not.

    By solving for the corners' weights: a ray times its depth is the weighted sum of the corners.
    """
    volume = np.linalg.det(corner)
    if abs(volume) < 1e-15:
        return np.full(len(rays), np.inf)
    (x, y, z), columns = rays.T, np.linalg.inv(corner).T
    weights = [x * a + y * b + z * c for a, b, c in columns.tolist()]
    total = weights[0] + weights[1] + weights[2]
    least = -slack * total
    is_met = (total > 0.0) & np.all([weight >= least for weight in weights], axis=0)
    return np.asarray(np.divide(1.0, total, out=np.full(len(rays), np.inf), where=is_met))


def box_triangles() -> Floats:
    """Return the triangles (12, 3, 3) of a cube from -1 to 1."""
    found = []
    for axis in range(3):
        others = [k for k in range(3) if k != axis]
        for side in (-1.0, 1.0):
            square = np.zeros((4, 3))
            square[:, axis] = side
            square[:, others] = ((-1, -1), (1, -1), (1, 1), (-1, 1))
            found += [square[[0, 1, 2]], square[[0, 2, 3]]]
    return np.array(found)


def compared(
    real: DepthFrame,
    output: DepthFrame,
    rays: Floats,
    camera: Pose,
    shapes: Sequence[Floats],
    range_m: float,
    walls: Walls | None,
) -> Difference:
    """Return how an output differs from what follows from its input and the artefacts' triangles.

    Pixels without a return, where artefacts are met, are left out if the walls are not known.
    """
    scene = _Scene(camera, shapes, min(range_m, real.farthest_m), walls)
    hits_m, is_doubtful = scene.hits(rays, real.depths_m)
    is_hit = np.isfinite(hits_m)
    is_doubtful |= np.isnan(rays).any(axis=2)
    with np.errstate(invalid="ignore"):
        wanted = np.where(is_hit, real.numbers_of(np.where(is_hit, hits_m, 1.0)), np.nan)
        found = output.numbers.astype(np.float64)
        kept = real.numbers.astype(np.float64)
        step = 4e-7 * np.abs(wanted) if real.numbers.dtype.kind == "f" else 0.5 + 1e-6
        is_same = np.where(is_hit, np.abs(found - wanted) <= step, found == kept)
        is_same |= ~is_hit & np.isnan(kept) & np.isnan(found)
        is_near = is_hit & (np.abs(found - wanted) <= 3.0 * step)
    differs = ~is_same & ~is_doubtful
    by_a_step, others = differs & is_near, differs & ~is_near
    on_edges, at_edges = np.zeros_like(others), np.zeros_like(others)
    on_edges[others] = _is_beside(real, output, rays, scene, others, _EXACTLY, 0.0)
    is_doubtful |= on_edges
    others &= ~on_edges
    at_edges[others] = _is_beside(real, output, rays, scene, others, _BESIDE, _SLACK)
    others &= ~at_edges
    place = (-1, -1)
    if others.any():
        row, column = np.argwhere(others)[0].tolist()
        place = row, column
    counts = [int(np.count_nonzero(one)) for one in (~is_doubtful, by_a_step, at_edges, others)]
    return Difference(counts[0], counts[1], counts[2], counts[3], place)


class _Scene(NamedTuple):
    """What rays of a camera meet: the artefacts' triangles, up to a depth, and walls if known."""

    camera: Pose
    shapes: Sequence[Floats]
    farthest_m: float
    walls: Walls | None

    def hits(self, rays: Floats, depths_m: Floats, slack: float = 0.0) -> tuple[Floats, Bools]:
        """Return the depths (H, W) at which rays meet artefacts, inf where depths (H, W) stay.

        The second array tells where that is doubtful. `slack` as in `nearest_depths`.
        """
        is_none = np.isnan(depths_m)
        limits_m = np.where(is_none, self.farthest_m, depths_m)
        hits_m = nearest_depths(rays, self.camera, self.shapes, limits_m + _GRAZING_M, slack)
        is_hit = hits_m < limits_m
        is_doubtful = is_none & (np.abs(hits_m - limits_m) < _GRAZING_M)
        self._hide(is_hit & is_none, hits_m, rays, is_hit, is_doubtful)
        return np.where(is_hit, hits_m, np.inf), is_doubtful

    def _hide(
        self, of_none: Bools, hits_m: Floats, rays: Floats, is_hit: Bools, is_doubtful: Bools
    ) -> None:
        """Take away hits (H, W) of pixels without a return that are behind walls, in place."""
        which = np.nonzero(of_none)
        if self.walls is None:
            is_doubtful[which] = True
            return
        ways = rays[which] @ self.camera.rotation.T
        lengths = np.linalg.norm(ways, axis=1)
        reaches_m = hits_m[which] * lengths
        starts_m = np.broadcast_to(self.camera.translation_m, ways.shape)
        solid_m = self.walls.first_solid(starts_m, ways / lengths[:, None], reaches_m + 1.0)
        is_hit[which] = solid_m >= reaches_m
        is_doubtful[which] |= np.abs(solid_m - reaches_m) < _GRAZING_M


def _is_beside(
    real: DepthFrame,
    output: DepthFrame,
    rays: Floats,
    scene: _Scene,
    which: Bools,
    beside: float,
    slack: float,
) -> Bools:
    """Return which of some pixels (M,) have the number that a ray `beside` theirs has.

    `slack` as in `nearest_depths`.
    """
    depths_m, found = real.depths_m[which][None], output.numbers[which].astype(np.float64)
    is_kept = found == real.numbers[which]
    is_beside = np.zeros(len(found), np.bool_)
    if not len(found):
        return is_beside
    for x, y in itertools.product((-beside, 0.0, beside), repeat=2):
        hits_m = scene.hits(rays[which][None] + (x, y, 0.0), depths_m, slack)[0][0]
        is_hit = np.isfinite(hits_m)
        numbers = real.numbers_of(np.where(is_hit, hits_m, 1.0))
        step = 0.0 if real.numbers.dtype.kind == "f" else 0.5
        is_alike = np.abs(found - numbers) <= step + _ALIKE * np.abs(numbers)
        is_beside |= np.where(is_hit, is_alike, is_kept)
    return is_beside
