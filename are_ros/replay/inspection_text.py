"""What `are inspect` prints."""

from are_ros.conventions import NS_PER_S
from are_ros.description._tables import aligned, section
from are_ros.replay.inspection import InspectedTopic, Inspection
from are_ros.replay.roles import ROLE_TYPES
from are_ros.wording import counted


def inspection_lines(inspection: Inspection) -> list[str]:
    """Return topics, roles, frames and what is missing, as lines of aligned text."""
    duration_s = (inspection.end_ns - inspection.start_ns) / NS_PER_S
    topics = [_topic_cells(entry) for entry in inspection.topics]
    roles = [(role, _players(inspection, role)) for role in ROLE_TYPES]
    missing = inspection.missing or ("nothing: it can be replayed as it is",)
    count = sum(entry.topic.count for entry in inspection.topics)
    return [
        f"{duration_s:.1f} s, {counted(count, 'message')}",
        *section("topics", aligned(topics, numbers=(2, 3))),
        *section("roles", [*aligned(roles), *inspection.roles.sentences()]),
        *section("frames", [*inspection.frames.tree_lines(), *inspection.frames.oddities]),
        *section("time", list(inspection.time or ("stamps and times of recording agree",))),
        *section("missing", list(missing)),
    ]


def _players(inspection: Inspection, role: str) -> str:
    """Return the topics of a role: several only of scans."""
    if role == "scan" and inspection.scans:
        return ", ".join(inspection.scans)
    return inspection.roles.topic(role) or "-"


def _topic_cells(entry: InspectedTopic) -> tuple[str, ...]:
    topic = entry.topic
    return (
        topic.name,
        topic.type_name,
        str(topic.count),
        _rate_text(entry),
        entry.frame_id,
        "latched" if topic.is_latched else "",
    )


def _rate_text(entry: InspectedTopic) -> str:
    """Return the mean rate, of which a single message has none."""
    if entry.topic.count <= 1:
        return "once" if entry.topic.count else ""
    return f"{entry.rate_hz:.1f} Hz" if entry.rate_hz >= 0.05 else f"{entry.rate_hz:.1g} Hz"
