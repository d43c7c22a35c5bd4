"""The space Q of artefact types (section 3.2): one row per tuple, in blocks of one class each."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from difflib import get_close_matches
from functools import cached_property
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt

from are_ros.errors import CatalogueError
from are_ros.population.meshes.shapes import Shape


@dataclass(frozen=True)
class MeshFile:
    """A user-defined mesh, and how to read it.

    `metres_per_unit` already contains the row's own scale. `up` and `forward` are the axes of the
    file (`x`, `-x`, `y`, ...) that become +z and +x of F_A.
    """

    path: Path
    metres_per_unit: float = 1.0
    up: str = "z"
    forward: str = "x"


TOLD: Final = ("activity", "planner")
"""Published among the features of an artefact, for what it does; no feature has these names."""


@dataclass(frozen=True)
class MotionLimits:
    """The limits of a type's motion: speed [m/s], acceleration [m/s^2], turning.

    `turn_rate_radps` limits the change of yaw [rad/s], `turn_radius_m` is the radius of the
    smallest circle [m] (0: it turns on the spot). A speed of 0 means that it never moves. The speed
    is that of walking and driving; running is `running_factor` (>= 1) times as fast.
    """

    speed_mps: float = 0.0
    acceleration_mps2: float = 1.0
    turn_rate_radps: float = 1.0
    turn_radius_m: float = 0.0
    running_factor: float = 1.8

    @property
    def top_speed_mps(self) -> float:
        """The highest speed, that of running [m/s]."""
        return self.speed_mps * self.running_factor


@dataclass(frozen=True)
class RewardWeights:
    """Weights >= 0 of the rewards and costs of the type's decision process (section 3.2).

    `effort` and `rest` are shares of what running saves, and what stopping costs, of the price of
    time: at 1 an artefact that is not late does not mind. A late one loses `late` times the price
    of what is left of its way.
    """

    goal: float = 1.0
    time: float = 0.1
    clearance: float = 0.5
    personal_space: float = 0.5
    robot: float = 1.0
    effort: float = 1.05
    rest: float = 0.95
    late: float = 3.0


@dataclass(frozen=True, eq=False)
class CatalogueRow:
    """One tuple Q: label l, box b and features Phi of an artefact, with mesh, motion, behaviours.

    Frame F_A has its origin at the centre of mass of the mesh (of the mesh's convex hull if it is
    not watertight), +x forward, +z up. The box is the mesh's axis-aligned bounding box in F_A, of
    `size_m` (x, y, z), centred at `box_centre_in_artefact_m`. Mesh and box are rigid. `colour` is
    (red, green, blue, alpha), each in [0, 1]. `behaviours` maps a behaviour's name to its
    probability, `planners` a planner's. `slip` is the probability that a move does not succeed,
    None for that of the parameters. A row with `forever` gives artefacts that never depart.
    """

    index: int
    label: str
    class_name: str
    size_m: tuple[float, float, float]
    box_centre_in_artefact_m: tuple[float, float, float]
    surface: Shape | MeshFile
    colour: tuple[float, float, float, float] = (0.7, 0.7, 0.7, 1.0)
    forever: bool = False
    motion: MotionLimits = field(default_factory=MotionLimits)
    behaviours: Mapping[str, float] = field(default_factory=lambda: {"standing": 1.0})
    planners: Mapping[str, float] = field(default_factory=lambda: {"dynamic_window": 1.0})
    rewards: RewardWeights = field(default_factory=RewardWeights)
    slip: float | None = None
    features: Mapping[str, str] = field(default_factory=dict)

    @property
    def com_height_m(self) -> float:
        """Height of F_A above the ground when the bottom of the box stands on it."""
        return 0.5 * self.size_m[2] - self.box_centre_in_artefact_m[2]


@dataclass(frozen=True, eq=False)
class Catalogue:
    """The rows in the order of their index; the rows of a class are contiguous."""

    rows: tuple[CatalogueRow, ...]

    @cached_property
    def class_names(self) -> tuple[str, ...]:
        """Names of the classes in the order of their blocks."""
        return tuple(dict.fromkeys(row.class_name for row in self.rows))

    def rows_named(self, name: str) -> tuple[CatalogueRow, ...]:
        """Return the row with this label, or else the rows of the class with this name.

        An unknown name raises `CatalogueError`.
        """
        found = tuple(row for row in self.rows if row.label == name)
        found = found or tuple(row for row in self.rows if row.class_name == name)
        if not found:
            labels = dict.fromkeys((*(row.label for row in self.rows), *self.class_names))
            near = get_close_matches(name, labels, n=1)
            classes = f"its classes are {', '.join(self.class_names)}"
            hint = f"did you mean {near[0]!r}?" if near else classes
            raise CatalogueError(f"the catalogue has no row and no class named {name!r}; {hint}")
        return found

    def class_probabilities(
        self, row_probabilities: npt.NDArray[np.float64]
    ) -> npt.NDArray[np.float64]:
        """Sum float64 (rows,) probabilities over each class: (classes,), as `class_names`."""
        of_row = [row.class_name for row in self.rows]
        starts = [of_row.index(name) for name in self.class_names]
        return np.add.reduceat(row_probabilities, starts)
