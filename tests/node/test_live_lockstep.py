"""Live and replay: the same recording gives the same bytes, however the clock of the node steps."""

from collections import defaultdict
from collections.abc import Container, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from are_ros.bag.reader import BagReader
from are_ros.bag.roles import RolesFound, find_roles
from are_ros.builder.assembly import catalogue_of
from are_ros.builder.tick import Demand
from are_ros.messages.feed import RawMessage
from are_ros.node.live_builder import LiveBuilder
from are_ros.parameters.declaration import with_values
from are_ros.parameters.model import Parameters
from are_ros.parameters.ros_yaml import read_ros_parameters
from are_ros.replay.output_folder import AUGMENTED
from are_ros.replay.session import run_replay
from are_ros.replay.timeline import ReplayOptions

BAGS = Path(__file__).resolve().parents[2] / "bags"
ROLES = (
    "map",
    "octomap_point_cloud_centers",
    "odom",
    "scan",
    "camera/camera_info",
    "image",
    "depth",
    "tf",
    "tf_static",
)
Outputs = dict[str, list[bytes]]


class NothingWaits:
    """The inbox in lockstep: by /clock, and empty when the time goes on."""

    def waiting(self, roles: Container[str]) -> Iterator[RawMessage]:  # noqa: ARG002
        """Give out nothing."""
        return iter(())

    def is_time_simulated(self) -> bool:
        """Tell that it is."""
        return True


@dataclass
class Everything:
    """Wants all outputs, and keeps the bytes of their messages."""

    sent: Outputs = field(default_factory=lambda: defaultdict(list))

    def wanted(self) -> Container[str]:
        """Return a container of whatever name."""
        return self

    def __contains__(self, name: object) -> bool:
        """Say yes."""
        return True

    def publish(self, name: str, data: bytes) -> None:
        """Keep a message."""
        self.sent[name].append(bytes(data))


@pytest.fixture(scope="module")
def parameters() -> Parameters:
    """Return those of the sample, with what live and replay must have in common."""
    values = read_ros_parameters(BAGS / "sample_office.yaml")
    return with_values(Parameters(), {**values, "collisions.on_robot_contact": "displace"})


@pytest.fixture(scope="module")
def replayed(parameters: Parameters, tmp_path_factory: pytest.TempPathFactory) -> Outputs:
    """Return what `are replay` writes of the sample, by output."""
    bag, out = BAGS / "sample_office.mcap", tmp_path_factory.mktemp("replay")
    options = ReplayOptions((bag,), parameters, out=out, demand=Demand(octomap=True))
    run_replay(options, lambda _: None, lambda _begin, _end: lambda _now: None)
    outputs: Outputs = defaultdict(list)
    with BagReader([out / AUGMENTED]) as reader:
        for message in reader.messages():
            outputs[message.topic.removeprefix("/ar_builder/")].append(bytes(message.data))
    return outputs


@pytest.mark.parametrize("step_ms", [10, 50])
def test_live_gives_the_bytes_of_the_replay(
    parameters: Parameters, replayed: Outputs, step_ms: int
) -> None:
    """Every message of every output, with clocks of 100 Hz and of 20 Hz."""
    sent = lived(parameters, step_ms * 1_000_000)
    assert sent.keys() == replayed.keys()
    assert len(replayed["events"]) > 20
    assert len(replayed["augmented_map"]) > 5
    for name, messages in replayed.items():
        assert sent[name] == messages[: len(sent[name])], name
        left_at_the_end = 1 if name == "scan" else 0
        assert len(messages) - len(sent[name]) <= left_at_the_end, name


def lived(parameters: Parameters, step_ns: int) -> Outputs:
    """Return what the live builder sends when the recording comes in by a clock of steps.

    What was recorded before a step has come when the clock reaches it, as in lockstep.
    """
    outlet = Everything()
    with BagReader([BAGS / "sample_office.mcap"]) as reader:
        roles = find_roles(reader.topics, {})
        role_of_topic = roles_of(roles)
        catalogue = catalogue_of(parameters)
        live = LiveBuilder(
            parameters, catalogue, reader, role_of_topic, NothingWaits(), outlet, refuse_nothing
        )
        live.resume(0)
        now_ns = reader.start_ns
        next_ns = (now_ns // step_ns + 1) * step_ns
        live.work(now_ns)
        for message in reader.messages(list(role_of_topic)):
            while next_ns <= message.log_time_ns:
                now_ns, next_ns = next_ns, next_ns + step_ns
                live.work(now_ns)
            if live.store(message, now_ns):
                live.work(now_ns)
        while next_ns < reader.end_ns:
            live.work(next_ns)
            next_ns += step_ns
    return outlet.sent


def roles_of(roles: RolesFound) -> dict[str, str]:
    """Return the role of each topic that the node would listen to."""
    found = {roles.topic(role): role for role in ROLES}
    return {topic: role for topic, role in found.items() if topic is not None}


def refuse_nothing(topic: str, sentence: str) -> None:
    """Fail: the sample is well formed."""
    pytest.fail(f"{topic}: {sentence}")
