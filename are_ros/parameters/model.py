"""Every parameter of ARE, declared once: default, unit, bounds, meaning.

The YAML file, the ROS descriptors and the table in the docs derive from these classes.
"""

import math
from dataclasses import dataclass, field
from typing import Final

from are_ros.parameters.choices import (
    Appear,
    CameraModel,
    CostmapGate,
    Departures,
    GroundKind,
    Initial,
    Labels,
    Leave,
    Light,
    OdometryUse,
    OnRobotContact,
    Region,
    SensorGate,
    Shape,
)
from are_ros.parameters.declaration import parameter


@dataclass(frozen=True)
class BuilderParameters:
    """The AR-builder's own pace."""

    tick_rate: float = parameter(
        10.0,
        "Ticks per second; tick k runs at k periods since the epoch.",
        unit="Hz",
        bounds=(0.5, 100.0),
    )


@dataclass(frozen=True)
class PopulationParameters:
    """The birth-death process (section 3.2)."""

    arrival_rate: float = parameter(
        0.0005,
        "Rate lambda of arrivals per area and time; of groups, if they have more than one member.",
        unit="1/(m^2 s)",
        bounds=(0.0, 10.0),
        live=True,
    )
    mean_life: float = parameter(
        60.0, "Mean life 1/mu of an artefact.", unit="s", bounds=(0.001, 1e7), live=True
    )
    departures: Departures = parameter(
        Departures.INDEPENDENT,
        "independent: each life is exponential, death rate i*mu. "
        "constant_rate: the paper's transition matrix, death rate mu.",
    )
    initial: Initial = parameter(
        Initial.EMPTY,
        "How many are there at the beginning, and after a jump of the clock: nobody, or as many as "
        "after a long time, anywhere in the region of that moment; what a growing map adds later "
        "begins empty.",
    )
    max_alive: int = parameter(
        200,
        "Bound on artefacts alive at once; arrivals beyond it are blocked.",
        bounds=(0, 100_000),
        live=True,
    )
    group_size: float = parameter(
        1.0, "Mean size g of an arriving group: 1 + Poisson(g - 1).", bounds=(1.0, 100.0), live=True
    )
    group_radius: float = parameter(
        2.0,
        "Members of a group are placed within this of the first.",
        unit="m",
        bounds=(0.1, 100.0),
        live=True,
    )
    region: Region = parameter(
        Region.REACHABLE,
        "Where artefacts arrive: the free space that the robot can reach, all free space, "
        "or the polygons of population.zones.",
    )
    zones: str = parameter(
        "", "YAML file of polygons: zones with weights, no_spawn, entrances, exits."
    )
    scenario: str = parameter(
        "", "YAML file of scripted artefacts beside the random ones, or instead of them."
    )
    appear: Appear = parameter(
        Appear.ANYWHERE,
        "Where in the region artefacts appear: anywhere, where no camera sees them, "
        "or in the entrances of population.zones.",
        live=True,
    )
    leave: Leave = parameter(
        Leave.VANISH,
        "At the end of its life an artefact vanishes, or walks to an exit and vanishes there. "
        "With by_exit it walks to an exit out of the robot's sight before, and vanishes at the end "
        "of its life.",
        live=True,
    )
    exit_patience: float = parameter(
        60.0,
        "An artefact that is to leave but reaches no exit vanishes after this time.",
        unit="s",
        bounds=(0.0, 1e6),
        live=True,
    )


@dataclass(frozen=True)
class MixtureParameters:
    """The Poisson mixture that picks the row of an artefact (Eq. 1)."""

    weights: tuple[float, ...] = parameter(
        (0.7, 0.12, 0.08, 0.02, 0.08),
        "Weights pi of the components; they sum to 1.",
        bounds=(0.0, 1.0),
        live=True,
    )
    rates: tuple[float, ...] = parameter(
        (15.0, 7.0, 3.0, 21.0, 5.0), "Rates lambda of the components.", bounds=(0.0, 1e6), live=True
    )


@dataclass(frozen=True)
class WorldParameters:
    """How the real environment is read (section 3.1)."""

    occupied_threshold: int = parameter(
        65, "A cell of the map is occupied from this value on.", bounds=(1, 100)
    )
    free_threshold: int = parameter(25, "A cell is free up to this value.", bounds=(0, 99))
    wall_height: float = parameter(
        2.5,
        "Height of walls extruded from the map where there is no cloud.",
        unit="m",
        bounds=(0.01, 100.0),
    )
    voxel_size: float = parameter(
        0.0,
        "Edge of a voxel, the cloud's own or coarser; 0: the cloud's own, inferred from it.",
        unit="m",
        bounds=(0.0, 10.0),
    )
    ground: GroundKind = parameter(
        GroundKind.PLANE,
        "What artefacts stand on: the plane z = ground_height, or the floor voxels.",
    )
    ground_height: float = parameter(
        0.0, "Height of the ground plane in the map's frame.", unit="m", bounds=(-1e4, 1e4)
    )
    ground_clearance: float = parameter(
        0.0,
        "Voxels whose top is within this above the ground are floor; 0: one voxel plus 1 cm.",
        unit="m",
        bounds=(0.0, 10.0),
    )


@dataclass(frozen=True)
class FramesParameters:
    """The frame tree (section 3.3)."""

    map: str = parameter("map", "The world frame F_E: that of the map.")
    odom: str = parameter(
        "odom",
        "The odometry frame; map->odom may be held for late sensor data. Without a frame of this"
        " name it is that in which the base moves.",
    )
    base: str = parameter(
        "",
        "The robot's base F_R; empty: base_footprint, else base_link, whichever there is. A replay "
        "also finds such a name in a namespace, else takes the child frame of the odometry.",
    )
    max_age: float = parameter(
        0.5, "Oldest robot pose that a tick accepts.", unit="s", bounds=(0.0, 60.0)
    )
    odometry: OdometryUse = parameter(
        OdometryUse.AUTO,
        "Whether odometry messages feed the tree: auto lets tf override them edge by edge, "
        "use prefers them, ignore drops them.",
    )
    static: tuple[str, ...] = parameter(
        (), 'Static transforms, each "X Y Z YAW PITCH ROLL PARENT CHILD" in metres and radians.'
    )


@dataclass(frozen=True)
class RobotParameters:
    """The robot's shape."""

    footprint: str = parameter(
        "", 'Footprint on the base in Nav2\'s form "[[x, y], ...]"; empty: a disc of robot.radius.'
    )
    radius: float = parameter(0.22, "Radius of a round robot.", unit="m", bounds=(0.001, 100.0))
    clearance: float = parameter(
        0.5,
        "Artefacts arrive at least this far from the robot.",
        unit="m",
        bounds=(0.0, 100.0),
        live=True,
    )


@dataclass(frozen=True)
class CameraParameters:
    """The view model F_view (section 3.3)."""

    model: CameraModel = parameter(
        CameraModel.AUTO,
        "auto: CameraInfo where there is one, else a pinhole from these parameters; "
        "pinhole, omnidirectional: from these parameters, whatever CameraInfo says.",
    )
    frame: str = parameter(
        "",
        "Optical frame (z forward, x right, y down); empty: that of CameraInfo, else camera.mount.",
    )
    mount: tuple[float, ...] = parameter(
        (0.0, 0.0, 1.0, 0.0, 0.0, 0.0),
        "Where a camera without a frame sits on the base, looking along +x: "
        "x, y, z [m], yaw, pitch, roll [rad].",
    )
    width: int = parameter(640, "Width of the view.", unit="px", bounds=(1, 10_000))
    height: int = parameter(480, "Height of the view.", unit="px", bounds=(1, 10_000))
    hfov: float = parameter(
        math.pi / 2, "Horizontal field of view of the pinhole.", unit="rad", bounds=(0.01, 3.1)
    )
    vfov: float = parameter(
        math.pi / 2,
        "Vertical field of view of the omnidirectional model.",
        unit="rad",
        bounds=(0.01, math.pi),
    )
    rate: float = parameter(
        10.0, "Perception runs at most this often, on ticks.", unit="Hz", bounds=(0.01, 1000.0)
    )
    rectified: bool = parameter(
        False, "The view is that of the rectified image (P), not of the raw one (K and D)."
    )
    others: tuple[str, ...] = parameter(
        (),
        "Topics of the CameraInfo of further cameras on the robot; perceived is what any camera "
        "sees.",
    )
    other_rates: tuple[float, ...] = parameter(
        (10.0,),
        "How often each of camera.others looks at most, on ticks; the last holds for all further.",
        unit="Hz",
        bounds=(0.01, 1000.0),
    )

    @property
    def rates(self) -> tuple[float, ...]:
        """How often each camera looks, the robot's first [Hz]."""
        rates, count = self.other_rates, len(self.others)
        return (self.rate, *(rates + rates[-1:] * count)[:count])


@dataclass(frozen=True)
class OcclusionParameters:
    """The z-buffer (Eq. 2)."""

    tau: int = parameter(
        50,
        "An artefact is perceived when more than tau of its pixels are visible.",
        unit="px",
        bounds=(0, 100_000_000),
        live=True,
    )
    max_range: float = parameter(30.0, "Longest viewing ray d_max.", unit="m", bounds=(0.1, 1000.0))
    shape: Shape = parameter(Shape.MESH, "Shape of the other artefacts as occluders.", live=True)
    target: Shape = parameter(
        Shape.BOX,
        "Whose visible pixels count: those of the artefact's box, as in the paper, or of its mesh, "
        "which requires occlusion.shape: mesh.",
        live=True,
    )
    mutual: bool = parameter(True, "Artefacts hide each other.", live=True)


@dataclass(frozen=True)
class CertaintyParameters:
    """What a detector and a tracker make of the perceived artefacts (docs/certainty.md)."""

    enabled: bool = parameter(
        False, "What is perceived is what a detector and a tracker would give; false: exactly A_f."
    )
    detection: float = parameter(
        0.97,
        "Probability that a look detects an artefact that is near and wholly visible.",
        bounds=(0.0, 1.0),
        live=True,
    )
    half_fraction: float = parameter(
        0.25,
        "Visible fraction at which the probability of detection is halved; 0: it plays no part.",
        bounds=(0.0, 1.0),
        live=True,
    )
    half_range: float = parameter(
        15.0,
        "Range at which the probability of detection is halved; 0: it plays no part.",
        unit="m",
        bounds=(0.0, 1000.0),
        live=True,
    )
    class_accuracy: float = parameter(
        0.85,
        "Probability that a look at the class names the true one; otherwise any other.",
        bounds=(0.01, 1.0),
        live=True,
    )
    class_time: float = parameter(
        1.0,
        "Time between two independent looks at the class of an artefact.",
        unit="s",
        bounds=(0.0, 1000.0),
        live=True,
    )
    behaviour_accuracy: float = parameter(
        0.0,
        "Probability that a look at the behaviour names the true one; otherwise any other. "
        "0: nothing is told of behaviours.",
        bounds=(0.0, 1.0),
        live=True,
    )
    behaviour_time: float = parameter(
        1.0,
        "Time between two independent looks at the behaviour of an artefact.",
        unit="s",
        bounds=(0.0, 1000.0),
        live=True,
    )
    position_noise: float = parameter(
        0.04,
        "Standard deviation of a detected position at range 0.",
        unit="m",
        bounds=(0.0, 100.0),
        live=True,
    )
    range_noise: float = parameter(
        0.02,
        "Growth of the deviation along the line of sight with the range.",
        unit="m/m",
        bounds=(0.0, 1.0),
        live=True,
    )
    bearing_noise: float = parameter(
        0.005,
        "Standard deviation of the direction in which an artefact is detected.",
        unit="rad",
        bounds=(0.0, 1.0),
        live=True,
    )
    yaw_noise: float = parameter(
        0.15, "Standard deviation of a detected heading.", unit="rad", bounds=(0.0, 1.0), live=True
    )
    speed_noise: float = parameter(
        0.6,
        "Standard deviation of each component of the velocity when a track begins.",
        unit="m/s",
        bounds=(0.0, 100.0),
        live=True,
    )
    turn_noise: float = parameter(
        0.5,
        "Standard deviation of the yaw rate when a track begins.",
        unit="rad/s",
        bounds=(0.0, 100.0),
        live=True,
    )
    acceleration: float = parameter(
        0.5,
        "How much an artefact may accelerate, as the tracker has it: the density of white noise.",
        unit="m/s^1.5",
        bounds=(0.0, 100.0),
        live=True,
    )
    turn_acceleration: float = parameter(
        0.5, "The same for its yaw rate.", unit="rad/s^1.5", bounds=(0.0, 100.0), live=True
    )
    coast: float = parameter(
        1.0,
        "How long a track goes on without a detection.",
        unit="s",
        bounds=(0.0, 1000.0),
        live=True,
    )
    min_existence: float = parameter(
        0.1,
        "A track is published from this probability of existence on.",
        bounds=(0.0, 1.0),
        live=True,
    )
    false_alarm_rate: float = parameter(
        0.02,
        "Rate of new false alarms while the camera looks.",
        unit="1/s",
        bounds=(0.0, 100.0),
        live=True,
    )
    false_alarm_life: float = parameter(
        0.5,
        "Mean time for which a false alarm goes on being detected.",
        unit="s",
        bounds=(0.001, 1000.0),
        live=True,
    )
    latency: float = parameter(
        0.1,
        "The list tells how things were this long ago, at least.",
        unit="s",
        bounds=(0.0, 10.0),
        live=True,
    )
    prediction_horizon: float = parameter(
        2.0,
        "How far ahead ~/predicted tells paths; 0: there is no such topic.",
        unit="s",
        bounds=(0.0, 60.0),
    )
    prediction_step: float = parameter(
        0.5, "Time between two poses of a predicted path.", unit="s", bounds=(0.01, 60.0)
    )
    applies_to_sensors: bool = parameter(
        False,
        "With sensors.gate: perceived, sensors meet the artefacts that ~/perceived lists, not A_f.",
        live=True,
    )


@dataclass(frozen=True)
class CostmapParameters:
    """The gate of both grids, and Nav2's inflation."""

    gate: CostmapGate = parameter(
        CostmapGate.PERCEIVED, "Artefacts in the grids: those perceived, or all.", live=True
    )
    memory: float = parameter(
        0.0,
        "How long an artefact stays in the grids after it was last perceived.",
        unit="s",
        bounds=(0.0, 1e6),
        live=True,
    )
    inflation_radius: float = parameter(
        0.70, "Radius of the inflation.", unit="m", bounds=(0.0, 100.0)
    )
    cost_scaling_factor: float = parameter(
        3.0, "Decay of the inflated cost.", unit="1/m", bounds=(0.0, 1000.0)
    )


@dataclass(frozen=True)
class AugmentedMapParameters:
    """How often grids go out."""

    max_rate: float = parameter(
        5.0,
        "Moves reach the grids at most this often; arrivals and departures at once.",
        unit="Hz",
        bounds=(0.01, 100.0),
        live=True,
    )


@dataclass(frozen=True)
class BehaviourParameters:
    """The decision processes of the artefacts (section 3.2)."""

    cell_size: float = parameter(
        0.5, "Edge of a cell of the grid that decisions are made on.", unit="m", bounds=(0.1, 10.0)
    )
    decision_period: float = parameter(
        1.0,
        "Time between two decisions of an artefact, from its arrival on.",
        unit="s",
        bounds=(0.1, 60.0),
    )
    max_horizon: float = parameter(
        40.0,
        "Longest time that a decision looks ahead; at most what is left of the life.",
        unit="s",
        bounds=(1.0, 600.0),
    )
    slip: float = parameter(
        0.02,
        "Probability that a move does not succeed: half of the time it fails, else it goes to "
        "either side. A row of the catalogue may give its own.",
        bounds=(0.0, 1.0),
    )
    temperature: float = parameter(
        0.025,
        "Temperature T of the policy: 0 takes the best action; the higher, the more the shares of "
        "the catalogue decide. A person's epoch is worth 0.2.",
        bounds=(0.0, 1e9),
    )
    persistence: float = parameter(
        30.0,
        "Mean time from one draw of an artefact's behaviour by the catalogue's shares to the next, "
        "when nothing else speaks.",
        unit="s",
        bounds=(0.0, 1e9),
    )


@dataclass(frozen=True)
class MotionParameters:
    """The integration of motion."""

    step: float = parameter(
        0.05,
        "Sub-step of motion and collisions, at multiples since the epoch.",
        unit="s",
        bounds=(0.001, 1.0),
    )


@dataclass(frozen=True)
class PosesParameters:
    """The poses of artefacts as functions of time."""

    history: float = parameter(
        2.0,
        "How far back the poses of artefacts are known, for late sensor data.",
        unit="s",
        bounds=(0.0, 60.0),
    )


@dataclass(frozen=True)
class CollisionsParameters:
    """The remedies for collisions (section 3.3)."""

    search_radius: float = parameter(
        2.0, "How far a displaced artefact may be moved.", unit="m", bounds=(0.0, 100.0), live=True
    )
    on_robot_contact: OnRobotContact = parameter(
        OnRobotContact.AUTO,
        "How an artefact reacts when the robot drives into it: it is displaced, holds its place, "
        "or is removed. auto: hold in the live node and the demo, where a robot can react; "
        "displace in a replay. So a contact has another outcome in the two unless this is set.",
    )


INFO_MARK: Final = ":="
"""Stands between the topics of images and of their CameraInfo, as in a remapping of ROS."""


@dataclass(frozen=True)
class SensorsParameters:
    """The augmented sensor data."""

    gate: SensorGate = parameter(
        SensorGate.GEOMETRY,
        "Artefacts that sensor rays can hit: geometry and all are the same, every artefact; "
        "perceived, only the perceived ones.",
        live=True,
    )
    shape: Shape = parameter(Shape.MESH, "Shape of the artefacts that sensor rays hit.", live=True)
    tf_wait: float = parameter(
        0.2,
        "How long a scan waits at most for the transform at its stamp. 0.2 s are enough for poses "
        "at 10 Hz with a delay of 0.1 s.",
        unit="s",
        bounds=(0.0, 10.0),
        live=True,
    )
    scans: tuple[str, ...] = parameter(("scan",), "Topics of the laser scans to augment.")
    ranges: tuple[str, ...] = parameter(
        (), "Topics of the range sensors (sonar, infrared) to augment."
    )
    clouds: tuple[str, ...] = parameter(
        ("points",), "Topics of the point clouds of lasers and depth cameras to augment."
    )
    depths: tuple[str, ...] = parameter(
        ("depth",),
        "Topics of the depth images to augment, raw or .../compressedDepth; their CameraInfo comes "
        "on camera_info beside them.",
    )
    images: tuple[str, ...] = parameter(
        ("image",),
        "Topics of the camera images to paint artefacts into, raw or .../compressed; their "
        "CameraInfo comes on camera_info beside them.",
    )
    camera_infos: tuple[str, ...] = parameter(
        (),
        "The CameraInfo of images that have none beside them, as /image:=/camera_info. A replay "
        "finds one of the same frame and size by itself.",
    )
    masks: bool = parameter(
        False,
        "Beside each painted image goes its mask (32SC1): the id of the artefact at each pixel, 0 "
        "where there is none.",
    )
    boxes: bool = parameter(
        False,
        "Beside each painted image go the boxes of the artefacts in it (are_msgs/ImageTruth, and "
        "vision_msgs), and beside the lists of artefacts and of the perceived their boxes in the "
        "map (vision_msgs).",
    )
    depth_range: float = parameter(
        10.0,
        "How far depth cameras see: a pixel without a return shows no artefact beyond it. "
        "0: as far as the encoding tells.",
        unit="m",
        bounds=(0.0, 1000.0),
        live=True,
    )

    @property
    def info_by_image(self) -> dict[str, str]:
        """The topics of `camera_infos`: of the CameraInfo, by that of the images."""
        return dict(text.split(INFO_MARK, 1) for text in self.camera_infos)


@dataclass(frozen=True)
class RenderingParameters:
    """How artefacts are painted into images (docs/images.md)."""

    light: Light = parameter(
        Light.ESTIMATED,
        "estimated: as bright and as warm as the image; given: rendering.brightness alone.",
        live=True,
    )
    brightness: float = parameter(
        1.0,
        "Multiplies the estimated light, or is the light itself.",
        bounds=(0.0, 10.0),
        live=True,
    )
    lamp_azimuth: float = parameter(
        0.7,
        "Where the lamp stands, in the map's frame.",
        unit="rad",
        bounds=(-10.0, 10.0),
        live=True,
    )
    lamp_elevation: float = parameter(
        1.0, "How high the lamp stands.", unit="rad", bounds=(-1.58, 1.58), live=True
    )
    shadow: float = parameter(
        0.6, "Share of the light that is missing on the floor below.", bounds=(0.0, 1.0), live=True
    )
    blur: float = parameter(
        0.5, "Standard deviation of the lens's blur.", unit="px", bounds=(0.0, 20.0), live=True
    )
    noise: float = parameter(
        1.5,
        "Standard deviation of the sensor's noise, in steps of 8 bits.",
        bounds=(0.0, 100.0),
        live=True,
    )
    jpeg_quality: int = parameter(
        95, "Quality of the JPEGs into which something was painted.", bounds=(1, 100), live=True
    )


@dataclass(frozen=True)
class MarkersParameters:
    """What rviz shows."""

    shape: Shape = parameter(
        Shape.MESH, "Artefacts as meshes (TRIANGLE_LIST) or as their boxes (CUBE).", live=True
    )
    labels: Labels = parameter(
        Labels.PERCEIVED, "Which artefacts have their label shown above them.", live=True
    )
    environment: bool = parameter(
        False,
        "The surface of the environment as triangles (namespace environment): of the octomap, or "
        "of the walls; sent when it changes, and to a new viewer.",
        live=True,
    )


@dataclass(frozen=True)
class ClicksParameters:
    """What a click in rviz does."""

    label: str = parameter(
        "",
        "The artefact that a click in rviz places (topic clicked_point): a label or a class of the "
        "catalogue; empty: any row.",
        live=True,
    )


@dataclass(frozen=True)
class Parameters:
    """All parameters; paths are relative to this root."""

    seed: int = parameter(0, "Seed of every random draw.", bounds=(0, 2**63 - 1))
    catalogue: str = parameter("", "YAML file of artefact types; empty: the shipped catalogue.")
    builder: BuilderParameters = field(default_factory=BuilderParameters)
    population: PopulationParameters = field(default_factory=PopulationParameters)
    mixture: MixtureParameters = field(default_factory=MixtureParameters)
    world: WorldParameters = field(default_factory=WorldParameters)
    frames: FramesParameters = field(default_factory=FramesParameters)
    robot: RobotParameters = field(default_factory=RobotParameters)
    camera: CameraParameters = field(default_factory=CameraParameters)
    occlusion: OcclusionParameters = field(default_factory=OcclusionParameters)
    certainty: CertaintyParameters = field(default_factory=CertaintyParameters)
    costmap: CostmapParameters = field(default_factory=CostmapParameters)
    augmented_map: AugmentedMapParameters = field(default_factory=AugmentedMapParameters)
    behaviour: BehaviourParameters = field(default_factory=BehaviourParameters)
    motion: MotionParameters = field(default_factory=MotionParameters)
    poses: PosesParameters = field(default_factory=PosesParameters)
    collisions: CollisionsParameters = field(default_factory=CollisionsParameters)
    sensors: SensorsParameters = field(default_factory=SensorsParameters)
    rendering: RenderingParameters = field(default_factory=RenderingParameters)
    markers: MarkersParameters = field(default_factory=MarkersParameters)
    clicks: ClicksParameters = field(default_factory=ClicksParameters)
