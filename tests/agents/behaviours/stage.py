"""Situations made by hand, and a stage on which actors go straight to where they want to be."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from are_ros.agents.behaviours.open_view import OpenView
from are_ros.agents.behaviours.situation import (
    Behaviour,
    Intent,
    Neighbour,
    Point,
    RobotView,
    Situation,
)
from are_ros.agents.navigation.destinations import Destinations
from are_ros.conventions import NS_PER_S
from are_ros.population.catalogue import CatalogueRow, MotionLimits
from are_ros.population.meshes.shapes import Shape
from are_ros.population.randomness import Purpose, generator

WALKER = MotionLimits(1.2, 1.5, 3.0, 0.0, 2.0)
NO_WALLS: tuple[tuple[Point, Point], ...] = ()


def row_of(motion: MotionLimits = WALKER) -> CatalogueRow:
    """Return a row that moves like this."""
    size_m = (0.3, 0.5, 1.7)
    return CatalogueRow(0, "somebody", "person", size_m, (0, 0, 0), Shape.PERSON, motion=motion)


def places_at(destinations_m: Sequence[Point], exits_m: Sequence[Point] = ()) -> Destinations:
    """Return places of lists of points."""
    return Destinations(
        np.array(destinations_m, dtype=float).reshape(-1, 2),
        np.array(exits_m, dtype=float).reshape(-1, 2),
    )


def lattice(count: int = 5, spacing_m: float = 5.0) -> Destinations:
    """Return count x count destinations about (0, 0)."""
    steps = (np.arange(count) - (count - 1) / 2) * spacing_m
    return places_at([(x, y) for x in steps.tolist() for y in steps.tolist()])


def fellow_at(
    point_m: Point,
    artefact_id: int = 1,
    velocity_mps: Point = (0.0, 0.0),
    behaviour: str = "walking",
    activity: str = "walking",
) -> Neighbour:
    """Return somebody at a point, who looks where it goes."""
    yaw_rad = math.atan2(velocity_mps[1], velocity_mps[0])
    return Neighbour(
        artefact_id, "person", "x", *point_m, yaw_rad, *velocity_mps, 0.3, behaviour, activity
    )


def robot_at(
    point_m: Point, velocity_mps: Point = (0.5, 0.0), plan_m: Sequence[Point] = ()
) -> RobotView:
    """Return the robot, who looks where it goes."""
    yaw_rad = math.atan2(velocity_mps[1], velocity_mps[0])
    plan = np.array(plan_m, dtype=float).reshape(-1, 2)
    return RobotView(*point_m, yaw_rad, *velocity_mps, 0.22, plan)


def stream(seed: int = 7, artefact_id: int = 0) -> np.random.Generator:
    """Return the stream of an artefact's behaviour."""
    return generator(seed, Purpose.BEHAVIOUR, artefact_id)


@dataclass
class Actor:
    """An artefact on the stage: a disc that goes straight to its goal."""

    id: int
    behaviour: Behaviour
    point_m: Point
    row: CatalogueRow = field(default_factory=row_of)
    seed: int = 7
    velocity_mps: Point = (0.0, 0.0)
    last: Intent | None = None
    arrived: bool = False
    blocked_s: float = 0.0
    no_way: bool = False

    def __post_init__(self) -> None:
        self.random = stream(self.seed, self.id)

    def as_fellow(self) -> Neighbour:
        """Return it as others see it."""
        activity = self.last.activity if self.last else ""
        name = self.behaviour.name
        return fellow_at(self.point_m, self.id, self.velocity_mps, name, activity)

    def situation(
        self,
        view: OpenView,
        places: Destinations,
        robot: RobotView | None = None,
        now_s: float = 0.0,
    ) -> Situation:
        """Return what it knows."""
        return Situation(
            round(now_s * NS_PER_S),
            self.as_fellow(),
            self.row,
            places,
            self.random,
            view,
            robot,
            last=self.last,
            arrived=self.arrived,
            blocked_s=self.blocked_s,
            blocked_by="a wall" if self.blocked_s else "",
            no_way=self.no_way,
        )

    def decide(
        self,
        view: OpenView,
        places: Destinations,
        robot: RobotView | None = None,
        now_s: float = 0.0,
    ) -> Intent:
        """Let it decide on what it sees."""
        self.last = self.behaviour.decide(self.situation(view, places, robot, now_s))
        self.arrived = self.no_way = False
        return self.last

    def move(self, seconds: float = 1.0) -> None:
        """Go straight to the goal."""
        intent, start_m = self.last, self.point_m
        if intent is not None and intent.goal_m is not None:
            apart_m = math.dist(start_m, intent.goal_m)
            length_m = min(intent.speed_mps * seconds, apart_m)
            share = length_m / apart_m if apart_m else 0.0
            self.point_m = (
                start_m[0] + share * (intent.goal_m[0] - start_m[0]),
                start_m[1] + share * (intent.goal_m[1] - start_m[1]),
            )
            self.arrived = math.dist(self.point_m, intent.goal_m) <= intent.arrive_within_m
        self.velocity_mps = (
            (self.point_m[0] - start_m[0]) / seconds,
            (self.point_m[1] - start_m[1]) / seconds,
        )


@dataclass
class Stage:
    """Actors in a plane with a few walls, who decide once a second on what they all did before."""

    actors: list[Actor]
    places: Destinations = field(default_factory=lattice)
    robot: RobotView | None = None
    walls_m: Sequence[tuple[Point, Point]] = ()
    now_s: float = 0.0

    def step(self) -> list[Intent]:
        """Run a second; return what each wanted."""
        view = OpenView([actor.as_fellow() for actor in self.actors], self.walls_m)
        intents = [a.decide(view, self.places, self.robot, self.now_s) for a in self.actors]
        for actor in self.actors:
            actor.move()
        self.now_s += 1.0
        if self.robot is not None:
            robot = self.robot
            point_m = (robot.x_m + robot.vx_mps, robot.y_m + robot.vy_mps)
            plan_m: npt.NDArray[np.float64] = robot.plan_m
            self.robot = robot_at(point_m, (robot.vx_mps, robot.vy_mps), plan_m.tolist())
        return intents


def alone(
    actor: Actor,
    places: Destinations | None = None,
    neighbours: Sequence[Neighbour] = (),
    walls_m: Sequence[tuple[Point, Point]] = NO_WALLS,
    robot: RobotView | None = None,
    now_s: float = 0.0,
) -> Intent:
    """Let one actor decide beside fellows made by hand."""
    view = OpenView([*neighbours, actor.as_fellow()], walls_m)
    return actor.decide(view, lattice() if places is None else places, robot, now_s)
