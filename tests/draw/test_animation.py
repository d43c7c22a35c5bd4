"""Tests of the animation of a run from above."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest
from PIL import Image

from are_ros.agents.events import EventKind
from are_ros.conventions import NS_PER_S
from are_ros.draw.animation import (
    HEADER_PX,
    ROW_PX,
    Animation,
    Frames,
    draw_legend,
    shown_stamps,
    write_animation,
)
from are_ros.draw.canvas import Canvas
from are_ros.draw.scene import Doing, SceneRecord
from are_ros.draw.sheet import Entry, patch_sign
from are_ros.errors import BagError
from are_ros.replay.output_folder import animation_path
from tests.draw.made_runs import TICK_NS, event, hall, run, texts_written, walker

Picture = npt.NDArray[np.uint8]
PERSON = (0xD1, 0x49, 0x5B)
ALL = tuple(range(100))
ROBOT_WAY = tuple((1.0 + 0.02 * i, 1.0, 0.0) for i in range(100))


def _film(record: SceneRecord, path: Path, most_bytes: int = 10_000_000) -> Animation:
    told: list[int] = []
    film = write_animation(
        record,
        hall(),
        path,
        lambda _start, _end: told.append,
        occupied_threshold=65,
        most_bytes=most_bytes,
    )
    assert told[-1] == int(record.series.stamps_ns[-1]) + 1 or told[-1] > told[0]
    return film


def _scene(record: SceneRecord) -> Frames:
    return Frames(record, hall(), 65)


def _at(scene: Frames, picture: Picture, point: tuple[float, float]) -> tuple[int, ...]:
    x, y = np.floor(scene.view.pixels(point)).astype(int).tolist()
    return tuple(picture[y, x].tolist())


def _apart(one: Sequence[int], other: Sequence[int]) -> int:
    return max(abs(a - b) for a, b in zip(one, other, strict=True))


def test_an_animation_decodes_to_what_was_drawn(tmp_path: Path) -> None:
    """As many pictures as were made, of their size and nearly their colours, shown for 0.1 s."""
    record = run([walker(1, (2, 2), (8, 6), seen=ALL[30:60])], way=ROBOT_WAY)
    film = _film(record, tmp_path / "a.gif")
    stamps, speed = shown_stamps(record)
    assert (film.pictures, film.speed, speed) == (len(stamps), 3.0, 3.0)
    scene = _scene(record)
    with Image.open(film.path) as image:
        assert (image.n_frames, image.size) == (len(stamps), film.size_px)
        for number, stamp_ns in enumerate(stamps):
            image.seek(number)
            shown = np.asarray(image.convert("RGB")).astype(np.int16)
            apart = np.abs(shown - scene.picture(stamp_ns)).max(axis=2)
            assert np.percentile(apart, 99) <= 8
            assert (apart > 40).mean() < 0.001
            image.load()
            assert image.info["duration"] == 100
    assert film.length_bytes == film.path.stat().st_size < 300_000


def test_same_bytes(tmp_path: Path) -> None:
    """The same record gives the same bytes."""
    record = run([walker(1, (2, 2), (8, 6), seen=ALL[30:60])], way=ROBOT_WAY)
    first, second = (_film(record, tmp_path / f"{i}.gif").path for i in range(2))
    assert first.read_bytes() == second.read_bytes()


def test_who_is_perceived_is_opaque_and_who_is_not_translucent() -> None:
    """The same footprint is in the colour of its class while perceived, else lets the floor by."""
    scene = _scene(run([walker(1, (5, 2), (5, 2.1), seen=ALL[50:])]))
    before, after = (scene.picture(TICK_NS * (1 + tick)) for tick in (40, 60))
    spot = (5.1, 1.95)  # beside the line to its front
    assert _apart(_at(scene, after, spot), PERSON) <= 2
    assert _apart(_at(scene, before, spot), PERSON) > 60
    assert _apart(_at(scene, before, spot), (252, 252, 251)) > 8


def test_a_tail_is_where_it_was_and_fades() -> None:
    """Behind a walker the floor is tinted, the less the longer ago; before it, it is not."""
    scene = _scene(run([walker(1, (1, 5), (9, 5), seen=ALL)]))
    picture = scene.picture(TICK_NS * 81)
    floor = (252, 252, 251)
    tints = [_apart(_at(scene, picture, (x, 5.0)), floor) for x in (4.8, 6.0, 6.9, 8.6)]
    assert tints[0] < tints[1] < tints[2]
    assert tints[0] > 10
    assert tints[3] == 0


def test_a_jump_leaves_no_tail() -> None:
    """Between the places before and after a displacement nothing is drawn."""
    life = walker(1, (2, 5), (2.1, 5))
    poses = life.footprints.poses.copy()
    poses[50:, 0] += 5.0
    life.footprints.__dict__["poses"] = poses
    scene = _scene(run([life]))
    picture = scene.picture(TICK_NS * 55)
    assert _apart(_at(scene, picture, (4.5, 5.0)), (252, 252, 251)) == 0


def test_the_robot_looks_ahead() -> None:
    """Before the robot the floor is tinted by its field of view, behind it not."""
    scene = _scene(run([], way=ROBOT_WAY))
    picture = scene.picture(TICK_NS * 50)
    ahead, behind = _at(scene, picture, (4.0, 1.2)), _at(scene, picture, (1.0, 1.6))
    assert ahead[2] - ahead[0] > 20
    assert _apart(behind, (252, 252, 251)) == 0


def test_a_contact_is_ringed() -> None:
    """For a second there is red around an artefact that the robot touched."""
    lives = [walker(1, (5, 5), (5, 5.01))]
    contact = event(EventKind.ROBOT_CONTACT, 50, 1)
    scene = _scene(run(lives, events=[contact]))
    red = [
        (np.abs(scene.picture(TICK_NS * t).astype(int) - (230, 57, 70)).max(axis=2) < 60).sum()
        for t in (50, 53, 90)
    ]
    assert red[1] > red[0] + 50
    assert red[2] == red[0]


def test_a_follower_is_joined_to_its_leader_while_it_follows() -> None:
    """Half way between the two there are dashes on the floor, and none once it does not follow."""
    follower = replace(
        walker(2, (3, 5), (3, 5.01)),
        doings=(
            Doing(TICK_NS, "following", "following artefact 1"),
            Doing(TICK_NS * 60, "following", "walking"),
        ),
    )
    scene = _scene(run([walker(1, (7, 5), (7, 5.01)), follower]))
    floor, places = (252, 252, 251), np.arange(4.8, 5.2, 0.02)
    following, walking = (
        {_apart(_at(scene, picture, (x, 5.0)), floor) for x in places}
        for picture in (scene.picture(TICK_NS * tick) for tick in (59, 60))
    )
    assert min(following) == 0
    assert max(following) > 40
    assert walking == {0}


def test_a_change_of_behaviour_is_told_for_some_seconds(monkeypatch: pytest.MonkeyPatch) -> None:
    """A tag in the colour of the new behaviour, in the place of the label, and then the label."""
    changing = replace(
        walker(1, (5, 5), (5, 5.01)),
        doings=(Doing(TICK_NS, "walking"), Doing(TICK_NS * 20, "running")),
    )
    scene, written = _scene(run([changing])), texts_written(monkeypatch)
    inks = []
    for tick in (19, 20, 89, 90):
        picture = scene.picture(TICK_NS * tick)
        inks.append(int((np.abs(picture.astype(int) - (196, 59, 53)).max(axis=2) < 5).sum()))
    told = [text for text in written if text.startswith("1 ") and "virtual" not in text]
    assert told == ["1 walking", *["1 walking \N{RIGHTWARDS ARROW} running"] * 2, "1 running"]
    assert min(inks[1:3]) > 500
    assert max(inks[0], inks[3]) < 20


@pytest.mark.parametrize(("ticks", "told"), [(29, "waiting for 2"), (30, "waiting for pallet 2")])
def test_a_long_wait_is_told_with_the_class_of_what_is_waited_for(
    ticks: int, told: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of three seconds and more."""
    waiting = replace(
        walker(1, (5, 5), (5, 5.01)),
        doings=(
            Doing(TICK_NS, "walking"),
            Doing(TICK_NS * 20, "walking", "waiting for artefact 2"),
            Doing(TICK_NS * (20 + ticks), "walking"),
        ),
    )
    scene = _scene(run([waiting, walker(2, (6, 5), (6, 5.01), name="pallet")]))
    written = texts_written(monkeypatch)
    for tick in (19, 21, 20 + ticks):
        scene.picture(TICK_NS * tick)
    assert [text for text in written if text.startswith("1 ")] == [
        "1 walking",
        f"1 {told}",
        "1 walking",
    ]


def test_walls_and_the_way_of_the_robot_are_there() -> None:
    """Walls are dark where the map has them, and the way driven so far is blue."""
    scene = _scene(run([], way=ROBOT_WAY))
    picture = scene.picture(TICK_NS * 90)
    assert _apart(_at(scene, picture, (0.05, 5.0)), (88, 95, 104)) < 30
    driven = _at(scene, picture, (1.5, 1.0))
    assert driven[2] > driven[0] + 50


def test_the_robot_is_there_from_the_first_picture_on() -> None:
    """Though its pose comes only with the first transform; one of much later does not count."""
    late, too_late = run([], way=ROBOT_WAY), run([], way=ROBOT_WAY)
    late.robot.__dict__["stamps_ns"] = late.robot.stamps_ns + NS_PER_S // 2
    too_late.robot.__dict__["stamps_ns"] = too_late.robot.stamps_ns + 2 * NS_PER_S
    inks = []
    for record in (late, too_late):
        scene = _scene(record)
        x, y = np.floor(scene.view.pixels((1.0, 1.0))).astype(int).tolist()
        part = scene.picture(TICK_NS)[y - 30 : y + 30, x - 30 : x + 30].astype(int)
        inks.append(int((np.abs(part - (0x2F, 0x7F, 0xC1)).max(axis=2) < 40).sum()))
    assert inks[0] > 50
    assert inks[1] == 0


def test_the_legend_has_the_robot_and_its_way() -> None:
    """In the header, where there is a robot."""
    with_robot, without = (_scene(run([], way=way)) for way in (ROBOT_WAY, ()))
    header = slice(0, HEADER_PX), slice(350, None)
    assert (with_robot.picture(TICK_NS)[header] < 200).any()
    assert not (without.picture(TICK_NS)[header] < 200).any()


def test_the_legend_names_what_happens() -> None:
    """Rings and the dashed line, in the footer, where there are any."""
    follower = replace(
        walker(2, (3, 5), (3, 5.01)), doings=(Doing(TICK_NS, "following", "following artefact 1"),)
    )
    lives = [walker(1, (7, 5), (7, 5.01)), follower]
    kinds = (EventKind.ARRIVED, EventKind.ROBOT_CONTACT, EventKind.DISPLACED)
    scene = _scene(run(lives, events=[event(kind, 50, 1) for kind in kinds]))
    names = [entry.name for entry in scene.legend()[1]][3:]
    assert names == ["comes or goes", "robot contact", "displaced", "follows"]
    assert len(_scene(run(lives[:1])).legend()[1]) == 3
    feet = [
        scene.picture(TICK_NS)[-scene.footer_px :]
        for scene in (scene, _scene(run(lives)), _scene(run(lives[:1])))
    ]
    inks = [int((foot < 200).any(axis=2).sum()) for foot in feet]
    assert inks[0] > inks[1] > inks[2]


@pytest.mark.parametrize(("count", "told"), [(16, 16), (17, 3)])
def test_of_many_only_the_perceived_are_told(
    count: int, told: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each has its id; beside it is what it does, of more than 16 for the perceived only."""
    spots = [(1.5 + 2.0 * (i % 4), 1.0 + 2.0 * (i // 4)) for i in range(count)]
    lives = [walker(i, at, at, seen=ALL if i in {2, 5, 16} else ()) for i, at in enumerate(spots)]
    if count == 16:
        lives[9] = walker(9, spots[9], spots[9], seen=ALL)
    scene = _scene(run(lives))
    written = texts_written(monkeypatch)
    scene.picture(TICK_NS * 50)
    labels = [t for t in written if t.split(" ")[0].isdigit() and "virtual" not in t]
    assert sorted(int(label.split(" ")[0]) for label in labels) == list(range(count))
    assert sum(label.endswith(" walking") for label in labels) == told


def test_a_legend_has_room_for_all(monkeypatch: pytest.MonkeyPatch) -> None:
    """Above only what fits beside the time and the counts; below as many rows as are needed."""
    entries = [Entry("something", patch_sign((0, 0, 0))) for _ in range(9)]
    written = texts_written(monkeypatch)
    for width in (360, 500, 840):
        canvas = Canvas((width, 200))
        written.clear()
        draw_legend(canvas, entries, entries)
        picture = canvas.pixels
        assert (picture[:, :350][:HEADER_PX] == 255).all()
        assert (picture[-ROW_PX:] < 128).any()
        assert written[-9:] == ["something"] * 9
        assert (picture[HEADER_PX:, width - 8 :] == 255).all(), "nothing reaches beyond the edge"


def test_long_recordings_are_shown_faster() -> None:
    """However long it is, there are at most 600 pictures, the first and evenly spaced."""
    record = run([], ticks=36_000)
    stamps, speed = shown_stamps(record)
    assert 500 < len(stamps) <= 600
    assert set(np.diff(stamps)) == {round(speed * NS_PER_S / 10)}
    assert stamps[0] == TICK_NS


def test_one_tick_is_a_film_of_one_picture(tmp_path: Path) -> None:
    """A record of one tick without anybody is a still."""
    film = _film(run([], ticks=1), tmp_path / "a.gif")
    assert film.pictures == 1


def test_a_large_film_gets_smaller_pictures(tmp_path: Path) -> None:
    """Where the file would be longer than allowed, the pictures shrink."""
    lives = [walker(i, (1 + 0.2 * i, 1), (9 - 0.2 * i, 9)) for i in range(30)]
    large = _film(run(lives), tmp_path / "a.gif")
    small = _film(run(lives), tmp_path / "b.gif", most_bytes=large.length_bytes // 2)
    assert small.length_bytes <= large.length_bytes // 2
    assert small.size_px[0] < large.size_px[0]


def test_what_cannot_be_written_is_said_in_a_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Another format, no folder, no ticks; and a film that breaks off leaves no file."""
    with pytest.raises(
        BagError, match=r"^--animate: 'a.mp4' is no .gif file: animations are GIFs$"
    ):
        animation_path(Path("a.mp4"), tmp_path)
    with pytest.raises(BagError, match="there is no folder"):
        animation_path(tmp_path / "no" / "a.gif", tmp_path)
    assert animation_path(Path("a.gif"), tmp_path) == tmp_path / "a.gif"
    with pytest.raises(BagError, match="no tick"):
        _film(run([], ticks=0), tmp_path / "a.gif")
    with pytest.raises(BagError, match="cannot be written"):
        _film(run([]), tmp_path / "no" / "a.gif")
    monkeypatch.setattr(Path, "write_bytes", _full)
    with pytest.raises(BagError, match="no space left"):
        _film(run([]), tmp_path / "a.gif")
    assert not (tmp_path / "a.gif").exists()


def _full(path: Path, content: bytes) -> int:
    """Write half of the content, as on a full disk."""
    with path.open("wb") as file:
        file.write(content[: len(content) // 2])
    raise OSError(28, "No space left on device")
