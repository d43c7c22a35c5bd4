"""The picture: what is on it, and that it is the same each time."""

from dataclasses import replace
from pathlib import Path

import cv2
import matplotlib as mpl
import numpy as np
import pytest
from numpy.typing import NDArray

from are_ros.errors import BagError
from are_ros.replay.rviz_picture import draw_rviz
from are_ros.replay.rviz_scene import RvizScene, read_scene
from are_ros.replay.rviz_views import draw_costmap, draw_perspective, draw_top_down
from are_ros.replay.rviz_window import COSTMAP, MAIN, TOP_DOWN, Place, display_rows

Picture = NDArray[np.uint8]


@pytest.fixture(scope="module")
def drawn(sample_replay: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[RvizScene, Path]:
    """Return the sample's fullest moment and its picture."""
    path = tmp_path_factory.mktemp("picture") / "rviz.png"
    return draw_rviz(sample_replay, path), path


def part(path: Path, place: Place) -> Picture:
    """Return a part of a picture as RGB."""
    picture = cv2.imread(str(path))
    assert picture is not None
    rows = slice(place.top + 2, place.top + place.height - 2)
    cut: Picture = picture[rows, place.left + 2 : place.left + place.width - 2, ::-1]
    return cut


def count(picture: Picture, *rgb: int) -> int:
    """Return how many pixels have a colour, but for rounding."""
    apart = np.abs(picture.astype(np.int64) - rgb).max(axis=2)
    return int(np.count_nonzero(apart <= 3))


def over(
    rgb: tuple[int, int, int], below: tuple[float, ...] = (48.0, 48.0, 48.0)
) -> tuple[int, ...]:
    """Return a map's colour laid over another."""
    return tuple(round(0.7 * a + 0.3 * b) for a, b in zip(rgb, below, strict=True))


def test_the_views_show_map_scan_robot_and_costmap(drawn: tuple[RvizScene, Path]) -> None:
    """Each by rviz's own colours: free, occupied and unknown cells, cyan and purple costs.

    What the furniture of the octomap hides from the side, unknown cells, is seen from above only.
    """
    _, path = drawn
    main, above, costs = (part(path, place) for place in (MAIN, TOP_DOWN, COSTMAP))
    free, wall, unknown = over((255, 255, 255)), over((0, 0, 0)), over((0x70, 0x89, 0x86))
    for view, colours in ((main, (free, wall)), (above, (free, wall, unknown))):
        for colour in colours:
            assert count(view, *colour) > 0.005 * view[..., 0].size, colour
        assert count(view, 25, 255, 0) > 5  # the robot's outline
    assert count(main, 242, 237, 184) > 100  # the scan that came in
    for colour in ((0, 255, 255), (255, 0, 255)):
        laid = [count(costs, *over(colour, ground)) for ground in (free, wall, unknown)]
        assert sum(laid) > 200, colour
        assert sum(count(above, *over(colour, ground)) for ground in (free, wall)) == 0


def test_beams_that_are_changed_are_red(sample_replay: Path) -> None:
    """Where they are not behind whom they end at; and none while the scan is as it came in."""
    scenes = [read_scene(sample_replay, float(at_s)) for at_s in range(1, 8)]
    changed = np.array([changed_beams(scene) for scene in scenes])
    seen = [count(draw_perspective(scene, (900, 800)), 255, 41, 26) for scene in scenes]
    reds = np.array(seen)
    assert reds[changed > 0].max() > 10
    assert (reds[changed == 0] == 0).all()


def test_two_lasers_are_drawn_each_with_what_came_in(drawn: tuple[RvizScene, Path]) -> None:
    """Beams of the second that are as they came in cover ARE's: nothing more is red than before."""
    scene, _ = drawn
    (_, ours), (_, real) = sorted(scene.scans, key=lambda scan: scan[0] == "/scan")
    size = (450, 400)
    one = draw_perspective(replace(scene, scans=(("/ar_builder/a", ours), ("/a", real))), size)
    names = ("/ar_builder/a", "/ar_builder/b", "/a", "/b")
    four = tuple(zip(names, (ours, ours, real, real), strict=True))
    assert np.array_equal(draw_perspective(replace(scene, scans=four), size), one)
    rows = {row.text: row for row in display_rows(replace(scene, scans=four))}
    assert set(names) <= set(rows)


def changed_beams(scene: RvizScene) -> int:
    """Return how many points of ARE's scan are not those of the one that came in."""
    (_, ours), (_, real) = sorted(scene.scans, key=lambda scan: scan[0] == "/scan")
    apart_m = np.linalg.norm(ours[:, np.newaxis] - real, axis=2).min(axis=1)
    return int(np.count_nonzero(apart_m > 0.01))


def test_artefacts_and_labels_are_seen(drawn: tuple[RvizScene, Path]) -> None:
    """Without its markers the view is another one where they stood; labels are white."""
    scene, _ = drawn
    size = (300, 240)
    whole = draw_perspective(scene, size)
    bare = draw_perspective(_without_solids(scene), size)
    assert np.count_nonzero((whole != bare).any(axis=2)) > 300
    assert count(whole, 255, 255, 255) > count(bare, 255, 255, 255)
    assert whole.shape == (240, 300, 3)


def _without_solids(scene: RvizScene) -> RvizScene:
    """Return the scene with its artefacts as small as points: the camera stays where it is."""
    shrunk = tuple(
        replace(marker, fields=marker.fields._replace(text="", scale=1e-6 * marker.fields.scale))
        for marker in scene.markers
    )
    return replace(scene, markers=shrunk)


def test_the_picture_tells_time_markers_and_topics(drawn: tuple[RvizScene, Path]) -> None:
    """The rows of the displays name each topic, with how much there is of it."""
    scene, path = drawn
    rows = [*display_rows(scene)]
    texts = {row.text for row in rows}
    assert {"/ar_builder/augmented_map", "/ar_builder/augmented_costmap"} <= texts
    assert {"/ar_builder/markers", "/ar_builder/scan", "/scan"} <= texts
    values = [row.value for row in rows]
    assert f"{len(scene.markers)} markers" in values
    assert "340 x 240 cells" in values
    picture = cv2.imread(str(path))
    assert picture is not None
    assert picture.shape == (940, 1680, 3)
    assert len(np.unique(picture[905:935, 5:400])) > 20  # the time is written there


def test_the_same_recording_gives_the_same_bytes(
    drawn: tuple[RvizScene, Path], sample_replay: Path, tmp_path: Path
) -> None:
    """Whatever matplotlib is set to."""
    again = tmp_path / "again.png"
    with mpl.rc_context({"font.size": 30, "savefig.dpi": 10, "text.color": "red"}):
        draw_rviz(sample_replay, again)
    assert again.read_bytes() == drawn[1].read_bytes()


def test_any_recording_has_a_picture(sample_bag: Path, tmp_path: Path) -> None:
    """Without markers, costmap and parameters it shows the rest."""
    scene = draw_rviz(sample_bag, tmp_path / "plain.png", 3.0)
    assert scene.markers == ()
    assert scene.costmap is None
    assert scene.outline_m is None
    assert scene.elapsed_s == 3.0
    assert count(part(tmp_path / "plain.png", MAIN), *over((255, 255, 255))) > 1000


def test_a_replay_without_inputs_has_a_picture(sample_replay: Path) -> None:
    """Without a robot the artefacts are looked at from the south; without a map, the origin."""
    scene = replace(read_scene(sample_replay), axes={}, scans=())
    assert draw_perspective(scene, (60, 40)).std() > 10.0
    nothing = replace(scene, grid=None, costmap=None, markers=())
    for draw in (draw_perspective, draw_top_down, draw_costmap):
        assert draw(nothing, (60, 40)).std() > 1.0  # the lines of the grid


def test_a_picture_that_cannot_be_written_is_an_error(sample_bag: Path, tmp_path: Path) -> None:
    """The sentence names the file."""
    with pytest.raises(BagError, match=r"none/rviz\.png: the picture cannot be written"):
        draw_rviz(sample_bag, tmp_path / "none" / "rviz.png", 1.0)
    with pytest.raises(BagError, match="no such file"):
        draw_rviz(tmp_path / "nothing", tmp_path / "rviz.png")
