"""The lists of the perceived: each sighting by itself, and the events that tell of changes."""

from bisect import bisect_left
from collections import defaultdict
from collections.abc import Sequence
from itertools import chain
from typing import Final

from are_ros.bag.decoded import LOST, PERCEIVED, Event, Scene, Sighting
from are_ros.checks.record import Record
from are_ros.checks.result import CheckResult, Tally, at_s, skipped
from are_ros.checks.ticks import events_by_tick
from are_ros.parameters.choices import CameraModel
from are_ros.wording import counted

_NEXT_TICK: Final = 1.5
"""In periods: two ticks that are farther apart are not consecutive."""
_CAMERA: Final = "/camera/camera_info"
FIRST_FALSE_ALARM: Final = 1_000_000_000_000
"""Ids from here on belong to nothing that is there."""


def check_perceived(record: Record) -> CheckResult:
    """Every perceived one is alive, with more than tau pixels in a region inside the image.

    With certainty it may have departed, or be a false alarm.
    """
    name = "perceived"
    if record.parameters is None:
        return skipped(name, "nothing tells its parameters, which say tau")
    tally = Tally(name, "sighting")
    alive = {scene.at_ns: set(scene.ids.tolist()) for scene in record.scenes}
    ever = set().union(*alive.values()) if record.settings.certainty.enabled else set()
    sizes = _ImageSizes(record)
    for message in record.perceived:
        at_ns = message.at_ns
        if record.is_live and at_ns not in alive:
            tally.leave_out("message", "without a list of the living")
            continue
        if not sizes.at(at_ns):
            hint = "without its CameraInfo" if record.is_live else "without --with-inputs"
            tally.note(f"the size of the camera's image is not known {hint}")
        before = -1
        for one in message.sightings:
            tally.look()
            faults = [
                _id_fault(one.artefact_id, alive.get(at_ns, set()), ever, record),
                "is not listed in the order of ids" if one.artefact_id <= before else "",
                _sighting_fault(one, record.parameters.occlusion.tau, message.stamp_ns),
                _roi_fault(one.roi, sizes.at(at_ns, one.cameras)),
            ]
            before = one.artefact_id
            for fault in filter(None, faults):
                tally.fail(f"{at_s(at_ns)} id {one.artefact_id} {fault}")
    return tally.result()


def _id_fault(number: int, alive: set[int], ever: set[int], record: Record) -> str:
    """Check that what is perceived is there; `ever` are the ids that were, with certainty."""
    if not record.settings.certainty.enabled:
        return "" if number in alive else "is not alive"
    if number >= FIRST_FALSE_ALARM:
        has_some = record.settings.certainty.false_alarm_rate > 0.0 or record.is_live
        return "" if has_some else "is a false alarm, and there are none"
    return "" if number in ever or record.is_live else "was never alive"


def _sighting_fault(one: Sighting, tau: int, stamp_ns: int) -> str:
    """Check the numbers of one sighting."""
    visible, whole = one.visible_pixels, one.unoccluded_pixels
    if visible <= tau:
        return f"has {counted(visible, 'visible pixel')}, tau is {tau}"
    if visible > whole or abs(one.visible_fraction - visible / whole) > 1e-6:
        pixels = counted(whole, "pixel")
        return f"has {visible} of {pixels}, and the fraction {one.visible_fraction}"
    if not 0.0 <= one.existence <= 1.0 or one.range_m < 0.0:
        return f"has the existence {one.existence} and the range {one.range_m} m"
    told = [("class", one.classes, one.probabilities)]
    if one.behaviours or one.behaviour_probabilities:
        told.append(("behaviour", one.behaviours, one.behaviour_probabilities))
    for what, names, probabilities in told:
        total = sum(probabilities)
        if len(names) != len(probabilities) or abs(total - 1.0) > 1e-4:
            return f"has {what} probabilities that sum to {total:g}"
    _, _, width, height = one.roi
    if width * height < visible:
        return f"has {counted(visible, 'pixel')} in a region of {width} x {height}"
    return "was last seen in the future" if one.last_seen_ns > stamp_ns else ""


class _ImageSizes:
    """The sizes (width, height) that the cameras' images may have, by what tells them."""

    def __init__(self, record: Record) -> None:
        self._record = record
        self._times_ns = [[one.at_ns for one in some] for some in record.images.values()]
        self._by_frame = defaultdict[str, set[tuple[int, int]]](set)
        for image in chain.from_iterable(record.images.values()):
            frame = image.message.header.frame_id.lstrip("/")
            self._by_frame[frame].add((image.width, image.height))
        self._all = sorted(set().union(*self._by_frame.values()))

    def at(self, at_ns: int, cameras: Sequence[str] = ()) -> list[tuple[int, int]]:
        """Return the sizes that an image may have at a time; none where nothing tells them.

        With several cameras it is that of the first of `cameras`, the names of those that saw it.
        Of several CameraInfos, nothing tells which one is that of the only camera.
        """
        record = self._record
        camera = record.settings.camera
        if camera.others:
            own = [] if camera.model is CameraModel.AUTO else [(camera.width, camera.height)]
            return own + (sorted(self._by_frame.get(cameras[0], ())) if cameras else self._all)
        if camera.model is not CameraModel.AUTO:
            return [(camera.width, camera.height)]
        if record.is_live:  # a CameraInfo came a little before or after it was recorded
            # Those of images may be the only ones: then a default camera stands in, unless one of
            # them was remapped to be the camera's.
            is_lone = bool(self._all) and _CAMERA not in record.images
            return [*self._all, (camera.width, camera.height)] if is_lone else self._all
        if self._all:
            ends = [bisect_left(times_ns, at_ns) for times_ns in self._times_ns]
            # What is held since the look before may be in the image of the info before.
            known = zip(record.images.values(), ends, strict=True)
            last = [one for some, end in known for one in some[max(0, end - 2) : end]]
            sizes = [(one.width, one.height) for one in last]
            return sizes or [(camera.width, camera.height)]
        return [] if record.lacks_inputs else [(camera.width, camera.height)]


def _roi_fault(roi: tuple[int, int, int, int], sizes: list[tuple[int, int]]) -> str:
    x, y, width, height = roi
    if not sizes or any(x + width <= w and y + height <= h for w, h in sizes):
        return ""
    return f"has a region of {width} x {height} at {x}, {y}"


def check_sight_events(record: Record) -> CheckResult:
    """PERCEIVED and LOST tell the differences between one tick's perceived and the next one's.

    They tell of artefacts that are there, not of false alarms.
    """
    tally = Tally("sight events", "tick")
    unknown = None if record.is_live else frozenset[int]()
    seen, before = record.perceived_ids(), unknown
    for scene, events, since_ns in events_by_tick(record):
        now = seen.get(scene.at_ns, unknown)
        is_gap = record.is_live and scene.stamp_ns - since_ns > _NEXT_TICK * record.period_ns
        if now is None or before is None or is_gap or record.runs.is_fresh(scene.stamp_ns):
            tally.leave_out("tick", "after a beginning or a gap")
        else:
            tally.look()
            _compare(tally, scene, events, now, before)
        before = now
    return tally.result()


def _compare(
    tally: Tally, scene: Scene, events: list[Event], now: frozenset[int], before: frozenset[int]
) -> None:
    alive = set(scene.ids.tolist())
    for kind, text, wanted in (
        (PERCEIVED, "PERCEIVED", (now - before) & alive),
        (LOST, "LOST", (before - now) & alive),
    ):
        told = sorted(event.artefact_id for event in events if event.kind == kind)
        if told != sorted(wanted):
            told_text = f"{text} tells of the ids {told}"
            tally.fail(f"{at_s(scene.stamp_ns)} {told_text}, the lists of {sorted(wanted)}")
