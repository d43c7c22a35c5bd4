"""Checks of parameters against each other."""

import math
from dataclasses import asdict, replace
from typing import Final

from are_ros.errors import ParameterError
from are_ros.parameters.choices import Appear, OnRobotContact, Region, Shape
from are_ros.parameters.model import (
    INFO_MARK,
    CameraParameters,
    CertaintyParameters,
    FramesParameters,
    MixtureParameters,
    OcclusionParameters,
    Parameters,
    PopulationParameters,
    SensorsParameters,
    WorldParameters,
)
from are_ros.wording import counted

_SUM_TOLERANCE: Final = 1e-6
_MOUNT: Final = ("x", "y", "z", "yaw", "pitch", "roll")


def validated(parameters: Parameters) -> Parameters:
    """Return the parameters with frames without leading slashes, as tf2 has them.

    ParameterError, naming the parameters, where they contradict each other.
    """
    _check_thresholds(parameters.world)
    _check_mixture(parameters.mixture)
    _check_mount(parameters.camera)
    _check_cameras(parameters.camera)
    _check_zones(parameters.population)
    _check_target(parameters.occlusion)
    _check_prediction(parameters.certainty)
    _check_topics(parameters.sensors)
    _check_wait(parameters)
    return replace(
        parameters,
        frames=_checked_frames(parameters.frames),
        camera=replace(parameters.camera, frame=parameters.camera.frame.lstrip("/")),
    )


def with_contact_policy(parameters: Parameters, policy: OnRobotContact) -> Parameters:
    """Return the parameters with this policy where collisions.on_robot_contact is `auto`."""
    if parameters.collisions.on_robot_contact is not OnRobotContact.AUTO:
        return parameters
    collisions = replace(parameters.collisions, on_robot_contact=policy)
    return replace(parameters, collisions=collisions)


def _check_thresholds(world: WorldParameters) -> None:
    if not world.free_threshold < world.occupied_threshold:
        message = (
            f"parameter 'world.free_threshold': {world.free_threshold} is not below "
            f"world.occupied_threshold, {world.occupied_threshold}"
        )
        raise ParameterError(message)


def _check_prediction(certainty: CertaintyParameters) -> None:
    horizon_s, step_s = certainty.prediction_horizon, certainty.prediction_step
    if 0.0 < horizon_s < step_s:
        raise ParameterError(
            f"parameter 'certainty.prediction_step': {step_s:g} s is above "
            f"certainty.prediction_horizon, {horizon_s:g} s, so that no path would have a pose"
        )


def _check_mixture(mixture: MixtureParameters) -> None:
    weights, rates = mixture.weights, mixture.rates
    if not weights or len(weights) != len(rates):
        message = (
            "parameters 'mixture.weights' and 'mixture.rates': "
            f"{counted(len(weights), 'weight')} and {counted(len(rates), 'rate')}, but as many of "
            "the one as of the other are needed, at least one"
        )
        raise ParameterError(message)
    total = math.fsum(weights)
    if not abs(total - 1.0) <= _SUM_TOLERANCE:
        raise ParameterError(f"parameter 'mixture.weights': they sum to {total:.9g}, not to 1")


def _check_mount(camera: CameraParameters) -> None:
    if len(camera.mount) != len(_MOUNT):
        message = f"parameter 'camera.mount': {len(camera.mount)} numbers, not 6"
        raise ParameterError(f"{message} ({', '.join(_MOUNT)})")


def _check_cameras(camera: CameraParameters) -> None:
    topics, rates = [name.lstrip("/") for name in camera.others], camera.other_rates
    if len(set(topics)) < len(topics) or "" in topics:
        message = f"parameter 'camera.others': {list(camera.others)} has an empty or repeated topic"
        raise ParameterError(message)
    if not rates or len(rates) > max(1, len(topics)):
        message = (
            f"parameters 'camera.others' and 'camera.other_rates': {len(topics)} topics and "
            f"{len(rates)} rates, but there is at least one rate, and no more than topics"
        )
        raise ParameterError(message)


def _check_zones(population: PopulationParameters) -> None:
    in_zones = {
        "population.region": population.region is Region.ZONES,
        "population.appear": population.appear is Appear.ZONES,
    }
    for name, is_zones in in_zones.items():
        if is_zones and not population.zones:
            raise ParameterError(f"{name} is zones, but population.zones names no file")


def _check_target(occlusion: OcclusionParameters) -> None:
    if occlusion.target is Shape.MESH and occlusion.shape is not Shape.MESH:
        message = (
            "parameter 'occlusion.target': mesh asks for occlusion.shape: mesh, and that is box"
        )
        raise ParameterError(message)


def _check_topics(sensors: SensorsParameters) -> None:
    for name, topics in asdict(sensors).items():
        if isinstance(topics, tuple) and "" in topics:
            message = f"parameter 'sensors.{name}': {list(topics)} has an empty topic"
            raise ParameterError(f"{message}; none at all is an empty list, []")
    for text in sensors.camera_infos:
        parts = text.split(INFO_MARK)
        if len(parts) != 2 or not all(parts):
            raise ParameterError(
                f"parameter 'sensors.camera_infos': {text!r} is not two topics, as in"
                " /image:=/camera_info"
            )
    images = [text.split(INFO_MARK)[0] for text in sensors.camera_infos]
    for image in images:
        if images.count(image) > 1:
            raise ParameterError(f"parameter 'sensors.camera_infos': {image} is given twice")


def _check_wait(parameters: Parameters) -> None:
    wait_s, history_s = parameters.sensors.tf_wait, parameters.poses.history
    if wait_s > history_s:
        raise ParameterError(
            f"parameter 'sensors.tf_wait': {wait_s:g} s is above poses.history, {history_s:g} s: "
            "a scan that waited so long would go out without artefacts"
        )


def _checked_frames(frames: FramesParameters) -> FramesParameters:
    map_frame = frames.map.lstrip("/")
    if not map_frame:
        raise ParameterError("parameter 'frames.map': it is empty, but the world frame has a name")
    return replace(
        frames, map=map_frame, odom=frames.odom.lstrip("/"), base=frames.base.lstrip("/")
    )
