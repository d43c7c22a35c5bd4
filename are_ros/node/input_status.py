"""What the diagnostics say of an input."""

from typing import Final

from are_ros.node.snapshot import InputSnapshot
from are_ros.node.status import Level, Status, figure
from are_ros.wording import counted

GRACE_S: Final = 5.0
"""For so long after activation nothing that is missing is an error."""
_STALE_PERIODS: Final = 5.0
_STALE_S: Final = 1.0


def input_status(entry: InputSnapshot, active_s: float) -> Status:
    """Return the status of an input of a node that has been active for `active_s`."""
    level, message = _verdict(entry, active_s)
    figures = entry.figures
    values = {
        "topic": entry.topic,
        "publishers": str(entry.publishers),
        "messages": str(figures.count),
        "refused": str(figures.refused),
        "rate": figure(figures.rate_hz, "Hz"),
        "age": figure(figures.age_s, "s"),
        "last refusal": figures.last_refusal or "-",
    }
    return Status(level, f"inputs/{entry.role}", message, values)


def _verdict(entry: InputSnapshot, active_s: float) -> tuple[Level, str]:
    figures = entry.figures
    if figures.age_s is None:
        return _nothing_yet(entry, active_s)
    if _is_stale(entry):
        rate = figure(figures.rate_hz, "Hz")
        age = figure(figures.age_s, "s")
        return Level.STALE, f"it has stopped: it came at {rate}, and the last one is {age} old"
    if entry.is_required and figures.refused == figures.count:
        refused = counted(figures.count, "message")
        return Level.ERROR, f"{refused}, none of use; the last: {figures.last_refusal}"
    if figures.refused_lately:
        refused = counted(figures.refused_lately, "message")
        return Level.WARN, f"{refused} refused in the last 10 s; the last: {figures.last_refusal}"
    if entry.is_latched or figures.rate_hz is None:
        received = counted(figures.count, "message")
        return Level.OK, f"{received}, the last {figure(figures.age_s, 's')} ago"
    return Level.OK, figure(figures.rate_hz, "Hz")


def _nothing_yet(entry: InputSnapshot, active_s: float) -> tuple[Level, str]:
    if not entry.is_required:
        return Level.OK, "no message yet; the node works without"
    if active_s < GRACE_S:
        return Level.OK, "no message yet"
    if not entry.publishers:
        return Level.ERROR, f"no message for {active_s:.0f} s: nobody publishes {entry.topic}"
    reason = f"{entry.topic} has {counted(entry.publishers, 'publisher')}; is its QoS compatible?"
    return Level.ERROR, f"no message for {active_s:.0f} s, though {reason}"


def _is_stale(entry: InputSnapshot) -> bool:
    age_s, period_s = entry.figures.age_s, entry.figures.period_s
    if entry.is_latched or age_s is None or period_s is None:
        return False
    return age_s > _STALE_S and age_s > _STALE_PERIODS * period_s
