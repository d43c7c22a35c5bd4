"""What a tracker believes of a track: that it exists, and which class it is of; by Bayes' rule."""

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np


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
        return Existence(self.artefact / total, self.false_alarm / total)

    def missed(self, probability: float) -> "Existence":
        """Return the belief after a look that would have detected what is there so probably."""
        artefact = self.artefact * (1.0 - probability)
        false_alarm = self.false_alarm * (1.0 - probability)
        total = artefact + false_alarm + self.nothing
        if not total:
            return Existence(0.0, 0.0, 1.0)
        return Existence(artefact / total, false_alarm / total, self.nothing / total)


class Census:
    """Counts the tracks that have begun: the priors of those that begin later.

    The counts know the truth, as those do by which a real detector was calibrated. A track is
    counted after it got its prior.
    """

    def __init__(self, classes: Mapping[str, float]) -> None:
        """Take the classes with the probabilities that the catalogue gives them."""
        self.classes = tuple(classes)
        self._expected = np.array(tuple(classes.values())) + 1.0 / len(classes)
        self._artefacts = np.zeros(len(classes))
        self._false_alarms = 0

    def existence(self, *, are_false_alarms_possible: bool) -> Existence:
        """Return the share of artefacts among the tracks so far, by the rule of succession."""
        if not are_false_alarms_possible:
            return Existence(1.0, 0.0)
        artefacts, false_alarms = float(self._artefacts.sum()) + 1.0, self._false_alarms + 1.0
        total = artefacts + false_alarms
        return Existence(artefacts / total, false_alarms / total)

    def class_belief(self) -> "ClassBelief":
        """Return the shares of the classes among the artefacts so far, begun with the catalogue."""
        shares = self._artefacts + self._expected
        return ClassBelief(self.classes, (shares / shares.sum()).tolist())

    def count_artefact(self, class_name: str) -> None:
        """Count the track of an artefact of a class."""
        self._artefacts[self.classes.index(class_name)] += 1.0

    def count_false_alarm(self) -> None:
        """Count the track of a false alarm."""
        self._false_alarms += 1


class ClassBelief:
    """The probabilities of the classes of one track."""

    def __init__(self, classes: Sequence[str], prior: Sequence[float]) -> None:
        self._classes = tuple(classes)
        self._probabilities = list(prior)

    def look(self, generator: np.random.Generator, true_class: str, accuracy: float) -> None:
        """Draw the class that a look names, and take it into account.

        It names the true class with the probability `accuracy`, else any other alike.
        """
        count = len(self._classes)
        if count == 1:
            return
        named = self._classes.index(true_class)
        uniform, shift = generator.random(), int(generator.integers(1, count))
        named = named if uniform < accuracy else (named + shift) % count
        other = (1.0 - accuracy) / (count - 1)
        likelihoods = [accuracy if k == named else other for k in range(count)]
        joint = [p * q for p, q in zip(self._probabilities, likelihoods, strict=True)]
        total = math.fsum(joint)
        self._probabilities = [p / total for p in joint]

    def ranked(self) -> tuple[tuple[str, ...], tuple[float, ...]]:
        """Return the possible classes and their probabilities, the most probable first."""
        both = zip(self._classes, self._probabilities, strict=True)
        order = sorted((-p, k, name) for k, (name, p) in enumerate(both) if p > 0.0)
        return tuple(name for _, _, name in order), tuple(-p for p, _, _ in order)
