"""Ticks: each gives out its lists and counts, stamped alike, at its time, in the world frame."""

from itertools import pairwise
from statistics import median
from typing import Any, Final

from are_ros.bag.recording import PREFIX
from are_ros.conventions import NS_PER_S
from are_ros.replay._check_record import Record
from are_ros.replay._check_result import CheckResult, Tally, at_s
from are_ros.replay._check_scene import Scene, time_ns

_OTHER_CLOCK_NS: Final = 10 * NS_PER_S
"""Farther apart, log times and stamps are of two clocks."""


def check_ticks(record: Record) -> CheckResult:
    """Every tick has its artefacts, perceived and metrics, stamped alike, in the world frame."""
    tally = Tally("ticks", "tick")
    for scene in record.scenes:
        tally.look()
        _check_scene(tally, record, scene)
    for before, after in pairwise(record.scenes):
        if after.stamp_ns <= before.stamp_ns:
            tally.fail(f"{at_s(after.stamp_ns)} does not follow {at_s(before.stamp_ns)}")
    for name, messages in (("perceived", record.perceived), ("metrics", record.metrics)):
        if record.is_live and PREFIX + name not in record.topics:
            tally.note(f"without ~/{name}, which was not recorded")
        else:
            _check_stamps(tally, name, messages, record)
    if record.lags_ns:
        tally.note(_lag_text(record.lags_ns))
    return tally.result()


def _check_scene(tally: Tally, record: Record, scene: Scene) -> None:
    where, ids = at_s(scene.stamp_ns), scene.ids.tolist()
    if scene.stamp_ns != scene.log_ns:
        tally.fail(f"the artefacts logged {at_s(scene.log_ns)} are {where}")
    tally.require(all(a < b for a, b in pairwise(ids)), f"{where} ids do not ascend: {ids}")
    tally.require(scene.frame_id == record.world_frame, f"{where} the frame is '{scene.frame_id}'")
    if record.parameters is not None and scene.stamp_ns % record.period_ns:
        tally.fail(f"{where} there is no tick, they are {record.period_ns} ns apart")
    if scene.problems:
        tally.fail(f"{where} {scene.problems[0]}")


def _check_stamps(tally: Tally, name: str, messages: list[tuple[int, Any]], record: Record) -> None:
    """Compare with the lists, but near the ends of what a live recording holds without a gap."""
    ticks = {scene.log_ns for scene in record.scenes if not record.runs.is_edge(scene.log_ns)}
    given = {log_ns for log_ns, _ in messages if not record.runs.is_edge(log_ns)}
    if ticks != given:
        where = at_s(min(ticks ^ given))
        tally.fail(f"~/{name} and ~/artefacts differ {where}: one of them has no message")
    times = [log_ns for log_ns, _ in messages]
    if any(a >= b for a, b in pairwise(times)):
        tally.fail(f"~/{name} comes twice at a time, or goes back")
    for log_ns, message in messages:
        header = message.header
        if time_ns(header.stamp) != log_ns or header.frame_id != record.world_frame:
            stamp_ns = time_ns(header.stamp)
            text = f"~/{name} {at_s(log_ns)} is stamped {at_s(stamp_ns)} in '{header.frame_id}'"
            tally.fail(text)


def _lag_text(lags_ns: list[int]) -> str:
    """Say how late the recorder received the ticks."""
    middle_ns = median(lags_ns)
    if abs(middle_ns) > _OTHER_CLOCK_NS:
        return "logged by another clock than that of their stamps"
    most = max(lags_ns, key=abs)
    delays = f"{middle_ns / 1e6:.0f} ms after their time in the median, {most / 1e6:.0f} at most"
    return f"logged {delays}"
