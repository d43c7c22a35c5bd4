"""The page of the viewer, looked at in a real browser where there is one."""

import math
import os
from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from are_ros.conventions import NS_PER_S
from are_ros.draw import viewer
from are_ros.draw.palette import ROBOT, Rgb, class_colours, hex_of
from are_ros.draw.scene import (
    MOST_TICKS,
    ArtefactAt,
    Moment,
    ScanPoints,
    SceneRecord,
    shown_every,
)
from are_ros.draw.viewer import (
    ViewedPlace,
    write_view,
)
from are_ros.errors import BagError
from are_ros.parameters.model import Parameters
from are_ros.population.artefact import GroundPose
from are_ros.population.catalogue import Catalogue, CatalogueRow
from are_ros.population.meshes.shapes import Shape
from are_ros.replay.scene_record import SceneRecorder
from are_ros.world.cameras import Camera, CameraAt, PinholeView
from are_ros.world.footprint import Footprint
from are_ros.world.occupancy_grid import OccupancyGrid
from are_ros.world.rigid_transform import RigidTransform
from are_ros.world.voxel_map import VoxelMap
from tests.browser import NO_BROWSER, Page, find_browser, open_page
from tests.conftest import full_disk

needs_viser = pytest.mark.skipif(not viewer.has_viser(), reason=viewer.MISSING_VISER)
needs_browser = pytest.mark.skipif(find_browser() is None, reason=NO_BROWSER)

PERSON, CAR = (class_colours([])[name] for name in ("person", "car"))
TICKS = 40
PAUSE = ".tabler-icon-player-pause-filled"
Image = NDArray[np.uint8]


def rgb(colour: Iterable[float]) -> Rgb:
    """Return a colour of viser's as one of the palette."""
    red, green, blue = map(int, colour)
    return red, green, blue


def place() -> ViewedPlace:
    """Return a room of 8 m by 6 m with walls around it."""
    cells = np.zeros((60, 80), dtype=np.int8)
    cells[[0, -1]] = cells[:, [0, -1]] = 100
    grid = OccupancyGrid(cells, 0.1, RigidTransform.identity(), "map")
    voxels = VoxelMap.extruded(grid, cells >= 65, 2.5, 0.0)
    footprint = Footprint(np.zeros((1, 2)), 0.3)
    camera = PinholeView.from_field_of_view(64, 48, math.radians(80.0))
    return ViewedPlace(grid, voxels, Catalogue(()), footprint, camera, 10.0, 0.0)


def artefact(number: int, class_name: str, x_m: float) -> ArtefactAt:
    """Return an upright box of half a metre by 1.5 m."""
    row = CatalogueRow(0, class_name, class_name, (0.6, 0.6, 1.5), (0.0, 0.0, 0.0), Shape.WALL)
    return ArtefactAt(number, row, GroundPose(x_m, 4.0, 0.0, 0.0), "walking", "", 0)


def tick(number: int) -> Moment:
    """Return a tick: the person goes from left to right, the car leaves after half of the time."""
    artefacts = [artefact(7, "person", 1.5 + 5.0 * number / TICKS)]
    if number < TICKS // 2:
        artefacts.append(artefact(8, "car", 6.5))
    base = RigidTransform(np.array((2.0 + 0.05 * number, 1.5, 0.0)), np.array((0.0, 0.0, 0.0, 1.0)))
    eye = np.array((2.0 + 0.05 * number, 1.5, 0.8)), np.array((-0.5, 0.5, -0.5, 0.5))
    points = np.array(((3.0, 1.5, 0.2), (4.0, 1.5, 0.2)), dtype=np.float32)
    scan = ScanPoints(points, np.array((False, True)))
    stamp_ns, perceived = number * NS_PER_S // 10, frozenset(one.artefact_id for one in artefacts)
    camera = RigidTransform(*eye)
    return Moment(stamp_ns, artefacts, perceived, base, camera, scans=(scan,))


def ticks(count: int = TICKS) -> SceneRecord:
    """Return the record of so many ticks."""
    recorder = SceneRecorder(Parameters(), Catalogue(()))
    view = PinholeView.from_field_of_view(64, 48, math.radians(80.0))
    camera = Camera(view, "", RigidTransform.identity())
    for number in range(count):
        recorder.keep(tick(number), camera)
    return recorder.record()


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Page]:
    """Open the page of the room."""
    folder = tmp_path_factory.mktemp("view")
    write_view(folder / "view.html", place(), ticks(), "a room & more")
    url = (folder / "view.html").as_uri()
    with open_page(url, folder / "profile", 640, 480) as opened:
        opened.wait("!!document.querySelector('canvas') && !!window.__viserSceneTree")
        opened.wait("'/artefacts/7' in window.__viserSceneTree.getState()")
        # The page plays by itself as soon as it is open.
        opened.wait(f"!!document.querySelector('{PAUSE}')")
        opened.run(f"document.querySelector('{PAUSE}').closest('button').click()")
        opened.wait(f"!document.querySelector('{PAUSE}')")
        # Nothing but the scene is to be on the pictures.
        opened.run("document.getElementById('are').open = false")
        yield opened


def go_to(page: Page, share: float) -> None:
    """Click on the time line, and wait until the page shows that time."""
    x, y, width, height = page.run(
        "(() => { const box = document.querySelector('[role=slider]')"
        ".closest('[class*=Slider-root]').getBoundingClientRect();"
        " return [box.x, box.y, box.width, box.height]; })()"
    )
    page.click(x + share * width, y + 0.5 * height)
    page.wait(
        "(() => { const slider = document.querySelector('[role=slider]');"
        " const [now, end] = ['now', 'max'].map((a) => +slider.getAttribute('aria-value' + a));"
        f" return Math.abs(now / end - {share}) < 0.03; }})()"
    )


def centre_of(image: Image, colour: tuple[int, int, int]) -> tuple[int, float]:
    """Return how many pixels have the hue of a colour, and their mean column."""
    wanted = np.array(colour) - np.mean(colour)
    pixels = image.astype(np.float64) - image.mean(axis=2, keepdims=True)
    lengths = np.linalg.norm(pixels, axis=2)
    cosines = pixels @ (wanted / np.linalg.norm(wanted)) / np.maximum(lengths, 1.0)
    alike = (cosines > 0.97) & (lengths > 40.0)
    columns = np.flatnonzero(alike.any(axis=0))
    return int(alike.sum()), float(np.nonzero(alike)[1].mean()) if len(columns) else math.nan


def settled(page: Page) -> Image:
    """Return a picture that the next one is like: all that was asked for is drawn."""
    before = page.picture()
    for _ in range(60):
        page.run("new Promise(done => setTimeout(done, 300))")
        image = page.picture()
        if np.abs(image.astype(int) - before).max() < 8:
            return image
        before = image
    raise AssertionError("the page never comes to rest")


@needs_viser
@needs_browser
def test_the_page_shows_map_robot_and_artefacts_as_time_goes_on(page: Page) -> None:
    """A click on the time line moves them: the person goes to the right, and the car has left."""
    go_to(page, 0.1)
    early = settled(page)
    go_to(page, 0.9)
    late = settled(page)
    for image in (early, late):
        assert centre_of(image, ROBOT)[0] > 50
        middle = image[120:400, 100:540]
        assert (middle.min(axis=2) > 225).mean() > 0.1, "the free part of the map is light"
        assert ((np.ptp(middle, axis=2) < 25) & (middle.max(axis=2) < 225)).any(), "a wall"
    (count, first), (_, last) = centre_of(early, PERSON), centre_of(late, PERSON)
    assert count > 50
    assert last - first > 60.0
    assert centre_of(early, CAR)[0] > 50
    assert centre_of(late, CAR)[0] == 0
    robots = [centre_of(image, ROBOT)[1] for image in (early, late)]
    assert robots[1] > robots[0]


@needs_viser
@needs_browser
def test_a_layer_can_be_switched_off(page: Page) -> None:
    """Without artefacts none of their colours is left, and the time may go back."""
    go_to(page, 0.3)
    assert centre_of(settled(page), PERSON)[0] > 50
    page.run("document.querySelector('[data-node=\"/artefacts\"]').click()")
    page.run("document.querySelector('[data-node=\"/ways\"]').click()")
    assert centre_of(settled(page), PERSON)[0] == 0
    go_to(page, 0.1)
    assert centre_of(settled(page), PERSON)[0] == 0
    page.run("document.querySelector('[data-node=\"/artefacts\"]').click()")
    page.run("document.querySelector('[data-node=\"/ways\"]').click()")


@needs_viser
def test_the_page_needs_no_network(tmp_path: Path) -> None:
    """It loads nothing from elsewhere, is small, and says what it shows."""
    view = write_view(tmp_path / "view.html", place(), ticks(), "a room & more")
    text = view.path.read_text(encoding="utf-8")
    for call in ('<script src="', '<link rel="stylesheet" href="http', "@import"):
        assert call not in text
    assert "a room &amp; more" in text
    assert view.length_bytes == view.path.stat().st_size < 1_500_000
    assert view.sentence().startswith(f"view: {view.path} (")
    assert "40 ticks" in view.sentence()


@needs_viser
def test_a_title_that_is_no_text_is_shown_with_question_marks(tmp_path: Path) -> None:
    """As the name of a recording whose umlauts are in Latin-1."""
    view = write_view(tmp_path / "view.html", place(), ticks(3), os.fsdecode(b"b\xfcro"))
    assert "b?ro" in view.path.read_text(encoding="utf-8")


@needs_viser
def test_where_nothing_can_be_written_it_is_said(tmp_path: Path) -> None:
    """A folder that is not there, a full disk, and a recording without a tick; no page is left."""
    with full_disk(), pytest.raises(BagError, match="file too large"):
        write_view(tmp_path / "view.html", place(), ticks(3), "a room")
    assert not (tmp_path / "view.html").exists()
    with pytest.raises(BagError, match="the page cannot be written"):
        write_view(tmp_path / "absent" / "view.html", place(), ticks(3), "a room")
    with pytest.raises(BagError, match="there is no tick to show"):
        write_view(tmp_path / "view.html", place(), ticks(0), "a room")


def test_without_viser_it_is_said_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One sentence with the command."""
    monkeypatch.setattr(viewer, "find_spec", lambda _: None)
    with pytest.raises(BagError, match="pip install viser"):
        write_view(tmp_path / "view.html", place(), ticks(3), "a room")


def test_a_long_recording_is_thinned_evenly() -> None:
    """However long it is, at most so many ticks are shown, at equal distances, with their scans."""
    record = ticks(5 * MOST_TICKS // 2)
    every = shown_every(len(record.series.stamps_ns))
    shown = [*record.moments(every)]
    assert MOST_TICKS // 2 < len(shown) <= MOST_TICKS
    steps = np.diff([one.stamp_ns for one in shown])
    assert set(steps.tolist()) == {every * NS_PER_S // 10}
    assert all(one.scans for one in shown)
    assert len(record.scans) == len(shown)


def test_scans_of_ticks_that_are_left_out_are_shown_at_the_next() -> None:
    """A laser at half the rate of the ticks has its scans at ticks that are not shown, say."""
    recorder, count = SceneRecorder(Parameters(), Catalogue(())), MOST_TICKS + 40
    for number in range(count):
        taken = tick(number)
        recorder.keep(taken if number % 2 else replace(taken, scans=()), None)
    shown = [*recorder.record().moments(2)]
    assert shown_every(count) == 2
    assert not shown[0].scans
    assert all(len(one.scans) == 1 for one in shown[1:])


@needs_viser
def test_a_scan_is_shown_until_the_next_one() -> None:
    """For at most a second: a laser may be slower than the ticks, or end."""
    server = viewer.start_server(0)
    try:
        scene, seen = viewer.ViewedScene(server.scene, place()), []
        for number in range(40):
            taken = tick(number)
            has_scan = number % 3 == 0 and number < 20
            scene.show(taken if has_scan else replace(taken, scans=()))
            handle = server.scene.get_handle_by_name("/scans/real")
            seen.append(handle is not None and handle.visible)
    finally:
        viewer.stop_server(server)
    assert seen == [True] * 28 + [False] * 12


@needs_viser
def test_a_scan_is_not_shown_on_at_ticks_whose_own_is_left_out() -> None:
    """After a second, as that of any laser that ends: its virtual returns would be elsewhere."""
    server = viewer.start_server(0)
    try:
        scene, seen = viewer.ViewedScene(server.scene, place()), []
        for number in range(0, 24, 6):
            scene.show(tick(number), with_scans=number in {0, 18})
            seen.append(server.scene.get_handle_by_name("/scans/virtual").visible)
    finally:
        viewer.stop_server(server)
    assert seen == [True, True, False, True]


@needs_viser
def test_the_legend_has_the_colours_of_the_artefacts(tmp_path: Path) -> None:
    """Also of classes of the user's own, of which not all came, with or without their catalogue."""
    rows = [artefact(k, name, 1.0).row for k, name in enumerate(("bike", "cone", "zebra"))]
    catalogue = Catalogue(tuple(replace(row, index=k) for k, row in enumerate(rows)))
    moment = replace(tick(0), artefacts=[artefact(3, "zebra", 1.0), artefact(5, "cone", 2.0)])
    recorder = SceneRecorder(Parameters(), Catalogue(()))
    recorder.keep(moment, None)
    for known in (catalogue, Catalogue(())):
        server = viewer.start_server(0)
        try:
            scene = viewer.ViewedScene(server.scene, replace(place(), catalogue=known))
            scene.show(moment)
            names = {"zebra": "/artefacts/3", "cone": "/artefacts/5"}
            bodies = {name: server.scene.get_handle_by_name(node) for name, node in names.items()}
            drawn = {name: rgb(one.color) for name, one in bodies.items()}
        finally:
            viewer.stop_server(server)
        assert len({*drawn.values()}) == 2
        assert scene.colours([moment]) == drawn
        seen = replace(place(), catalogue=known)
        write_view(tmp_path / "view.html", seen, recorder.record(), "a room")
        text = (tmp_path / "view.html").read_text(encoding="utf-8")
        for name, colour in drawn.items():
            assert f'"background:{hex_of(colour)};opacity:1"></i>{name}</li>' in text


@needs_viser
def test_another_life_of_an_id_has_a_body_and_a_way_of_its_own() -> None:
    """A node that was started again gives ids another time, of other types."""
    server = viewer.start_server(0)
    try:
        scene, bodies = viewer.ViewedScene(server.scene, place()), []
        lives = [artefact(3, "person", 1.0), artefact(3, "person", 2.0)]
        lives += [one._replace(arrival_ns=NS_PER_S) for one in (artefact(3, "car", 6.0),) * 2]
        moments = [replace(tick(k), artefacts=[one]) for k, one in enumerate(lives)]
        scene.draw_ways(moments)
        ways = [server.scene.get_handle_by_name(f"/ways/3_{at_ns}") for at_ns in (0, NS_PER_S)]
        for moment in moments[::3]:
            scene.show(moment)
            bodies.append(server.scene.get_handle_by_name("/artefacts/3").color)
    finally:
        viewer.stop_server(server)
    assert [way is not None for way in ways] == [True, False]  # the car stands
    assert [rgb(colour) for colour in bodies] == [PERSON, CAR]


@needs_viser
def test_names_that_look_like_places_of_the_page_stay_as_they_are(tmp_path: Path) -> None:
    """As any other names, of a recording and of a class."""
    recorder = SceneRecorder(Parameters(), Catalogue(()))
    recorder.keep(replace(tick(0), artefacts=[artefact(7, "@NOTES@", 1.5)]), None)
    view = write_view(tmp_path / "view.html", place(), recorder.record(), "@ROWS@")
    content = view.path.read_text(encoding="utf-8")
    assert "<summary>@ROWS@</summary>" in content
    assert "</i>@NOTES@</li>" in content


@needs_viser
@pytest.mark.parametrize("x_m", [2.0, 30.0, -400.0])
def test_the_page_looks_at_what_happens_beside_the_map_too(x_m: float) -> None:
    """As where the map's transform is wrong: it looked at nothing, half-way to the robot."""
    recorder = SceneRecorder(Parameters(), Catalogue(()))
    base = RigidTransform(np.array((x_m, 1.5, 0.0)), np.array((0.0, 0.0, 0.0, 1.0)))
    for number in range(2):
        moment = replace(tick(number), artefacts=[], map_from_base=base, map_from_camera=None)
        recorder.keep(moment, None)
    server = viewer.start_server(port=0)
    try:
        viewer.aim_camera(server, place(), [*recorder.record().moments()])
        x, y, _ = server.initial_camera.look_at
    finally:
        viewer.stop_server(server)
    assert math.dist((x, y), (x_m, 1.5)) < 1.0


@needs_viser
def test_the_page_says_what_it_leaves_out(tmp_path: Path) -> None:
    """As the terminal does: who gets the page has not seen that."""
    view = write_view(tmp_path / "view.html", place(), ticks(MOST_TICKS + 1), "a room")
    assert view.notes == ("one of 2 ticks is shown",)
    assert "<p>one of 2 ticks is shown</p>" in view.path.read_text(encoding="utf-8")


@needs_viser
@needs_browser
def test_what_is_switched_off_stays_off(tmp_path: Path) -> None:
    """The robot, whose pose comes late; and the space bar pauses after a click on a box."""
    recorder = SceneRecorder(Parameters(), Catalogue(()))
    for number in range(TICKS):
        taken = tick(number)
        recorder.keep(taken if number > 8 else replace(taken, map_from_base=None), None)
    write_view(tmp_path / "view.html", place(), recorder.record(), "late")
    url, box = (tmp_path / "view.html").as_uri(), "document.querySelector('[data-node=\"/robot\"]')"
    with open_page(url, tmp_path / "profile", 640, 480) as page:
        page.wait(f"!!document.querySelector('{PAUSE}')")
        page.wait("!!window.__viserSceneTree")
        page.wait("'/robot/base' in window.__viserSceneTree.getState()")
        left, top = page.run(f"[{box}.getBoundingClientRect()].map(at => [at.left, at.top])[0]")
        page.click(left + 6, top + 6)
        assert page.run(f"{box}.checked") is False
        page.press(" ", "Space")
        page.wait(f"!document.querySelector('{PAUSE}')")
        assert page.run(f"{box}.checked") is False
        page.run("document.getElementById('are').open = false")  # it lies on the time line
        for share in (0.1, 0.9):
            go_to(page, share)
            settled(page)
        state = "window.__viserSceneTree.getState()['/robot/base']"
        page.wait(f"{state}.visibility && !{state}.effectiveVisibility")  # ten times a second


def test_the_record_gives_the_ticks_back() -> None:
    """Artefacts, poses and scans are those that were taken."""
    for number, told in enumerate(ticks().moments()):
        taken = tick(number)
        assert [one.artefact_id for one in told.artefacts] == [
            one.artefact_id for one in taken.artefacts
        ]
        assert told.perceived == taken.perceived
        for one, other in zip(told.artefacts, taken.artefacts, strict=True):
            assert one.pose == pytest.approx(other.pose)
            assert one[3:5] == other[3:5]
        assert told.map_from_base is not None
        assert told.map_from_camera is not None
        assert taken.map_from_base is not None
        assert taken.map_from_camera is not None
        assert np.allclose(told.map_from_base.matrix(), taken.map_from_base.matrix())
        assert np.allclose(told.map_from_camera.matrix(), taken.map_from_camera.matrix())
        assert len(told.scans) == 1


def test_a_dense_scan_keeps_its_virtual_returns() -> None:
    """Of thousands of returns some are left out, of a few virtual ones none."""
    is_virtual = np.zeros(5000, dtype=np.bool_)
    is_virtual[100:110] = True
    scan = ScanPoints(np.zeros((5000, 3), dtype=np.float32), is_virtual).thinned()
    assert scan.is_virtual.sum() == 10
    assert len(scan.points_m) < 300


def test_labels_number_artefacts_as_the_pictures_do() -> None:
    """Those of a scenario count from s0; who is not perceived has no name."""
    scripted, by_chance = artefact(10**9 + 3, "person", 1.0), artefact(3, "car", 1.0)
    assert viewer._text_of(scripted, is_perceived=True) == "s3 person: walking"
    assert viewer._text_of(by_chance, is_perceived=False) == "3"


@needs_viser
@pytest.mark.parametrize(("width", "height"), [(1, 1), (64, 1), (1, 48)])
def test_a_camera_of_one_row_or_column_has_a_page(tmp_path: Path, width: int, height: int) -> None:
    """With the robot and the artefacts, and no frustum."""
    thin = PinholeView(width, height, 40.0, 40.0, 0.5 * (width - 1), 0.5 * (height - 1))
    page = tmp_path / "view.html"
    write_view(page, replace(place(), camera=thin), ticks(4), "thin")
    assert page.stat().st_size > 1000


@needs_viser
def test_each_camera_has_a_frustum_and_a_field_of_view() -> None:
    """One whose pose is not known any more is hidden; the first comes and goes as the others."""
    server = viewer.start_server(0)
    try:
        scene = viewer.ViewedScene(server.scene, place())
        one = tick(0)
        assert one.map_from_camera is not None
        other = CameraAt(1, PinholeView.from_field_of_view(32, 24, 1.2), one.map_from_camera)
        for others, first, shown in (
            ((other,), one.map_from_camera, {0: True, 1: True}),
            ((), one.map_from_camera, {0: True, 1: False}),
            ((other,), None, {0: False, 1: True}),
        ):
            scene.show(replace(one, others=others, map_from_camera=first))
            for nodes in (scene._frustums, scene._fans):
                assert {i: node.handle.visible for i, node in nodes.items()} == shown
    finally:
        viewer.stop_server(server)


@pytest.mark.parametrize(("x_m", "note"), [(0.0, ""), (60_000.0, ""), (5_411_567.0, "0.5 m")])
def test_a_map_far_from_its_origin_is_noted(x_m: float, note: str) -> None:
    """A page has numbers of 32 bits: in UTM coordinates artefacts would jump unexplained."""
    origin = RigidTransform.planar(-x_m, 10.0, 0.3)
    grid = OccupancyGrid(np.zeros((4, 4), np.int8), 0.5, origin, "utm")
    said = viewer.rounding_note(grid)
    assert said == (f"5412 km from the origin of utm, places are rounded to {note}" if note else "")
