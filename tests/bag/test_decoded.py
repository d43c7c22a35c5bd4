"""What the decoder makes of a small replay written by hand: values, times, and inputs beside it."""

from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from are_ros.bag.decoded import Event, Grid, GridUpdate, Metrics, Perceived, Scene, Transforms
from are_ros.bag.marker_decoding import MarkerFields
from are_ros.bag.recording import Recording, RecordingFiles, find_recording
from are_ros.errors import InputError
from tests.checks.test_checks import INPUT_TYPES, LIVES_NS, MS, PLACES, TICKS_NS, Draft, make_draft


@pytest.fixture
def draft() -> Draft:
    """Return a replay with six ticks, two artefacts, one map, one robot and one laser."""
    return make_draft()


def as_live(files: RecordingFiles) -> RecordingFiles:
    """Return the files as those of a live recorder."""
    return RecordingFiles(files.path, files.files, files.parameters, is_replay=False)


def test_every_message_of_a_replay_becomes_a_value(draft: Draft, tmp_path: Path) -> None:
    """Outputs and inputs alike, in order of log time, which is when they count."""
    kinds: Counter[type | str] = Counter()
    with Recording(find_recording(draft.write(tmp_path))) as recording:
        assert recording.left_out == ""
        counts = {topic.name: topic.count for topic in recording.topics}
        assert counts == {topic: len(m) for topic, m in draft.messages.items()}
        last_ns = 0
        for message in recording.messages():
            value = recording.decode(message)
            kinds[getattr(value, "__msgtype__", type(value))] += 1
            assert message.at_ns == message.log_ns >= last_ns
            last_ns = message.log_ns
            if isinstance(value, list):
                assert all(isinstance(marker, MarkerFields) for marker in value)
    wanted = {Scene, Perceived, Metrics, Event, Grid, GridUpdate, Transforms, list}
    assert set(kinds) == {*wanted, "sensor_msgs/msg/LaserScan"}, "sensors stay rosbags' objects"
    assert kinds[Scene] == kinds[Perceived] == kinds[Metrics] == len(TICKS_NS)


def test_a_scene_holds_the_artefacts_as_arrays(draft: Draft, tmp_path: Path) -> None:
    """Boxes stand where the poses and the boxes' centres in F_A put them."""
    with Recording(find_recording(draft.write(tmp_path))) as recording:
        scenes = [recording.decode(m) for m in recording.messages(["/ar_builder/artefacts"])]
    scene = scenes[2]
    assert scene.ids.tolist() == [1, 2]
    assert (scene.stamp_ns, scene.frame_id, scene.labels) == (TICKS_NS[2], "map", ("crate",) * 2)
    for i, number in enumerate((1, 2)):
        x_m, y_m, yaw_rad = PLACES[number]
        np.testing.assert_allclose(scene.centres_m[i], (x_m, y_m, 0.5), atol=1e-12)
        assert scene.yaws_rad[i] == pytest.approx(yaw_rad)
        assert (scene.arrivals_ns[i], scene.departures_ns[i]) == LIVES_NS[number]
    np.testing.assert_allclose(scene.half_sizes_m, [[0.15, 0.1, 0.5]] * 2)
    assert scenes[0].is_like(scenes[1])
    assert not scenes[0].is_like(scene)


def test_live_outputs_count_at_their_stamps_and_inputs_after_a_tick(
    draft: Draft, tmp_path: Path
) -> None:
    """Whatever the log says: here everything is logged 40 ms late."""
    for topic, messages in draft.messages.items():
        draft.messages[topic] = [(log_ns + 40 * MS, message) for log_ns, message in messages]
    files = as_live(find_recording(draft.write(tmp_path)))
    with Recording(files) as recording:
        read = [*recording.messages()]
    at_ns = [m.at_ns for m in read if m.topic == "/ar_builder/artefacts"]
    assert tuple(at_ns) == TICKS_NS
    assert {m.at_ns for m in read if m.topic in INPUT_TYPES} <= set(TICKS_NS)


def test_bytes_that_are_no_such_message_are_an_input_error(draft: Draft, tmp_path: Path) -> None:
    """With topic, time and type in the sentence."""
    draft.of("events")[0] = (TICKS_NS[0], b"\0\1\0\0short")
    with Recording(find_recording(draft.write(tmp_path))) as recording:
        message = next(recording.messages(["/ar_builder/events"]))
        with pytest.raises(InputError, match=r"/ar_builder/events: .* is no are_msgs/msg/Artefac"):
            recording.decode(message)
