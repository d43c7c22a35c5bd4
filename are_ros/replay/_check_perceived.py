"""What is perceived: members of A_f are alive, were seen by enough pixels, inside the image."""

from typing import Any, Final

from are_ros.parameters.choices import CameraModel
from are_ros.replay._check_lives import LOST, PERCEIVED, events_by_tick
from are_ros.replay._check_record import Record
from are_ros.replay._check_result import CheckResult, Tally, at_s, skipped
from are_ros.replay._check_scene import Scene, time_ns
from are_ros.wording import counted

_NEXT_TICK: Final = 1.5
"""In periods: what is farther apart is not one tick and the next."""


def check_perceived(record: Record) -> CheckResult:
    """Every member is alive and has more than tau pixels, in a region inside the image."""
    name = "perceived"
    if record.parameters is None:
        return skipped(name, "there is no effective.yaml, which says tau")
    tally = Tally(name, "sighting")
    alive = {scene.log_ns: set(scene.ids.tolist()) for scene in record.scenes}
    for log_ns, message in record.perceived:
        if record.is_live and log_ns not in alive:
            tally.leave_out("message", "without a list of the living")
            continue
        sizes = _image_sizes(record, log_ns)
        if not sizes:
            hint = "without its CameraInfo" if record.is_live else "without --with-inputs"
            tally.note(f"the size of the camera's image is not known {hint}")
        before = -1
        for one in message.artefacts:
            tally.look()
            faults = [
                "is not alive" if int(one.id) not in alive.get(log_ns, ()) else "",
                "is not listed in the order of ids" if int(one.id) <= before else "",
                _sighting_fault(one, record.parameters.occlusion.tau, log_ns),
                _roi_fault(one.roi, sizes),
            ]
            before = int(one.id)
            for fault in filter(None, faults):
                tally.fail(f"{at_s(log_ns)} id {one.id} {fault}")
    return tally.result()


def check_sight_events(record: Record) -> CheckResult:
    """PERCEIVED and LOST tell the differences between one tick's members and the next one's."""
    tally = Tally("sight events", "tick")
    unknown = None if record.is_live else frozenset[int]()
    seen, before = record.perceived_ids(), unknown
    for scene, events, since_ns in events_by_tick(record):
        now = seen.get(scene.log_ns, unknown)
        is_gap = record.is_live and scene.stamp_ns - since_ns > _NEXT_TICK * record.period_ns
        if now is None or before is None or is_gap or record.runs.is_fresh(scene.stamp_ns):
            tally.leave_out("tick", "after a beginning or a gap")
        else:
            tally.look()
            _compare(tally, scene, events, now, before)
        before = now
    return tally.result()


def _compare(
    tally: Tally, scene: Scene, events: list[Any], now: frozenset[int], before: frozenset[int]
) -> None:
    alive = set(scene.ids.tolist())
    for kind, text, wanted in (
        (PERCEIVED, "PERCEIVED", now - before),
        (LOST, "LOST", (before - now) & alive),
    ):
        told = sorted(int(event.id) for event in events if event.kind == kind)
        if told != sorted(wanted):
            told_text = f"{text} tells of the ids {told}"
            tally.fail(f"{at_s(scene.stamp_ns)} {told_text}, the lists of {sorted(wanted)}")


def _sighting_fault(one: Any, tau: int, log_ns: int) -> str:
    """Check the numbers of one sighting."""
    visible, whole = int(one.visible_pixels), int(one.unoccluded_pixels)
    if visible <= tau:
        return f"has {counted(visible, 'visible pixel')}, tau is {tau}"
    if visible > whole or abs(one.visible_fraction - visible / whole) > 1e-6:
        return (
            f"has {visible} of {counted(whole, 'pixel')}, and the fraction {one.visible_fraction}"
        )
    if not 0.0 <= one.existence <= 1.0 or one.range < 0.0:
        return f"has the existence {one.existence} and the range {one.range} m"
    if len(one.classes) != len(one.probabilities) or abs(sum(one.probabilities) - 1.0) > 1e-4:
        return f"has class probabilities that sum to {sum(one.probabilities)}"
    if one.roi.width * one.roi.height < visible:
        return f"has {counted(visible, 'pixel')} in a region of {one.roi.width} x {one.roi.height}"
    return "was last seen in the future" if time_ns(one.last_seen) > log_ns else ""


def _image_sizes(record: Record, log_ns: int) -> list[tuple[int, int]]:
    """Return the sizes (width, height) that the image may have; none where nothing tells them."""
    camera = record.settings.camera
    if camera.model is not CameraModel.AUTO:
        return [(camera.width, camera.height)]
    if record.is_live:  # a CameraInfo came a little before or after it was recorded
        return sorted({(width, height) for _, width, height in record.camera_sizes})
    if record.camera_sizes:
        known = [(w, h) for since_ns, w, h in record.camera_sizes if since_ns < log_ns]
        # What is held since the look before may be in the image of the info before.
        return known[-2:] or [(camera.width, camera.height)]
    return [(camera.width, camera.height)] if record.has_inputs() else []


def _roi_fault(roi: Any, sizes: list[tuple[int, int]]) -> str:
    right, bottom = roi.x_offset + roi.width, roi.y_offset + roi.height
    if not sizes or any(right <= width and bottom <= height for width, height in sizes):
        return ""
    return f"has a region of {roi.width} x {roi.height} at {roi.x_offset}, {roi.y_offset}"
