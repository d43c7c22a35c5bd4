"""Each augmented reading of a sensor beside its input."""

from bisect import bisect_left
from collections import Counter, deque
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from are_ros.bag.recording import PREFIX
from are_ros.checks.sensors.depth_images import (
    DepthFrame,
    DepthPair,
    changed_pixels,
    info_topic,
    name_parts,
    rays_of,
)
from are_ros.checks.sensors.samples import BEAMS, Changes, Rays, Sample

_MOST_WAITING: Final = 2000
_MOST_IMAGES: Final = 40
_MOST_READINGS: Final = 2000
"""Of the readings, so many are looked at for what they do not show."""
_MOST_RAYS_BYTES: Final = 300_000_000
"""So much of the rays of lenses is kept, those used last: of 40 lenses of 640x480. A distorting one
takes seconds to be turned round."""
_MOST_LARGE: Final = 100
"""Of inputs that wait for what was made of them: of beams, and of clouds and images."""
_MOST_ENDS: Final = 2000
"""Of the changed pixels of an image, so many are looked at where they end."""
_TOO_NEAR_M: Final = 1e-3
_PLACES: Final = np.array((-1.0, 0.0, 1.0))
"""A pixel ends somewhere in a step of its encoding, which may be centimetres: tried at both ends
and in the middle, in half steps."""
_GAP: Final = 1.5
"""In usual distances of scans: farther apart, there was one in between."""


_Key = tuple[int, str, Any]
"""Stamp, frame and kind of a reading."""
_Pair = tuple[str, Any, str, Any]
"""Topic and reading of an input, and of the output that was made of it."""


@dataclass(frozen=True, eq=False)
class Released:
    """An augmented reading: its topic and frame, its stamp, and when it went out [ns]."""

    topic: str
    stamp_ns: int
    released_ns: int
    frame_id: str


@dataclass(frozen=True, eq=False)
class ChangedScan(Released):
    """An augmented reading that differs from its input, or is at fault."""

    changes: Changes


@dataclass(frozen=True, eq=False)
class UnchangedRays(Released):
    """Rays of an augmented reading that are those of its input."""

    rays: Rays


_Kind = TypeVar("_Kind")


class Kept(Generic[_Kind]):
    """Some of what came, at most so many, spread evenly: of too many, each second is dropped."""

    def __init__(self, most: int) -> None:
        self.kept: list[_Kind] = []
        self._most, self._every, self._seen = most, 1, 0

    def add(self, one: _Kind) -> None:
        """Keep one, or not."""
        if self._seen % self._every == 0:
            self.kept.append(one)
            if len(self.kept) > self._most:
                self.kept = self.kept[::2]
                self._every *= 2
        self._seen += 1


class Pairs:
    """Finds the input of each augmented reading by stamp, frame and kind, whichever comes first."""

    def __init__(self) -> None:
        self.pairs = 0
        self.input_topics: dict[tuple[str, Any], set[str]] = {}
        """By frame and kind."""
        self._inputs: dict[_Key, list[tuple[str, Any]]] = {}
        self._recent: dict[str, deque[_Key]] = {}
        self._outputs: dict[_Key, list[tuple[str, Any]]] = {}

    def unmatched(self) -> list[tuple[str, int]]:
        """Return topic and stamp of the augmented readings that have no input."""
        return [(topic, key[0]) for key, all_ in self._outputs.items() for topic, _ in all_]

    def matched(self, topic: str, reading: Any, most_waiting: int) -> list[_Pair]:
        """Take a reading, and return the pairs that it completes.

        Of the inputs of a topic the last `most_waiting` are kept: it may be augmented or not.
        """
        key = (reading.stamp_ns, reading.frame_id, getattr(reading, "kind", type(reading)))
        sources = self.input_topics.get(key[1:], set())
        if topic.startswith(PREFIX):
            self._outputs.setdefault(key, []).append((topic, reading))
        else:
            sources = self.input_topics.setdefault(key[1:], sources)
            sources.add(topic)
            self._inputs.setdefault(key, []).append((topic, reading))
            recent = self._recent.setdefault(topic, deque())
            recent.append(key)
            if len(recent) > most_waiting:
                self._drop(recent.popleft(), topic)
        inputs, outputs = self._inputs.pop(key, []), self._outputs.pop(key, [])
        found: list[_Pair] = []
        for output in list(outputs):
            own = [i for i, each in enumerate(inputs) if _is_of(output[0], each[0])]
            if own or (inputs and len(sources) == 1):
                found.append((*inputs.pop(own[0] if own else 0), *output))
                outputs.remove(output)
        if inputs:
            self._inputs[key] = inputs
        if outputs:
            self._outputs[key] = outputs
        self.pairs += len(found)
        return found

    def _drop(self, key: _Key, topic: str) -> None:
        """Drop the input of a topic, if it still waits."""
        others = [one for one in self._inputs.pop(key, []) if one[0] != topic]
        if others:
            self._inputs[key] = others


class ScanPairs(Pairs):
    """The augmented scans, ranges, clouds and images of depths beside their inputs.

    `counts` are the pairs of each class, `pixels` those of the images of depths.
    """

    def __init__(self) -> None:
        super().__init__()
        self.changed: list[ChangedScan] = []
        self.counts: Counter[type] = Counter()
        self.pixels = 0
        self.kept_rays = Kept[UnchangedRays](_MOST_READINGS)
        self.kept_depths = Kept[DepthPair](_MOST_IMAGES)
        self.infos: dict[str, Any] = {}
        """The last CameraInfo by topic; those beside images belong to the ones that come after."""
        self._rays: list[tuple[Any, bool, NDArray[np.float64]]] = []
        """Of each CameraInfo, the one used last at the end."""
        self._input_stamps: dict[str, list[int]] = {}
        self.given_infos: Mapping[str, str] = {}
        """The topics of the CameraInfo that is not beside the images, by theirs."""

    def info_of(self, topic: str) -> Any:
        """Return the last CameraInfo of the images of a topic, None without one."""
        return self.infos.get(info_topic(topic, self.given_infos))

    def rays(self, info: Any, *, rectified: bool) -> NDArray[np.float64]:
        """Return the rays (H, W, 3) of images of a CameraInfo; ValueError for an unknown lens."""
        for k, (known, is_rectified, rays) in enumerate(self._rays):
            if is_rectified == rectified and _are_alike(known, info):
                self._rays.append(self._rays.pop(k))
                return rays
        rays = rays_of(info, rectified=rectified)
        self._rays.append((info, rectified, rays))
        while len(self._rays) > 1 and sum(r.nbytes for *_, r in self._rays) > _MOST_RAYS_BYTES:
            del self._rays[0]
        return rays

    def add(self, topic: str, sample: Sample | DepthFrame) -> None:
        """Take a reading of any topic."""
        if not topic.startswith(PREFIX):
            self._input_stamps.setdefault(topic, []).append(sample.stamp_ns)
        most = _MOST_WAITING if type(sample) in BEAMS.values() else _MOST_LARGE
        for source, real, name, output in self.matched(topic, sample, most):
            self.counts[type(real)] += 1
            when = output.stamp_ns, output.at_ns, output.frame_id
            if isinstance(real, DepthFrame):
                changes = self._depth_changes(source, real, name, output)
            else:
                changes = real.changes(output)
                rays = None if changes.fault else real.unchanged(output)
                if rays is not None:
                    self.kept_rays.add(UnchangedRays(name, *when, rays))
            if changes.fault or len(changes.points_m):
                self.changed.append(ChangedScan(name, *when, changes))

    def may_be_lost(self, output: str, stamp_ns: int) -> bool:
        """Tell whether the input of an augmented scan may be missing in the recording.

        It is if its laser is not known, or there is a gap about its stamp.
        """
        topics = [t for t in self._input_stamps if _is_of(output, t)] or [*self._input_stamps]
        if len(topics) != 1:
            return True
        stamps = sorted(self._input_stamps[topics[0]])
        place = bisect_left(stamps, stamp_ns)
        if place in {0, len(stamps)}:
            return True
        usual_ns = float(np.median(np.diff(stamps)))
        return stamps[place] - stamps[place - 1] > _GAP * usual_ns

    def _depth_changes(
        self, source: str, real: DepthFrame, topic: str, output: DepthFrame
    ) -> Changes:
        self.pixels += real.numbers.size
        fault, which, unreturned = changed_pixels(real, output)
        info, is_rectified = self.info_of(source), "rect" in name_parts(source)[1]
        if info is not None and not self._fits(info, real, rectified=is_rectified):
            info = None
        if info is not None:
            self.kept_depths.add(DepthPair(topic, real, output, info, is_rectified))
            if not _are_alike(info, self.info_of(topic)):
                fault = fault or "has a CameraInfo beside it that is not its input's"
        elif len(which):
            fault = "was changed, and no CameraInfo of use had come beside its input"
        if fault or not len(which):
            return Changes(fault)
        some = np.linspace(0, len(which) - 1, min(len(which), _MOST_ENDS)).astype(int)
        which, unreturned = which[some], unreturned[some]
        depths_m = output.depths_m.ravel()[which]
        too_close = ~np.isfinite(depths_m)
        depths_m[too_close] = _TOO_NEAR_M
        ends_m = depths_m[:, None] + output.half_steps_m(depths_m)[:, None] * _PLACES
        rays = self.rays(info, rectified=is_rectified).reshape(-1, 3)[which]
        return Changes("", rays[:, None] * ends_m[:, :, None], too_close, unreturned)

    def _fits(self, info: Any, real: DepthFrame, *, rectified: bool) -> bool:
        """Tell whether a CameraInfo is of use for an image, which else passes through."""
        matrix = np.reshape(info.p if rectified else info.k, (3, -1))
        if not (info.header.frame_id and matrix[0, 0] > 0.0 and matrix[1, 1] > 0.0):
            return False
        try:
            return self.rays(info, rectified=rectified).shape[:2] == real.numbers.shape
        except ValueError:  # of another lens, or of no size
            return False


def _are_alike(one: Any, other: Any) -> bool:
    """Tell whether two CameraInfos have the same numbers, whatever their stamps are."""
    if one is other or other is None:
        return one is other
    names = ("height", "width", "distortion_model", "binning_x", "binning_y", "roi")
    plain = all(getattr(one, name) == getattr(other, name) for name in names)
    return plain and all(np.array_equal(getattr(one, k), getattr(other, k)) for k in "dkrp")


def _is_of(output: str, source: str) -> bool:
    """Tell whether an output's name is that of an input under the prefix."""
    return output.removeprefix(PREFIX) == source.lstrip("/")
