"""The choices that parameters offer, each an Enum of the string that YAML and ROS know."""

from enum import Enum


class Departures(Enum):
    """The meaning of the paper's leaving rate mu (section 3.2)."""

    INDEPENDENT = "independent"
    CONSTANT_RATE = "constant_rate"


class Region(Enum):
    """Where artefacts may arrive."""

    REACHABLE = "reachable"
    FREE = "free"
    ZONES = "zones"


class Initial(Enum):
    """How many artefacts are there when the region becomes known."""

    EMPTY = "empty"
    STATIONARY = "stationary"


class Appear(Enum):
    """Where in the region an artefact appears."""

    ANYWHERE = "anywhere"
    OUT_OF_VIEW = "out_of_view"
    ZONES = "zones"


class Leave(Enum):
    """How an artefact leaves at the end of its life."""

    VANISH = "vanish"
    WALK_TO_EXIT = "walk_to_exit"
    BY_EXIT = "by_exit"


class GroundKind(Enum):
    """The ground under the artefacts."""

    PLANE = "plane"
    VOXELS = "voxels"


class OdometryUse(Enum):
    """Whether odometry messages feed the frame tree."""

    AUTO = "auto"
    USE = "use"
    IGNORE = "ignore"


class CameraModel(Enum):
    """Which view model decides what is perceived."""

    AUTO = "auto"
    PINHOLE = "pinhole"
    OMNIDIRECTIONAL = "omnidirectional"


class Shape(Enum):
    """The geometry that stands for an artefact."""

    MESH = "mesh"
    BOX = "box"


class Labels(Enum):
    """Which artefacts have their label above them in rviz."""

    PERCEIVED = "perceived"
    ALL = "all"
    NONE = "none"


class CostmapGate(Enum):
    """Which artefacts enter the augmented map and the costmap."""

    PERCEIVED = "perceived"
    ALL = "all"


class SensorGate(Enum):
    """Which artefacts a sensor can meet."""

    GEOMETRY = "geometry"
    PERCEIVED = "perceived"
    ALL = "all"


class Light(Enum):
    """Where the light of what is painted into images comes from."""

    ESTIMATED = "estimated"
    GIVEN = "given"


class OnRobotContact(Enum):
    """How an artefact reacts when the robot drives into it."""

    AUTO = "auto"
    DISPLACE = "displace"
    HOLD = "hold"
    REMOVE = "remove"
