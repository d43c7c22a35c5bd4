"""What publishers offer (quality of service), as rosbag2 writes it beside a recorded topic."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from are_ros.conventions import NS_PER_S

FOREVER_NS: Final = 2**63 - 1
"""A deadline, lifespan or lease that never ends, in the middleware and in recordings."""

_PROFILE = """\
- history: {history}
  depth: {depth}
  reliability: {reliability}
  durability: {durability}
  deadline: {deadline}
  lifespan: {lifespan}
  liveliness: {liveliness}
  liveliness_lease_duration: {lease}
  avoid_ros_namespace_conventions: false
"""


@dataclass(frozen=True)
class OfferedQos:
    """The profile of one publisher, in the words of rosbag2; times in nanoseconds.

    What the network does not tell is "unknown": DDS announces neither history nor depth (0).
    """

    reliability: str = "reliable"
    durability: str = "volatile"
    history: str = "keep_last"
    depth: int = 10
    deadline_ns: int = FOREVER_NS
    lifespan_ns: int = FOREVER_NS
    liveliness: str = "automatic"
    lease_ns: int = FOREVER_NS


def qos_text(profiles: Sequence[OfferedQos]) -> str:
    """Return the YAML list of profiles, one for each publisher."""
    return "".join(_profile_text(profile) for profile in profiles)


def _profile_text(profile: OfferedQos) -> str:
    return _PROFILE.format(
        history=profile.history,
        depth=profile.depth,
        reliability=profile.reliability,
        durability=profile.durability,
        deadline=_duration_text(profile.deadline_ns),
        lifespan=_duration_text(profile.lifespan_ns),
        liveliness=profile.liveliness,
        lease=_duration_text(profile.lease_ns),
    )


def _duration_text(duration_ns: int) -> str:
    seconds, rest_ns = divmod(duration_ns, NS_PER_S)
    return f"{{sec: {seconds}, nsec: {rest_ns}}}"
