"""Draws the pictures of docs/certainty.md: `python scripts/draw_certainty.py [--out docs/images]`.

A robot turns in the corridor of the sample office for some minutes, among many artefacts; a builder
without certainty tells what the camera sees, another one what a detector makes of it.
"""

import argparse
import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from PIL import Image

from are_ros.agents.events import PerceivedArtefact
from are_ros.builder.ar_builder import ArBuilder
from are_ros.builder.assembly import catalogue_of
from are_ros.builder.certainty.detector import detection_probability
from are_ros.builder.scene import Scene
from are_ros.builder.tick import Demand, Tick
from are_ros.conventions import NS_PER_S
from are_ros.draw.decisions import map_axes, name_map
from are_ros.draw.map import Window, map_image
from are_ros.draw.plots import name_axes, written_figure
from are_ros.parameters.declaration import with_values
from are_ros.parameters.model import CertaintyParameters, Parameters
from are_ros.parameters.ros_yaml import with_file
from are_ros.world.map_io import read_map_file

PROJECT = Path(__file__).resolve().parents[1]
MAP = PROJECT / "bags" / "sample_office_map.yaml"
START_NS = 1_000 * NS_PER_S
MANY = {"population.arrival_rate": 0.02, "population.mean_life": 20.0, "seed": 11}
AT_ONCE = {"certainty.latency": 0.0, "certainty.min_existence": 0.0}
SPOTS_M = ((3.0, 5.8), (8.0, 5.6), (12.5, 6.0))
RATE_HZ, SPOT_S, TURN_RAD_S = 10, 100, 0.25
FIRST_FALSE_ALARM = 10**12
SHOWN = {
    "certainty.latency": 0.0,
    "certainty.false_alarm_rate": 0.4,
    "population.arrival_rate": 0.01,
}
VIEW = "certainty_view.png"
NEAR_M, AHEAD_M, SHOWN_POSES = 6.0, 3.0, 2
LABEL_M = (2.4, 0.5)
"""The width and height that the words of one artefact take."""
NINETY_PERCENT = math.sqrt(4.605)
"""The radius of the ellipse in which a plane normal error is with this probability."""
TRUTH, TOLD, FALSE, PATH = "#6b7480", "#d1495b", "#e8890c", "#2f7fc1"


def parameters_of(preset: str, **values: Any) -> Parameters:
    """Return the parameters of a crowd; with a preset of certainty, unless it is empty."""
    parameters = with_values(Parameters(), MANY)
    if preset:
        file = PROJECT / "config" / "presets" / f"certainty_{preset}.yaml"
        parameters = with_file(parameters, file)
    return with_values(parameters, values)


def ticks_of(parameters: Parameters, seconds: float) -> Iterator[Tick]:
    """Yield the ticks of a robot that turns in one place after the other."""
    demand = Demand(grids=False, markers=False)
    builder = ArBuilder(parameters, catalogue_of(parameters), demand)
    builder.receive_map(read_map_file(MAP), START_NS)
    for k in range(round(seconds * RATE_HZ)):
        t_s, now_ns = k / RATE_HZ, START_NS + k * NS_PER_S // RATE_HZ
        x_m, y_m = SPOTS_M[int(t_s / SPOT_S) % len(SPOTS_M)]
        half_rad = 0.5 * TURN_RAD_S * t_s
        turn = (0.0, 0.0, math.sin(half_rad), math.cos(half_rad))
        builder.receive_transform("map", "base_link", now_ns, (x_m, y_m, 0.0), turn, now_ns)
        yield builder.step(now_ns)


class Looks(NamedTuple):
    """What was seen, and what was told of it: columns of equal length in each group.

    `chances` are probabilities of detection, `detected` whether it was. `existence` and `exists`
    are of reports, `said` and `right` of their classes, `squares` their normalised errors.
    """

    chances: list[float]
    detected: list[bool]
    existence: list[float]
    exists: list[bool]
    said: list[float]
    right: list[bool]
    squares: list[float]


def observed(parameters: Parameters, seconds: float) -> Looks:
    """Compare what a detector tells with the truth."""
    looks = Looks([], [], [], [], [], [], [])
    seen_by_all = ticks_of(parameters_of(""), seconds)
    for exact, told in zip(seen_by_all, ticks_of(parameters, seconds), strict=True):
        when = {one.artefact_id: one.sighting.seen_ns for one in told.perceived}
        for one in exact.perceived:
            fraction, range_m = one.sighting.visible_fraction, one.sighting.range_m
            chance = detection_probability(parameters.certainty, fraction, range_m)
            looks.chances.append(chance)
            looks.detected.append(when.get(one.artefact_id) == told.stamp_ns)
        for one in told.perceived:
            take_report(looks, one, told.scene)
    return looks


def take_report(looks: Looks, one: PerceivedArtefact, scene: Scene) -> None:
    """Add what is said of one, and whether it is so."""
    places = scene.ids.searchsorted(one.artefact_id)
    exists = places < len(scene) and scene.ids[places] == one.artefact_id
    looks.existence.append(one.existence)
    looks.exists.append(bool(exists))
    if not exists:
        return
    row, motion = scene.rows[places], scene.motions[places]
    looks.said.extend(one.probabilities)
    looks.right.extend(name == row.class_name for name in one.classes)
    error = one.map_from_artefact.translation_m[:2] - motion[:2]
    covariance = np.array(one.pose_covariance).reshape(6, 6)[:2, :2]
    looks.squares.append(float(error @ np.linalg.solve(covariance, error)))


@contextmanager
def small_figure(path: Path, size_in: tuple[float, float]) -> Iterator[Any]:
    """Give a figure to draw on, and write it as PNG of at most 256 colours."""
    with written_figure(path, size_in) as figure:
        yield figure
    with Image.open(path) as picture:
        picture.convert("RGB").quantize(256, dither=Image.Dither.NONE).save(path, optimize=True)


def draw_curves(looks: Looks, poor: CertaintyParameters, path: Path) -> None:
    """Draw the probability of detection over fraction and range, and the share that was."""
    good = CertaintyParameters()
    with small_figure(path, (9.4, 3.0)) as figure:
        left, middle, right = figure.subplots(1, 3, gridspec_kw={"wspace": 0.34})
        figure.subplots_adjust(0.06, 0.17, 0.985, 0.9)
        fractions, ranges_m = np.linspace(0.005, 1.0, 200), np.linspace(0.0, 20.0, 200)
        draw_curve(left, fractions, lambda set_, f: detection_probability(set_, f, 0.0), good, poor)
        draw_curve(
            middle, ranges_m, lambda set_, r: detection_probability(set_, 1.0, r), good, poor
        )
        name_axes(left, "near", "visible fraction", "probability of detection")
        name_axes(middle, "wholly visible", "range [m]", "")
        draw_reliability(right, looks.chances, looks.detected)
        name_axes(right, f"poor: {len(looks.chances)} looks", "by the curve", "share detected")
        left.legend(frameon=False)


def draw_curve(
    axes: Any,
    across: Any,
    chance: Callable[[CertaintyParameters, float], float],
    good: CertaintyParameters,
    poor: CertaintyParameters,
) -> None:
    """Draw the curves of both detectors."""
    for settings, name, colour in ((good, "good", PATH), (poor, "poor", TOLD)):
        axes.plot(across, [chance(settings, x) for x in across.tolist()], color=colour, label=name)
    axes.set(ylim=(0.0, 1.03), xlim=(0.0, float(across[-1])))


def draw_reliability(axes: Any, said: Sequence[float], right: Sequence[bool]) -> None:
    """Draw the share that was so over what was said, in ten bins; areas are numbers."""
    values, are_right = np.array(said), np.array(right)
    bins = np.minimum((values * 10).astype(int), 9)
    axes.plot((0, 1), (0, 1), color=TRUTH, linewidth=0.8)
    for each in np.unique(bins).tolist():
        chosen = bins == each
        size = 12.0 + 160.0 * chosen.mean()
        axes.scatter(values[chosen].mean(), are_right[chosen].mean(), size, TOLD, zorder=3)
    axes.set(xlim=(0, 1.03), ylim=(0, 1.03))


def draw_calibration(looks: Looks, path: Path) -> None:
    """Draw existence, classes and errors against what was said of them."""
    with small_figure(path, (9.4, 3.0)) as figure:
        left, middle, right = figure.subplots(1, 3, gridspec_kw={"wspace": 0.34})
        figure.subplots_adjust(0.06, 0.17, 0.985, 0.9)
        draw_reliability(left, looks.existence, looks.exists)
        name_axes(left, f"existence: {len(looks.exists)} reports", "said", "share that exists")
        draw_reliability(middle, looks.said, looks.right)
        name_axes(middle, "classes", "said", "share that is right")
        edges = np.linspace(0.0, 10.0, 41)
        right.hist(looks.squares, edges, density=True, color="#b9c8d8")
        right.plot(edges, 0.5 * np.exp(-0.5 * edges), color=TOLD)
        name_axes(right, "errors of x and y", "normalised square", "density")
        right.text(9.8, 0.42, "chi-square of two", color=TOLD, ha="right")
        right.set(xlim=(0, 10))


def outline(axes: Any, corners: Any, colour: str, **style: Any) -> None:
    """Draw a closed line (4, 2)."""
    closed = np.concatenate((corners, corners[:1]))
    axes.plot(*closed.T, color=colour, **style)


def ellipse(axes: Any, centre: Any, covariance: Any, colour: str, **style: Any) -> None:
    """Draw the ellipse of 90 % of a covariance (2, 2)."""
    values, vectors = np.linalg.eigh(covariance)
    angles = np.linspace(0.0, 2.0 * np.pi, 60)
    ring = np.stack((np.cos(angles), np.sin(angles))) * np.sqrt(np.maximum(values, 0.0))[:, None]
    axes.plot(*(np.array(centre)[:, None] + NINETY_PERCENT * vectors @ ring), color=colour, **style)


def draw_view(tick: Tick, path: Path) -> None:
    """Draw the truth and what is told of it from above."""
    pose = tick.map_from_base
    if pose is None or tick.perception.boxes is None:
        raise RuntimeError("the robot knows where it is, and there is a detector")
    heading, (x_m, y_m, _) = pose.rotation_matrix()[:2, 0], pose.translation_m.tolist()
    across_m, up_m = pose.translation_m[:2] + AHEAD_M * heading
    window = Window(across_m - 4.5, across_m + 4.5, up_m - 2.8, up_m + 2.8)
    floor = map_image(read_map_file(MAP), window, 90.0)
    with small_figure(path, (8.6, 5.6)) as figure:
        axes = map_axes(figure, (0.05, 0.05, 0.93, 0.9), window, floor)
        name_map(axes, "truth (grey), what is told with its ellipse of 90 % (red), paths (blue)")
        for corners in tick.scene.boxes.footprints():
            axes.fill(*corners.T, color=TRUTH, alpha=0.45, linewidth=0, zorder=2)
        axes.arrow(x_m, y_m, *(0.4 * heading), width=0.09, color="#0b2f6b", zorder=5)
        footprints = tick.perception.boxes.footprints()
        for corners, one in zip(footprints, tick.perceived, strict=True):
            draw_told(axes, corners, one, across_m)
        for route in tick.perception.paths or ():
            ahead = route.numbers[:SHOWN_POSES]
            axes.plot(*ahead[:, :2].T, ".-", color=PATH, linewidth=0.9, markersize=4)
            for numbers in ahead:
                spread = numbers[7:].reshape(6, 6)[:2, :2]
                ellipse(axes, numbers[:2], spread, PATH, linewidth=0.4)
        axes.set(xlim=(window.left, window.right), ylim=(window.bottom, window.top))


def draw_told(axes: Any, corners: Any, one: PerceivedArtefact, middle_m: float) -> None:
    """Draw what is told of one: its box, its ellipse, and towards the middle x its words."""
    is_false = one.artefact_id >= FIRST_FALSE_ALARM
    colour, centre = FALSE if is_false else TOLD, one.map_from_artefact.translation_m[:2]
    outline(axes, corners, colour, linewidth=1.2, zorder=4)
    covariance = np.array(one.pose_covariance).reshape(6, 6)[:2, :2]
    ellipse(axes, centre, covariance, colour, linewidth=1.2, zorder=4)
    said = f"{one.classes[0]} {one.probabilities[0]:.2f}, exists {one.existence:.2f}"
    words = f"{said}\n(a false alarm)" if is_false else said
    style = {"textcoords": "offset points", "fontsize": 8, "color": colour, "annotation_clip": True}
    halo = {"boxstyle": "round,pad=0.15", "fc": "white", "ec": "none", "alpha": 0.75}
    place = ((8, 9), "left") if centre[0] < middle_m else ((-8, 9), "right")
    axes.annotate(words, centre, place[0], ha=place[1], bbox=halo, zorder=6, clip_on=True, **style)


def busiest(ticks: Iterator[Tick]) -> Tick:
    """Return the tick that tells of most near the robot, one false, with room for their words."""

    def rank(tick: Tick) -> tuple[bool, int]:
        near = [one for one in tick.perceived if one.sighting.range_m < NEAR_M]
        places_m = np.array([one.map_from_artefact.translation_m[:2] for one in near])
        apart_m = np.abs(places_m[:, None] - places_m[None]) if near else np.zeros((0, 0, 2))
        crowded = (apart_m < LABEL_M).all(axis=2).sum() - len(near)
        return any(one.artefact_id >= FIRST_FALSE_ALARM for one in near), len(near) - crowded

    return max(ticks, key=rank)


def main() -> None:
    """Draw all of them."""
    parser = argparse.ArgumentParser(description="Draw the pictures of docs/certainty.md.")
    parser.add_argument("--out", type=Path, default=PROJECT / "docs" / "images")
    out = parser.parse_args().out
    poor = parameters_of("poor", **AT_ONCE)
    looks = observed(poor, len(SPOTS_M) * SPOT_S)
    draw_curves(looks, poor.certainty, out / "certainty_detection.png")
    draw_calibration(looks, out / "certainty_calibration.png")
    draw_view(busiest(ticks_of(parameters_of("good", **SHOWN), 100.0)), out / VIEW)


if __name__ == "__main__":
    main()
