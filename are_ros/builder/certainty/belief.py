"""What a tracker believes of a track: that it exists, of which class it is, and what it does.

By Bayes' rule; behaviours are a hidden Markov model with looks that err.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from are_ros.population.catalogue import CatalogueRow
from are_ros.world.rigid_transform import product

Floats = npt.NDArray[np.float64]


class Existence(NamedTuple):
    """The probabilities of what a track comes from; they sum to 1.

    An artefact that is there, a false alarm that goes on, or nothing any more: the artefact has
    departed, or the false alarm is over.
    """

    artefact: float
    false_alarm: float
    nothing: float = 0.0

    def later(self, dt_s: float, artefact_rate: float, false_alarm_rate: float) -> "Existence":
        """Return the belief after a time in which artefacts and false alarms end at rates [1/s]."""
        artefact = self.artefact * math.exp(-artefact_rate * dt_s)
        false_alarm = self.false_alarm * math.exp(-false_alarm_rate * dt_s)
        ended = (self.artefact - artefact) + (self.false_alarm - false_alarm)
        return Existence(artefact, false_alarm, self.nothing + ended)

    def detected(self) -> "Existence":
        """Return the belief after a detection: something is there."""
        total = self.artefact + self.false_alarm
        if not total:  # after hours without a look; a false alarm does not go on for so long
            return Existence(1.0, 0.0)
        return Existence(self.artefact / total, self.false_alarm / total)

    def missed(self, probability: float) -> "Existence":
        """Return the belief after a look that would have detected what is there so probably."""
        artefact = self.artefact * (1.0 - probability)
        false_alarm = self.false_alarm * (1.0 - probability)
        total = artefact + false_alarm + self.nothing
        if not total:
            return Existence(0.0, 0.0, 1.0)
        return Existence(artefact / total, false_alarm / total, self.nothing / total)


class Belief:
    """The probabilities of what a track is, or does, by the numbers of the possibilities.

    Numbers beyond the probabilities are of behaviours first seen after the track began.
    """

    def __init__(self, prior: Floats) -> None:
        self.probabilities = prior
        self.looked_ns: int | None = None
        """When a look last named one [ns]."""

    def widen(self, count: int) -> None:
        """Take in the possibilities that came up since: so far they were impossible."""
        self.probabilities = np.pad(self.probabilities, (0, count - len(self.probabilities)))

    def look(
        self, draws: np.random.Generator, truth: int | None, accuracy: float, now_ns: int
    ) -> None:
        """Draw what a look names, and take it into account.

        It names the truth with the probability `accuracy`, else any other alike; any one alike
        where nothing is there to be named (None).
        """
        self.looked_ns, count = now_ns, len(self.probabilities)
        if count == 1:
            return
        uniform, shift = draws.random(), int(draws.integers(1, count))
        if truth is None:
            named = int(uniform * count)
        else:
            named = truth if uniform < accuracy else (truth + shift) % count
        likelihoods = np.full(count, (1.0 - accuracy) / (count - 1))
        likelihoods[named] = accuracy
        joint = self.probabilities * likelihoods
        # What was held for impossible is seen: the look alone counts then.
        self.probabilities = joint / math.fsum(joint) if joint.any() else likelihoods

    def ranked(self, names: Sequence[str]) -> tuple[tuple[str, ...], tuple[float, ...]]:
        """Return the names of what is possible and its probabilities, the most probable first."""
        order = np.argsort(-self.probabilities, kind="stable").tolist()
        possible = [k for k in order if self.probabilities[k] > 0.0]
        return tuple(names[k] for k in possible), tuple(self.probabilities[possible].tolist())


class Census:
    """Counts the tracks that have begun: the priors of those that begin later.

    The counts know the truth, as those do by which a real detector was calibrated. A track is
    counted after it got its prior.
    """

    def __init__(self, classes: Mapping[str, float]) -> None:
        """Take the classes with the probabilities that the catalogue gives them."""
        self.classes = tuple(classes)
        self.expect(classes)
        self._artefacts = np.zeros(len(classes))
        self._false_alarms = 0

    def expect(self, classes: Mapping[str, float]) -> None:
        """Take other probabilities of the same classes; the counts stay."""
        self._expected = np.array(tuple(classes.values())) + 1.0 / len(classes)

    def existence(self, *, are_false_alarms_possible: bool) -> Existence:
        """Return the share of artefacts among the tracks so far, by the rule of succession."""
        if not are_false_alarms_possible:
            return Existence(1.0, 0.0)
        artefacts, false_alarms = float(self._artefacts.sum()) + 1.0, self._false_alarms + 1.0
        total = artefacts + false_alarms
        return Existence(artefacts / total, false_alarms / total)

    def class_belief(self) -> Belief:
        """Return the shares of the classes among the artefacts so far, begun with the catalogue."""
        shares = self._artefacts + self._expected
        return Belief(shares / shares.sum())

    def count_artefact(self, class_name: str) -> None:
        """Count the track of an artefact of a class."""
        self._artefacts[self.classes.index(class_name)] += 1.0

    def count_false_alarm(self) -> None:
        """Count the track of a false alarm."""
        self._false_alarms += 1


class BehaviourLaw:
    """How behaviours begin and follow each other: the counts of the artefacts tracked so far.

    The counts know the truth, as those do by which a real classifier was calibrated on a site. It
    is a Markov process with constant rates; before there are counts, one behaviour lasts a life.
    """

    def __init__(self, shares: Mapping[str, float], mean_life_s: float) -> None:
        """Take the behaviours with the shares that the catalogue gives them."""
        count = len(shares)
        self.names = list(shares)
        self._mean_life_s = mean_life_s
        self._shares = np.array(tuple(shares.values()))
        self._begun = self._shares + 1.0 / count
        self._lasted_s = np.zeros(count)
        self._changes = np.zeros((count, count))

    def expect(self, shares: Mapping[str, float], mean_life_s: float) -> None:
        """Take other shares of the same behaviours; the counts stay."""
        before, self._shares = self._shares, np.array(tuple(shares.values()))
        self._begun[: len(before)] += self._shares - before
        self._mean_life_s = mean_life_s

    def belief(self) -> Belief:
        """Return the belief of a track that begins: the shares among those that began before."""
        return Belief(self._begun / self._begun.sum())

    def number(self, name: str) -> int:
        """Return the number of a behaviour; one that was never seen before gets the next."""
        if name not in self.names:
            self.names.append(name)
            self._begun = np.pad(self._begun, (0, 1))
            self._lasted_s = np.pad(self._lasted_s, (0, 1))
            self._changes = np.pad(self._changes, (0, 1))
        return self.names.index(name)

    def count_begun(self, name: str) -> None:
        """Count the track of an artefact that begins with a behaviour."""
        number = self.number(name)  # which may widen the counts
        self._begun[number] += 1.0

    def count_time(self, before: str, after: str, dt_s: float) -> None:
        """Count the time that a behaviour has lasted, and its change into another one."""
        was, became = self.number(before), self.number(after)
        self._lasted_s[was] += dt_s
        self._changes[was, became] += was != became

    def predict(self, beliefs: Iterable[Belief], dt_s: float) -> None:
        """Carry beliefs on for a time in which nobody looks."""
        from scipy.linalg import expm

        transition = expm(self.rates() * dt_s)
        for belief in beliefs:
            belief.widen(len(self.names))
            belief.probabilities = product(belief.probabilities, transition)

    def rates(self) -> Floats:
        """Return the rates (B, B) [1/s] of the process: rows sum to 0.

        A behaviour ends at the rate (changes + 1) / (time + mean life), and the one that follows
        has the share of its changes, begun with one change that is spread over all.
        """
        count = len(self.names)
        others = (1.0 - np.eye(count)) / max(count - 1, 1)
        rates: Floats = (self._changes + others) / (self._lasted_s + self._mean_life_s)[:, None]
        rates -= np.diag(rates.sum(axis=1))
        return rates


def behaviour_shares(rows: Sequence[CatalogueRow], probabilities: Floats) -> dict[str, float]:
    """Return the shares of the behaviours of a catalogue whose rows have these probabilities."""
    shares: dict[str, float] = {}
    for row, probability in zip(rows, probabilities.tolist(), strict=True):
        total = sum(row.behaviours.values())
        for name, weight in row.behaviours.items():
            shares[name] = shares.get(name, 0.0) + probability * weight / total
    return shares
