"""`are describe`: what a configuration means, for a person."""

import math
from typing import Final

from are_ros.artefacts.catalogue import Catalogue
from are_ros.artefacts.mixture import mixture_of
from are_ros.description._tables import aligned, section
from are_ros.description.catalogue_lines import (
    behaviour_lines,
    catalogue_lines,
    class_lines,
    mixture_lines,
)
from are_ros.description.population_lines import population_lines
from are_ros.description.site import Site
from are_ros.parameters.choices import CameraModel, CostmapGate, SensorGate
from are_ros.parameters.declaration import Value, describe, flatten
from are_ros.parameters.model import CameraParameters, Parameters

_MORE: Final = "Each row of the catalogue, and what it does: --all."


def describe_lines(
    parameters: Parameters,
    catalogue: Catalogue,
    site: Site | None = None,
    *,
    everything: bool = False,
) -> list[str]:
    """Return the description, line by line; figures are for a site, or else for 100 m^2.

    Rows of the catalogue are summed up by class, unless `everything` is asked for. Raises
    ParameterError where the mixture does not fit the catalogue.
    """
    law = mixture_of(parameters, catalogue)
    probabilities = law.probabilities()
    lines = [
        *population_lines(parameters, probabilities, catalogue, site or Site()),
        *mixture_lines(law, catalogue),
        *class_lines(probabilities, catalogue),
        *behaviour_lines(probabilities, catalogue, of_rows=everything),
        *(catalogue_lines(probabilities, catalogue) if everything else ()),
        *section("Perception and outputs", aligned(_outputs(parameters))),
        *section("Parameters that differ from their defaults", _changed_lines(parameters)),
    ]
    return lines[:-1] if everything else [*lines, _MORE]


def _outputs(parameters: Parameters) -> list[tuple[str, str]]:
    occlusion, sensors, robot = parameters.occlusion, parameters.sensors, parameters.robot
    hidden_by = "walls and each other" if occlusion.mutual else "walls only"
    scans = ", ".join(sensors.scans) or "none"
    return [
        ("ticks", f"{parameters.builder.tick_rate:g} Hz, seed {parameters.seed}"),
        ("robot", f"footprint {robot.footprint or f'a disc of {robot.radius:g} m'}"),
        ("camera", _camera_text(parameters.camera)),
        ("perceived", f"more than {occlusion.tau} px visible within {occlusion.max_range:g} m"),
        ("hidden by", f"{hidden_by} ({occlusion.shape.value})"),
        ("grids", _grid_text(parameters)),
        ("scans", f"{scans}; {_sensor_text(sensors.gate)}, as {sensors.shape.value}"),
    ]


def _camera_text(camera: CameraParameters) -> str:
    where = f"in {camera.frame}" if camera.frame else f"{camera.mount[2]:g} m above the base"
    size = f"{camera.width} x {camera.height} px"
    if camera.model is CameraModel.OMNIDIRECTIONAL:
        return f"omnidirectional, {size}, {math.degrees(camera.vfov):.0f} degrees high, {where}"
    pinhole = f"pinhole, {size}, {math.degrees(camera.hfov):.0f} degrees wide, {where}"
    if camera.model is CameraModel.PINHOLE:
        return pinhole
    kind = "rectified" if camera.rectified else "raw"
    return f"that of CameraInfo ({kind}); where there is none: {pinhole}"


def _grid_text(parameters: Parameters) -> str:
    costmap = parameters.costmap
    inflated = f"inflated by {costmap.inflation_radius:g} m"
    if costmap.gate is CostmapGate.ALL:
        return f"all artefacts, {inflated}"
    kept = f" and for {costmap.memory:g} s after" if costmap.memory > 0.0 else " only"
    return f"artefacts while perceived{kept}, {inflated}"


def _sensor_text(gate: SensorGate) -> str:
    perceived_only = gate is SensorGate.PERCEIVED
    return "only perceived artefacts" if perceived_only else "whatever artefact a ray meets"


def _changed_lines(parameters: Parameters) -> list[str]:
    values = flatten(parameters)
    rows = [
        (
            item.path,
            f"{_text(values[item.path])} {item.unit}".rstrip(),
            f"not {_text(item.default)}",
        )
        for item in describe(parameters)
        if values[item.path] != item.default
    ]
    return aligned(rows) if rows else ["  none"]


def _text(value: Value) -> str:
    if isinstance(value, tuple):
        return "[" + ", ".join(_text(one) for one in value) + "]"
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, float):
        return f"{value:.6g}"
    return repr(value) if value == "" else str(value)
