"""What a tracker believes a body does: a hidden Markov model of behaviours, with looks that err."""

from collections.abc import Iterable, Mapping, Sequence

import numpy as np
import numpy.typing as npt

from are_ros.population.catalogue import CatalogueRow

Floats = npt.NDArray[np.float64]


class BehaviourBelief:
    """The probabilities of the behaviours of one track, by their numbers in the law.

    Later numbers than there are probabilities are those of behaviours that nobody had then.
    """

    def __init__(self, prior: Floats) -> None:
        self.probabilities = prior
        self.looked_ns: int | None = None
        """When a look last named a behaviour [ns]."""

    def widen(self, count: int) -> None:
        """Take in the behaviours that came up since: so far they were impossible."""
        self.probabilities = np.pad(self.probabilities, (0, count - len(self.probabilities)))

    def look(
        self, draws: np.random.Generator, truth: int | None, accuracy: float, now_ns: int
    ) -> None:
        """Draw the behaviour that a look names, and take it into account.

        It names the true one with the probability `accuracy`, else any other alike; any one alike
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
        self.probabilities = joint / joint.sum() if joint.any() else likelihoods

    def ranked(self, names: Sequence[str]) -> tuple[tuple[str, ...], tuple[float, ...]]:
        """Return the possible behaviours and their probabilities, the most probable first."""
        order = np.argsort(-self.probabilities, kind="stable").tolist()
        possible = [k for k in order if self.probabilities[k] > 0.0]
        return tuple(names[k] for k in possible), tuple(self.probabilities[possible].tolist())


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
        self._begun = np.array(tuple(shares.values())) + 1.0 / count
        self._lasted_s = np.zeros(count)
        self._changes = np.zeros((count, count))

    def belief(self) -> BehaviourBelief:
        """Return the belief of a track that begins: the shares among those that began before."""
        return BehaviourBelief(self._begun / self._begun.sum())

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

    def predict(self, beliefs: Iterable[BehaviourBelief], dt_s: float) -> None:
        """Carry beliefs on for a time in which nobody looks."""
        from scipy.linalg import expm

        transition = expm(self.rates() * dt_s)
        for belief in beliefs:
            belief.widen(len(self.names))
            belief.probabilities = belief.probabilities @ transition

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
