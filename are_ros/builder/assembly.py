"""How the parameters become the parts that `ArBuilder` composes."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path

from are_ros.agents.collisions import CollisionResolver, ContactPolicy, Displace, Hold, Remove
from are_ros.agents.robots import RobotTracker
from are_ros.builder.costmap.augmented_map import GridAugmentation
from are_ros.builder.costmap.inflation import InflatedCostmap
from are_ros.builder.files.catalogue_file import SHIPPED_CATALOGUE, read_catalogue
from are_ros.conventions import seconds_to_ns
from are_ros.errors import ParameterError
from are_ros.parameters.choices import CameraModel, OdometryUse, OnRobotContact
from are_ros.parameters.model import CameraParameters, Parameters, RobotParameters
from are_ros.population.catalogue import Catalogue
from are_ros.world.cameras import (
    Camera,
    Observer,
    OmnidirectionalView,
    PinholeView,
    ViewModel,
    mounted_camera,
)
from are_ros.world.footprint import Footprint
from are_ros.world.rigid_transform import RigidTransform
from are_ros.world.transforms.table import TransformSource
from are_ros.world.transforms.tree import FrameTree

OBSERVER = "robot"
_STATIC_FORM = "X Y Z YAW PITCH ROLL PARENT CHILD"


def catalogue_of(parameters: Parameters) -> Catalogue:
    """Return the catalogue that the parameters name, or the shipped one; CatalogueError."""
    return read_catalogue(Path(parameters.catalogue) if parameters.catalogue else SHIPPED_CATALOGUE)


def robot_tracker(parameters: Parameters, frames: FrameTree) -> RobotTracker:
    """Return the tracker of the one robot."""
    observer = Observer(OBSERVER, parameters.frames.base, robot_footprint(parameters.robot))
    max_age_ns = seconds_to_ns(parameters.frames.max_age)
    return RobotTracker(observer, frames, parameters.frames.map, max_age_ns)


def odometry_source(parameters: Parameters) -> TransformSource | None:
    """Return as what the poses of odometry count, None where they do not."""
    sources = {
        OdometryUse.AUTO: TransformSource.ODOMETRY,
        OdometryUse.USE: TransformSource.PREFERRED_ODOMETRY,
    }
    return sources.get(parameters.frames.odometry)


def robot_footprint(robot: RobotParameters) -> Footprint:
    """Return the robot's outline on its base; ParameterError where its text is no polygon."""
    return Footprint.parse(robot.footprint) if robot.footprint else Footprint.disc(robot.radius)


def view_of_parameters(camera: CameraParameters) -> ViewModel:
    """Return the view model that the parameters describe."""
    if camera.model is CameraModel.OMNIDIRECTIONAL:
        half = 0.5 * camera.vfov
        return OmnidirectionalView(camera.width, camera.height, -half, half)
    return PinholeView.from_field_of_view(camera.width, camera.height, camera.hfov)


def default_camera(parameters: Parameters) -> Camera:
    """Return the camera of the parameters: in `camera.frame`, else mounted on the base."""
    camera = parameters.camera
    if len(camera.mount) != len(("x", "y", "z", "yaw", "pitch", "roll")):
        raise ParameterError(f"parameter 'camera.mount': {len(camera.mount)} numbers, not 6")
    mounted = mounted_camera(view_of_parameters(camera), camera.mount)
    return replace(mounted, frame_id=camera.frame)


def chosen_camera(parameters: Parameters, received: Camera) -> Camera:
    """Return the camera to use when CameraInfo says `received`."""
    if parameters.camera.model is not CameraModel.AUTO:
        return default_camera(parameters)
    return replace(received, frame_id=parameters.camera.frame or received.frame_id)


def collision_resolver(parameters: Parameters) -> CollisionResolver:
    """Return the resolver with the policy of `collisions.on_robot_contact`.

    `auto` is the adapter's to decide, and means hold here.
    """
    policies: dict[OnRobotContact, ContactPolicy] = {
        OnRobotContact.DISPLACE: Displace(),
        OnRobotContact.REMOVE: Remove(),
    }
    settings = parameters.collisions
    policy = policies.get(settings.on_robot_contact, Hold())
    return CollisionResolver(policy, settings.search_radius, parameters.robot.clearance)


def grid_augmentation(parameters: Parameters) -> GridAugmentation:
    """Return what keeps both grids."""
    costmap = InflatedCostmap(
        parameters.costmap.inflation_radius,
        parameters.costmap.cost_scaling_factor,
        robot_footprint(parameters.robot).inscribed_radius_m,
    )
    return GridAugmentation(costmap, parameters.augmented_map.max_rate)


def set_static_frames(parameters: Parameters, frames: FrameTree) -> None:
    """Put the static transforms of `frames.static` into the tree; ParameterError if one is bad."""
    for parent, child, transform in parse_static_transforms(parameters.frames.static):
        frames.set_static(
            parent,
            child,
            transform.translation_m.tolist(),
            transform.rotation_xyzw.tolist(),
            source=TransformSource.PARAMETER,
        )


def parse_static_transforms(texts: Iterable[str]) -> list[tuple[str, str, RigidTransform]]:
    """Return what `parse_static_transform` makes of each text.

    Raises ParameterError, also where two texts are about the same pair of frames, in either
    direction: it is not known which one holds.
    """
    transforms: list[tuple[str, str, RigidTransform]] = []
    said: dict[frozenset[str], str] = {}
    for text in texts:
        transforms.append(parse_static_transform(text))
        pair = frozenset(transforms[-1][:2])
        if pair in said:
            raise ParameterError(
                f"static transform '{text}': another, '{said[pair]}', is about the same two frames;"
                " give one of them"
            )
        said[pair] = text
    return transforms


def replaced_statics(old: Sequence[str], new: Sequence[str]) -> tuple[str, ...]:
    """Return static transforms with others in place of those about the same frames.

    Raises ParameterError where one of them cannot be parsed.
    """
    pairs = {frozenset(parse_static_transform(text)[:2]) for text in new}
    kept = (text for text in old if frozenset(parse_static_transform(text)[:2]) not in pairs)
    return (*kept, *new)


def parse_static_transform(text: str) -> tuple[str, str, RigidTransform]:
    """Return (parent, child, parent_from_child) of "X Y Z YAW PITCH ROLL PARENT CHILD".

    Metres and radians, in the order that static_transform_publisher made familiar. Raises
    ParameterError.
    """
    words = text.split()
    if len(words) != len(_STATIC_FORM.split()):
        raise ParameterError(f"static transform '{text}': it is not of the form {_STATIC_FORM}")
    try:
        numbers = [float(word) for word in words[:6]]
    except ValueError as cause:
        message = f"static transform '{text}': its first six words are not all numbers"
        raise ParameterError(message) from cause
    if not all(math.isfinite(number) for number in numbers):
        raise ParameterError(f"static transform '{text}': a number is not finite")
    parent, child = words[6].lstrip("/"), words[7].lstrip("/")
    if not parent or not child or parent == child:
        raise ParameterError(f"static transform '{text}': parent and child must be two frames")
    return parent, child, RigidTransform.from_xyz_ypr(*numbers)
