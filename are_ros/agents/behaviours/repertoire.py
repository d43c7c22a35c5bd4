"""The behaviours among which one artefact chooses, with the shares of its row."""

from collections.abc import Mapping
from typing import Final

import numpy as np
import numpy.typing as npt

from are_ros.agents.behaviours.calls import (
    BehaviourCall,
    has_reward,
    reward_bounds_of,
    reward_of,
)
from are_ros.agents.behaviours.leaving import WalkingOut
from are_ros.agents.behaviours.registry import make_behaviour
from are_ros.agents.behaviours.situation import Behaviour, Situation
from are_ros.agents.behaviours.walking import Driving, Journey, Running, Stopping, Walking
from are_ros.population.artefact import Artefact

_TRAVELLING: Final[Mapping[str, type[Walking]]] = {
    kind.name: kind for kind in (Walking, Running, Driving, Stopping)
}
"""Behaviours that share one journey: an artefact that changes among them keeps its destination."""

_WALKS_AND_STOPS: Final = {Stopping.name: 1.0 / 3.0, Walking.name: 2.0 / 3.0}
"""For an artefact that has no other behaviour than stopping."""


class Repertoire:
    """B behaviours, the one in force, and the shares (B,) by which they are drawn, summing to 1."""

    def __init__(self, behaviours: Mapping[str, Behaviour], shares: Mapping[str, float]) -> None:
        """Take the behaviours and their shares by name; the first one is in force."""
        self.names = tuple(behaviours)
        self.shares = tuple(shares[name] for name in self.names)
        self.in_force = 0
        self._behaviours = tuple(behaviours.values())
        self.way_out = next((one for one in self._behaviours if type(one) is WalkingOut), None)
        travelling = [
            one
            for one in self._behaviours
            if isinstance(one, Walking) and type(one) in _TRAVELLING.values()
        ]
        self.journey = travelling[0].journey if travelling else None
        """The journey of the travelling behaviours, None if there are none."""
        self._rewarding = [
            (index, one) for index, one in enumerate(self._behaviours) if has_reward(one)
        ]
        self._moving = [one for one in travelling if type(one) is not Stopping]
        self._speeds_mps: tuple[float, ...] | None = None
        self._paces = [_pace_of(one) if one in self._moving else None for one in self._behaviours]

    @classmethod
    def of(cls, artefact: Artefact, call: BehaviourCall, *, by_exit: bool) -> "Repertoire":
        """Return the repertoire of an artefact, with the behaviour that it arrived with in force.

        One that may not change has only that; `by_exit` adds walking out. BehaviourError if a
        user-defined class fails.
        """
        shares = {artefact.behaviour: 1.0}
        if artefact.may_change:
            given = artefact.row.behaviours
            shares = {artefact.behaviour: 0.0, **{k: w for k, w in given.items() if w > 0.0}}
        if set(shares) == {Stopping.name}:
            shares = dict(_WALKS_AND_STOPS)
        journey = Journey()
        behaviours = {
            name: _TRAVELLING[name](journey=journey)
            if name in _TRAVELLING
            else make_behaviour(name, artefact.options, call)
            for name in shares
        }
        if by_exit:
            behaviours[WalkingOut.name] = WalkingOut()
            shares.setdefault(WalkingOut.name, 0.0)
        total = sum(shares.values())
        return cls(behaviours, {name: share / total for name, share in shares.items()})

    @classmethod
    def only(cls, behaviour: Behaviour) -> "Repertoire":
        """Return a repertoire of one behaviour."""
        return cls({behaviour.name: behaviour}, {behaviour.name: 1.0})

    def __len__(self) -> int:
        """Count the behaviours."""
        return len(self.names)

    def speeds_mps(self, situation: Situation) -> tuple[float, ...]:
        """Return the speeds [m/s] of the journey: walking (or driving), then running."""
        if self._speeds_mps is None:
            speeds_mps = {one.speed_mps(situation) for one in self._moving}
            self._speeds_mps = tuple(sorted(speeds_mps))
        return self._speeds_mps

    @property
    def paces(self) -> slice:
        """The indices of the speeds that the behaviour in force may have; of running the last."""
        if self.behaviour is self.way_out:
            return slice(None)
        return slice(-1, None) if _pace_of(self.behaviour) else slice(0, 1)

    def advantages(self, values: npt.NDArray[np.float64], rest: float) -> list[float]:
        """Return by how much the best move of each behaviour is worse than the best of all (B,).

        `values` float64 (P, 5) are those of staying and of the four moves, at each speed of the
        journey; `rest` is what resting saves. Behaviours with goals of their own bring it no nearer
        to its end, as resting does. Neither does one on a journey who gives way: it has no less for
        it than if it did something else, and would change its mind whenever somebody is in the way.
        """
        rows = values.tolist()
        stays = rows[0][0] + rest
        at_pace = [max(*row, stays) for row in rows]
        return [(stays if pace is None else at_pace[pace]) - max(at_pace) for pace in self._paces]

    @property
    def behaviour(self) -> Behaviour:
        """The behaviour in force."""
        return self._behaviours[self.in_force]

    def reward_bounds(self, situation: Situation) -> list[tuple[float, float]]:
        """Return bounds of `rewards` (B,), which take less time."""
        bounds = [(0.0, 0.0)] * len(self.names)
        for index, one in self._rewarding:
            bounds[index] = reward_bounds_of(one, situation)
        return bounds

    def rewards(self, situation: Situation) -> list[float]:
        """Return what a second of each behaviour is worth now (B,); see `Behaviour`."""
        rewards = [0.0] * len(self.names)
        for index, one in self._rewarding:
            rewards[index] = reward_of(one, situation)
        return rewards


def _pace_of(behaviour: Behaviour) -> int:
    """Return the index of a behaviour's pace among those of a journey: that of running is last."""
    return -1 if type(behaviour) is Running else 0
