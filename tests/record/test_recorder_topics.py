"""Which topics a recorder takes, and how it follows their publishers."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

from are_ros.bag.types import InstalledTypes
from are_ros.bag.writer import OfferedQos
from are_ros.errors import BagError
from are_ros.record.topics import RecordOptions

STRING, BOOL = "std_msgs/msg/String", "std_msgs/msg/Bool"
LATCHED = OfferedQos(durability="transient_local")
BEST_EFFORT = OfferedQos(reliability="best_effort")


def test_all_but_hidden_topics_are_selected() -> None:
    """A part of the name that begins with an underscore hides a topic."""
    options = RecordOptions(Path("x.mcap"))
    names = ("/scan", "/a_b/c_", "/_private", "/walk/_action/feedback")
    assert [options.is_selected(name) for name in names] == [True, True, False, False]


def test_names_and_patterns_select() -> None:
    """The slash in front may be left out; exclusion goes before."""
    options = RecordOptions(
        Path("x.mcap"), topics=("scan", "/camera/*"), exclude=("camera/*/compressed",)
    )
    names = ("/scan", "/scan2", "/camera/image", "/camera/image/compressed")
    assert [options.is_selected(name) for name in names] == [True, False, True, False]
    assert options.named_topics() == ("/scan",)


def test_patterns_select_no_hidden_topics() -> None:
    """Only the whole name of one does: /robot1/* is to be what its node tells."""
    options = RecordOptions(Path("x.mcap"), topics=("/robot1/*", "walk/_action/feedback"))
    names = ("/robot1/map", "/robot1/_alive", "/walk/_action/feedback", "/walk/_action/status")
    assert [options.is_selected(name) for name in names] == [True, False, True, False]


def test_what_is_not_recorded_is_not_awaited() -> None:
    """It would be waited for in vain."""
    options = RecordOptions(Path("x.mcap"), topics=("/scan",), wait_for=("map",))
    with pytest.raises(BagError, match="/map is waited for, but it is not among the topics"):
        options.awaited_topics()


def test_places_that_cannot_be_are_said(tmp_path: Path) -> None:
    """Another kind of file, one that is there, a file on the way, the rest of a killed recorder."""
    (tmp_path / "notes.txt").write_text("x")
    (tmp_path / "there.mcap").write_text("x")
    (tmp_path / "killed.mcap.part").write_text("x")
    sentences = {
        "bag.db3": "a recording is an .mcap file",
        "there.mcap": r"there\.mcap exists already",
        "notes.txt/x.mcap": r"notes\.txt: the folder cannot be made: it is a file",
        "killed.mcap": r"killed\.mcap\.part is there: a recording that still runs, or was killed",
    }
    for name, sentence in sentences.items():
        with pytest.raises(BagError, match=sentence):
            RecordOptions(tmp_path / name).prepare_place()
    (tmp_path / "folder.mcap").mkdir()
    with pytest.raises(BagError, match=r"folder\.mcap is a folder; choose another name"):
        RecordOptions(tmp_path / "folder.mcap", overwrite=True).prepare_place()
    RecordOptions(tmp_path / "killed.mcap", overwrite=True).prepare_place()
    RecordOptions(tmp_path / "new/deep/x.mcap").prepare_place()
    assert (tmp_path / "new/deep").is_dir()


def topic(*offered: OfferedQos, types: tuple[str, ...] = (STRING,)) -> Any:
    """Return /x as the graph shows it."""
    from are_ros.record.topics import PublishedTopic

    publishers = tuple(bytes([number]) for number in range(len(offered)))
    return PublishedTopic("/x", types, offered, publishers)


@dataclass
class Scene:
    """A follower whose graph is a script, and what it did."""

    graph: list[tuple[Any, bool]] = field(default_factory=list)
    subscribed: list[tuple[str, str]] = field(default_factory=list)
    announced: list[tuple[str, tuple[OfferedQos, ...]]] = field(default_factory=list)
    sentences: list[str] = field(default_factory=list)
    follower: Any = None

    def look(self) -> Iterator[tuple[Any, bool]]:
        """Stand in for the graph's watch."""
        yield from self.graph

    def publishers_found(self, *_: object, are_the_same: bool) -> None:
        """Stand in for the inbox; the count of losses has its own tests."""

    def subscribe(self, _: str, message_class: type[Any], profile: Any) -> None:
        """Stand in for the inbox."""
        reliability, durability = profile.reliability.name, profile.durability.name
        self.subscribed.append((message_class.__name__, f"{reliability} {durability}"))

    def announce(self, _: str, type_name: str, offered: tuple[OfferedQos, ...]) -> None:
        """Stand in for the file."""
        self.announced.append((type_name, offered))

    def see(self, seen: Any) -> None:
        """Let the follower find /x new or changed."""
        self.graph = [(seen, True)]
        self.follower.look()


@pytest.fixture
def scene(ros_available: None, monkeypatch: pytest.MonkeyPatch) -> Scene:  # noqa: ARG001
    """Return a follower of all topics."""
    from are_ros.record import topics as topic_follower

    scene: Any = Scene()
    monkeypatch.setattr(topic_follower, "TopicGraph", lambda *_: scene)
    scene.follower = topic_follower.TopicFollower(
        None,  # the graph is scripted
        RecordOptions(Path("x.mcap")),
        InstalledTypes(),
        scene,
        scene,
        scene.sentences.append,
    )
    return scene  # type: ignore[no-any-return]  # it was Any, to stand in for three classes


def test_the_subscription_asks_for_what_all_publishers_offer(scene: Scene) -> None:
    """Reliable, and transient local, only while each of them is; the file tells each profile."""
    scene.see(topic(LATCHED))
    scene.see(topic(LATCHED, LATCHED))
    scene.see(topic(LATCHED, OfferedQos()))
    scene.see(topic(LATCHED, BEST_EFFORT))
    assert scene.subscribed == [
        ("String", "RELIABLE TRANSIENT_LOCAL"),
        ("String", "RELIABLE VOLATILE"),
        ("String", "BEST_EFFORT VOLATILE"),
    ]
    assert scene.announced[-1] == (STRING, (LATCHED, BEST_EFFORT))
    assert scene.sentences == []


def test_a_topic_of_two_types_is_not_recorded(scene: Scene) -> None:
    """It is said once, also if its publishers change."""
    for _ in range(2):
        scene.see(topic(LATCHED, types=(BOOL, STRING)))
    reason = f"it is published as {BOOL} and as {STRING}"
    assert scene.follower.skipped == {"/x": reason}
    assert scene.sentences == [f"/x is not recorded: {reason}"]
    assert (scene.subscribed, scene.announced) == ([], [])


def test_a_second_type_that_comes_later_is_left_out(scene: Scene) -> None:
    """What is recorded goes on, and the other type is said once."""
    scene.see(topic(LATCHED))
    for _ in range(2):
        scene.see(topic(LATCHED, OfferedQos(), types=(BOOL, STRING)))
    assert scene.sentences == [f"/x is also published as {BOOL}: only {STRING} is recorded"]
    assert {name for name, _ in scene.subscribed} == {"String"}
