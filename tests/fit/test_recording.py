"""Who counts in a recording: random arrivals within it, blocked ones too, each once."""

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pytest

from are_ros.agents.events import EventKind
from are_ros.builder.files.catalogue_file import read_catalogue
from are_ros.conventions import NS_PER_S
from are_ros.errors import BagError, InputError
from are_ros.fit.observed import ObservedRows, RowSpace, read_observed
from are_ros.population.artefact import Origin
from are_ros.population.scenario import FIRST_ADMITTED_ID
from bags.simulation.making import RosbagsFactory, make_header, make_time

CATALOGUE = read_catalogue()
SPACE = RowSpace.of(CATALOGUE)
Records = Sequence[tuple[str, int, Any]]
Person = tuple[int, int, float, Origin]
"""Id, row, second of the arrival, origin."""


def label_of(row: int) -> str:
    """Return the label of a row of the shipped catalogue."""
    return CATALOGUE.rows[row].label


class Script:
    """Writes a recording second by second."""

    def __init__(self, factory: RosbagsFactory, node: str = "/ar_builder") -> None:
        self.records: list[tuple[str, int, Any]] = []
        self._factory, self._node = factory, node

    def event(self, at_s: float, kind: EventKind, artefact_id: int, row: int) -> "Script":
        """Add an event."""
        stamp_ns = round(at_s * NS_PER_S)
        message = self._factory.make(
            "are_msgs/msg/ArtefactEvent",
            header=make_header(self._factory, "map", stamp_ns),
            kind=int(kind),
            id=artefact_id,
            label=label_of(row),
        )
        return self._add("events", stamp_ns, message)

    def array(self, at_s: float, *people: Person) -> "Script":
        """Add the ground truth of a moment."""
        stamp_ns = round(at_s * NS_PER_S)
        artefacts = [
            self._factory.make(
                "are_msgs/msg/Artefact",
                id=artefact_id,
                row=row,
                label=label_of(row),
                arrival=make_time(self._factory, round(arrival_s * NS_PER_S)),
                origin=int(origin),
            )
            for artefact_id, row, arrival_s, origin in people
        ]
        header = make_header(self._factory, "map", stamp_ns)
        message = self._factory.make(
            "are_msgs/msg/ArtefactArray", header=header, artefacts=artefacts
        )
        return self._add("artefacts", stamp_ns, message)

    def _add(self, name: str, stamp_ns: int, message: Any) -> "Script":
        self.records.append((f"{self._node}/{name}", stamp_ns, message))
        return self


@pytest.fixture
def read(
    tmp_path: Path, write_bag: Callable[[Path, Records], Path]
) -> Callable[..., tuple[dict[int, int], ObservedRows]]:
    """Return what writes records, and reads the rows that they tell of."""

    def read_records(
        records: Records, space: RowSpace = SPACE, suffix: str = ".mcap"
    ) -> tuple[dict[int, int], ObservedRows]:
        path = write_bag(tmp_path / f"run{suffix}", records)
        observed = read_observed(path, space, lambda *_: lambda _: None)
        return {k: int(n) for k, n in enumerate(observed.counts) if n}, observed

    return read_records


RANDOM, SCRIPTED, SERVICE = Origin.RANDOM, Origin.SCRIPTED, Origin.SERVICE


@pytest.mark.parametrize("suffix", [".mcap", ".db3"])
def test_arrivals_and_blocked_ones_count(factory: RosbagsFactory, read: Any, suffix: str) -> None:
    """One that came and stays, one that went at once, and one that found no place."""
    script = Script(factory)
    script.event(10.0, EventKind.ARRIVED, 1, 3).array(10.1, (1, 3, 10.0, RANDOM))
    script.event(10.15, EventKind.ARRIVED, 2, 5).event(10.18, EventKind.DEPARTED, 2, 5)
    script.array(10.2, (1, 3, 10.0, RANDOM)).event(10.3, EventKind.BLOCKED, 3, 5)
    script.event(10.4, EventKind.PERCEIVED, 1, 3)
    counts, observed = read(script.records, suffix=suffix)
    assert counts == {3: 1, 5: 2}
    assert observed.notes == ("counted: 2 arrivals, 1 blocked",)


def test_those_there_before_do_not_count(factory: RosbagsFactory, read: Any) -> None:
    """Who arrived before the recording began is left out, and that is said."""
    script = Script(factory).array(10.0, (1, 3, 4.0, RANDOM), (2, 4, 10.0, RANDOM))
    script.array(10.1, (1, 3, 4.0, RANDOM), (2, 4, 10.0, RANDOM))
    script.event(10.2, EventKind.ARRIVED, 3, 7)
    counts, observed = read(script.records)
    assert counts == {4: 1, 7: 1}
    assert observed.notes == (
        "counted: 1 arrivals, 0 blocked, 1 that came within the recording without an event",
        "left out: 1 there before the recording began",
    )


def test_scripted_and_requested_ones_are_left_out(factory: RosbagsFactory, read: Any) -> None:
    """By the origin in the ground truth; without it, and where blocked, by their high ids."""
    high = FIRST_ADMITTED_ID
    script = Script(factory).event(10.0, EventKind.ARRIVED, high, 3)
    script.event(10.0, EventKind.ARRIVED, 5, 3).event(10.0, EventKind.ARRIVED, 1, 8)
    script.array(10.1, (1, 8, 10.0, RANDOM), (5, 3, 10.0, SCRIPTED), (high, 3, 10.0, SERVICE))
    script.array(10.2, (high + 2, 3, 10.15, SCRIPTED))
    script.event(10.3, EventKind.ARRIVED, high + 1, 3).event(10.4, EventKind.BLOCKED, high + 3, 3)
    script.event(10.5, EventKind.BLOCKED, 0, 3)
    counts, observed = read(script.records)
    assert counts == {8: 1}
    assert observed.notes[1] == "left out: 6 scripted or asked for"


def test_a_scenario_with_ids_of_its_own_does_not_count(factory: RosbagsFactory, read: Any) -> None:
    """Where a scripted artefact has a low id, so have those that no ground truth shows."""
    script, other = Script(factory), Script(factory, "/second/ar_builder")
    script.event(10.0, EventKind.BLOCKED, 2, 5).array(10.1, (1, 8, 10.0, SCRIPTED))
    other.event(10.0, EventKind.BLOCKED, 2, 5)
    counts, observed = read([*script.records, *other.records])
    assert counts == {5: 1}
    assert observed.notes[1] == "left out: 2 scripted or asked for"


def test_a_node_begun_anew_and_a_second_node_count_anew(factory: RosbagsFactory, read: Any) -> None:
    """The same id at another time, or of another node, is another artefact; once told twice not."""
    script, other = Script(factory), Script(factory, "/second/ar_builder")
    script.event(10.0, EventKind.ARRIVED, 1, 3).event(10.0, EventKind.ARRIVED, 1, 3)
    script.event(20.0, EventKind.ARRIVED, 1, 4)
    other.event(20.0, EventKind.ARRIVED, 1, 4)
    assert read([*script.records, *other.records])[0] == {3: 1, 4: 2}


def test_without_events_the_ground_truth_counts(factory: RosbagsFactory, read: Any) -> None:
    """That blocked ones and the shortest lives lack is said."""
    script = Script(factory).array(10.0).array(10.1, (1, 3, 10.05, RANDOM))
    counts, observed = read(script.records)
    assert counts == {3: 1}
    assert "no events were recorded" in observed.notes[-1]


def test_without_a_catalogue_labels_are_known_from_the_ground_truth(
    factory: RosbagsFactory, read: Any
) -> None:
    """The row of a label is that which any artefact of the label had."""
    script = Script(factory).array(10.0, (1, 3, 4.0, RANDOM)).event(10.2, EventKind.BLOCKED, 3, 3)
    assert read(script.records, RowSpace(42))[0] == {3: 1}


def test_a_label_that_nobody_knows_is_refused(factory: RosbagsFactory, read: Any) -> None:
    """Neither ground truth nor catalogue has it: the sentence names both, and the label."""
    records = Script(factory).event(10.2, EventKind.BLOCKED, 3, 3).records
    with pytest.raises(InputError, match=rf"run\.mcap: events: the row of '{label_of(3)}'"):
        read(records, RowSpace(42))


def test_a_recording_with_another_catalogue_is_refused(factory: RosbagsFactory, read: Any) -> None:
    """A row that the catalogue gives another label, and one beyond its rows, are named."""
    records = Script(factory).array(10.0, (1, 3, 10.0, RANDOM)).records
    records[0][2].artefacts[0].row = 4
    with pytest.raises(InputError, match=f"{label_of(3)} is row 4, not so in the catalogue"):
        read(records)


def test_rows_beyond_are_refused(factory: RosbagsFactory, read: Any) -> None:
    """The recording knows more rows than were said to be."""
    records = Script(factory).array(10.0, (1, 30, 10.0, RANDOM)).records
    with pytest.raises(InputError, match=r"row 30 \(.*\) is beyond the 20 rows"):
        read(records, RowSpace(20))


def test_a_recording_without_artefacts_is_refused(sample_bag: Path) -> None:
    """The robot's own recording has no rows to learn from."""
    with pytest.raises(BagError, match="neither events nor artefacts"):
        read_observed(sample_bag, SPACE, lambda *_: lambda _: None)


def test_a_replay_counts_what_its_metrics_say(sample_replay: Path) -> None:
    """Arrivals and blocked ones of the folder of a replay are those of metrics.json."""
    told: list[int] = []
    observed = read_observed(sample_replay, SPACE, lambda *_: told.append)
    metrics = json.loads((sample_replay / "metrics.json").read_text(encoding="utf-8"))
    assert observed.counts.sum() == metrics["arrivals"] + metrics["blocked"] > 5
    assert told == sorted(told)
    assert len(told) > 80
