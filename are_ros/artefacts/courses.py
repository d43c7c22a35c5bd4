"""Where everybody is going, and what that is worth: kept where compiled code finds it."""

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from are_ros.artefacts._ground_kernels import Ground
from are_ros.artefacts._leg_kernels import CourseArrays, Ends, drop, list_of, put
from are_ros.artefacts._step_kernels import GroundArrays, Worth, WorthArrays
from are_ros.artefacts.behaviours.intent import Point
from are_ros.artefacts.coarse_map import MAPS_KEPT, CoarseMap
from are_ros.artefacts.traveller import Traveller
from are_ros.artefacts.value_tables import ValueTable


class Course(NamedTuple):
    """Where one was going at its last decision, and how fast.

    What that is worth is the item of `Courses.arrays` with this number.
    """

    traveller: Traveller
    goal_m: Point
    speed_mps: float
    number: int


class Courses:
    """The courses of artefacts by id.

    `arrays` is a list of compiled code (`numba.typed.List`) of `CourseArrays`.
    """

    def __init__(self) -> None:
        self.clear()

    def clear(self) -> None:
        """Forget all, as of a map that is no longer."""
        self._courses: dict[int, Course] = {}
        self._grounds: dict[CoarseMap, GroundArrays] = {}
        self._free: list[int] = []
        self.arrays: Any = list_of(_NOTHING)
        drop(self.arrays, 0)  # nothing, but that it is compiled early

    def get(self, artefact_id: int) -> Course | None:
        """Return where one was going, None if that is not known."""
        return self._courses.get(artefact_id)

    def set_out(
        self,
        artefact_id: int,
        wanted: tuple[Traveller, Point, float],
        coarse: CoarseMap,
        table: ValueTable,
    ) -> Course:
        """Let one go somewhere else, by a table of values: who is wanted where, and how fast."""
        before = self._courses.get(artefact_id)
        course = Course(*wanted, self._new_number() if before is None else before.number)
        self._courses[artefact_id] = course
        traveller, goal_m, _ = wanted
        ends = (
            min(traveller.radius_m, coarse.radius_m),
            goal_m,
            table.goal_m,
            traveller.others_price,
            traveller.robot_price,
        )
        put(self.arrays, course.number, (self._ground(coarse), _worth(table.worth), ends))
        return course

    def forget(self, artefact_id: int) -> None:
        """Forget where somebody was going, known or not."""
        course = self._courses.pop(artefact_id, None)
        if course is not None:
            drop(self.arrays, course.number)
            self._free.append(course.number)

    def _new_number(self) -> int:
        """Return a number that is free, or the next one."""
        return self._free.pop() if self._free else 1 + len(self._courses)

    def _ground(self, coarse: CoarseMap) -> GroundArrays:
        """Return what kernels take of a coarse map, frozen once for all who use it."""
        if coarse not in self._grounds:
            if len(self._grounds) >= MAPS_KEPT:
                self._grounds.clear()
            self._grounds[coarse] = _ground(coarse.ground)
        return self._grounds[coarse]


def _ground(ground: Ground) -> GroundArrays:
    is_main, clearance_m, lattice, anchors_m, *numbers = ground
    return *map(_frozen, (is_main, clearance_m, lattice, anchors_m)), *numbers


def _worth(worth: Worth) -> WorthArrays:
    return tuple(_frozen(array) for array in worth)


def _frozen(array: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Return a read-only view, contiguous: the arrays of all courses have to be of one type."""
    view = np.ascontiguousarray(array)[...]
    view.flags.writeable = False
    return view


_NO_GROUND = Ground(
    np.zeros((0, 0), np.bool_),
    np.zeros((0, 0), np.float32),
    np.zeros(6),
    np.zeros((0, 0, 2)),
    0.0,
    0,
    0,
)
_NO_WORTH = Worth(
    np.zeros((0, 4, 0, 0), np.float32),
    np.zeros((4, 0, 0), np.uint8),
    np.zeros((5, 0, 0), np.float32),
    np.zeros((0, 0), np.float32),
    np.zeros(9),
)
_NOTHING: CourseArrays = (
    _ground(_NO_GROUND),
    _worth(_NO_WORTH),
    tuple(Ends(0.0, (0.0, 0.0), (0.0, 0.0), 0.0, 0.0)),
)
"""Item 0 of the arrays, which is no course's, and where one was that is forgotten."""
