"""A detector and a tracker over what the camera could see: `Detector.observe`, tick by tick."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Final

import numpy as np
import numpy.typing as npt

from are_ros.agents.events import Sighting
from are_ros.builder.certainty.belief import BehaviourLaw, Belief, Census, behaviour_shares
from are_ros.builder.certainty.false_alarms import FalseAlarm, FalseAlarms
from are_ros.builder.certainty.perception import Delay, Perception, View
from are_ros.builder.certainty.track import (
    Body,
    Floats,
    Process,
    Track,
    TrackingError,
    boxes_at,
    predicted_paths,
)
from are_ros.builder.observation import joined
from are_ros.builder.scene import Scene
from are_ros.conventions import NS_PER_S, seconds_to_ns
from are_ros.parameters.model import CertaintyParameters, Parameters
from are_ros.population.catalogue import Catalogue
from are_ros.population.mixture import mixture_of
from are_ros.population.randomness import Purpose, generator

_FORGOTTEN: Final = 0.001
"""A track whose artefact exists with less than this probability is given up."""


class Detector:
    """Tracks what it detects, with all that goes wrong with it (docs/certainty.md).

    It only reads the artefacts: what they do never depends on it. All draws come from generators of
    its own, one for each purpose and artefact.
    """

    def __init__(self, parameters: Parameters, catalogue: Catalogue) -> None:
        self._catalogue = catalogue
        self._know(parameters)
        self.reseed(parameters.seed)

    def reconfigure(self, parameters: Parameters) -> None:
        """Use other values of the live parameters from now on; what was counted so far stays."""
        self._know(parameters)
        self._false_alarms.law = self._law
        self._census.expect(self._shares)
        self._behaviours.expect(self._behaviour_shares, parameters.population.mean_life)

    def _know(self, parameters: Parameters) -> None:
        """Take the parameters, and the shares of classes and behaviours that follow from them."""
        self.parameters, catalogue = parameters, self._catalogue
        self._law = mixture_of(parameters, catalogue)
        probabilities = self._law.probabilities()
        shares = catalogue.class_probabilities(probabilities).tolist()
        self._shares = dict(zip(catalogue.class_names, shares, strict=True))
        self._behaviour_shares = behaviour_shares(catalogue.rows, probabilities)

    def reseed(self, seed: int) -> None:
        """Draw from another seed, and begin anew."""
        self._streams = _Streams(seed)
        self._false_alarms = FalseAlarms(seed, self._catalogue.rows, self._law)
        self._census = Census(self._shares)
        mean_life_s = self.parameters.population.mean_life
        self._behaviours = BehaviourLaw(self._behaviour_shares, mean_life_s)
        self.forget()

    def forget(self) -> None:
        """Give up all tracks: the clock jumped, or nobody looks any more."""
        self._tracks: dict[int, Track] = {}
        self._ends_ns: dict[int, int] = {}
        self._delay = Delay()
        self._now_ns: int | None = None

    def observe(self, now_ns: int, scene: Scene, views: Sequence[View] | None) -> Perception:
        """Return the list of a tick: as things were `certainty.latency` ago.

        `views` is what the cameras see whose time to look it is, None if it is no camera's. Those
        whose pose is not known are left out: they can detect nothing.
        """
        self._follow(now_ns, scene)
        for view in views or ():
            self._look(now_ns, scene, view)
        self._give_up(now_ns, is_look=views is not None)
        self._streams.keep({*scene.ids.tolist(), *self._tracks})
        latency_ns = seconds_to_ns(self._settings.latency)
        return self._delay.passed(self._perception(now_ns), latency_ns)

    @property
    def predicts(self) -> bool:
        """Whether it tells paths."""
        return self._settings.prediction_horizon > 0.0

    @property
    def _tells_behaviours(self) -> bool:
        return self._settings.behaviour_accuracy > 0.0

    @property
    def _settings(self) -> CertaintyParameters:
        return self.parameters.certainty

    @property
    def _look_period_s(self) -> float:
        """The longest time between two looks of a camera."""
        slowest_hz = min(self.parameters.camera.rates, default=math.inf)
        return 1.0 / min(slowest_hz, self.parameters.builder.tick_rate)

    def _follow(self, now_ns: int, scene: Scene) -> None:
        """Carry all tracks on to `now_ns`; a clock that is set back a little does not undo that."""
        last_ns = now_ns if self._now_ns is None else self._now_ns
        self._now_ns = max(now_ns, last_ns)
        dt_s = (self._now_ns - last_ns) / NS_PER_S
        process = Process.of(self._settings, dt_s)
        ends = 1.0 / self.parameters.population.mean_life, 1.0 / self._settings.false_alarm_life
        places = {number: k for k, number in enumerate(scene.ids.tolist())}
        if self._tells_behaviours:
            beliefs = [track.behaviours for track in self._tracks.values()]
            self._behaviours.predict(filter(None, beliefs), dt_s)
        for number, track in self._tracks.items():
            track.error.predict(process)
            track.existence = track.existence.later(dt_s, *ends)
            if number in places:
                body = Body.of_scene(scene, places[number], now_ns)
                if self._tells_behaviours:
                    self._behaviours.count_time(track.body.behaviour, body.behaviour, dt_s)
                track.body = body
            else:
                track.body = track.body.coasted(now_ns)

    def _look(self, now_ns: int, scene: Scene, view: View) -> None:
        """Detect, or miss, everything that is there or is believed to be there."""
        places = {number: k for k, number in enumerate(scene.ids.tolist())}
        seen = {**view.sightings, **self._imagined(places, view)}
        for number in sorted(seen):
            body = Body.of_scene(scene, places[number], now_ns) if number in places else None
            self._meet(now_ns, number, body, seen[number], view)
        for alarm in self._false_alarms.begin(now_ns, self._settings, view):
            self._begin_false_alarm(now_ns, alarm, view)

    def _meet(
        self, now_ns: int, number: int, body: Body | None, sighting: Sighting, view: View
    ) -> None:
        """Detect or miss one; `body` is the artefact that is there, None where none is."""
        fraction, range_m = sighting.visible_fraction, sighting.range_m
        probability = detection_probability(self._settings, fraction, range_m)
        is_there = body is not None or self._ends_ns.get(number, now_ns) > now_ns
        draws, track = self._streams.of(Purpose.PERCEPTION, number), self._tracks.get(number)
        is_detected = is_there and draws.random() < probability
        if track is not None and not is_detected:
            track.existence = track.existence.missed(probability)
        elif track is not None:
            track.existence = track.existence.detected()
            track.error.correct(self._detection(track.body, sighting, view))
            self._take(track, now_ns, sighting)
        elif body is not None and is_detected:
            track = self._begin(number, body, self._detection(body, sighting, view))
            self._census.count_artefact(body.row.class_name)
            self._take(track, now_ns, sighting)

    def _imagined(self, places: Iterable[int], view: View) -> dict[int, Sighting]:
        """Return how what is tracked but is no artefact would be seen, if it were one."""
        tracks = [track for number, track in self._tracks.items() if number not in places]
        if not tracks:
            return {}
        boxes = boxes_at([t.body.motion for t in tracks], [t.body.shape for t in tracks])
        seen = zip(tracks, view.imagine(boxes), strict=True)
        return {track.artefact_id: sighting for track, sighting in seen if sighting is not None}

    def _begin(self, number: int, body: Body, detection: Floats) -> Track:
        """Begin a track, with priors that do not know what it is of."""
        settings = self._settings
        draws = self._streams.of(Purpose.ESTIMATION, number)
        rates = np.diag((settings.speed_noise, settings.speed_noise, settings.turn_noise))
        existence = self._census.existence(
            are_false_alarms_possible=settings.false_alarm_rate > 0.0
        )
        error, classes = TrackingError(draws, detection, rates), self._census.class_belief()
        self._tracks[number] = Track(number, body, error, existence, classes)
        return self._tracks[number]

    def _begin_false_alarm(self, now_ns: int, alarm: FalseAlarm, view: View) -> None:
        number, body, sighting, end_ns = alarm
        track = self._begin(number, body, self._detection(body, sighting, view))
        self._census.count_false_alarm()
        self._ends_ns[number] = end_ns
        self._take(track, now_ns, sighting)

    def _take(self, track: Track, now_ns: int, sighting: Sighting) -> None:
        """Note a detection, and look at the class if it is time."""
        is_first = track.sighting.seen_ns != now_ns  # else another camera has just detected it
        sighting = replace(sighting, seen_ns=now_ns)
        track.sighting = sighting if is_first else joined(track.sighting, sighting)
        if self._tells_behaviours:
            self._look_at_behaviour(track, now_ns)
        if _is_due(track.classes, now_ns, self._settings.class_time):
            draws = self._streams.of(Purpose.CLASSIFICATION, track.artefact_id)
            number = self._census.classes.index(track.body.row.class_name)
            track.classes.look(draws, number, self._settings.class_accuracy, now_ns)

    def _look_at_behaviour(self, track: Track, now_ns: int) -> None:
        """Look at what a detected body does, if it is time."""
        settings, truth = self._settings, track.body.behaviour
        if track.behaviours is None:
            track.behaviours = self._behaviours.belief()
            if truth:
                self._behaviours.count_begun(truth)
        if _is_due(track.behaviours, now_ns, settings.behaviour_time):
            draws = self._streams.of(Purpose.INTENT, track.artefact_id)
            number = self._behaviours.number(truth) if truth else None
            track.behaviours.widen(len(self._behaviours.names))
            track.behaviours.look(draws, number, settings.behaviour_accuracy, now_ns)

    def _detection(self, body: Body, sighting: Sighting, view: View) -> Floats:
        """Return the factor of a detection's noise."""
        x_m, y_m = view.camera_m.tolist()
        bearing_rad = math.atan2(body.motion[1] - y_m, body.motion[0] - x_m)
        return detection_noise(self._settings, sighting.range_m, bearing_rad)

    def _give_up(self, now_ns: int, *, is_look: bool) -> None:
        """Drop the tracks that were not detected for too long, or hardly exist."""
        have_all_looked = is_look and not self.parameters.camera.others
        patience_s = self._settings.coast + (0.0 if have_all_looked else self._look_period_s)
        oldest_ns = now_ns - seconds_to_ns(patience_s)
        self._tracks = {
            number: track
            for number, track in self._tracks.items()
            if track.sighting.seen_ns >= oldest_ns and track.existence.artefact >= _FORGOTTEN
        }
        self._ends_ns = {i: end for i, end in self._ends_ns.items() if i in self._tracks}

    def _perception(self, now_ns: int) -> Perception:
        """Return the tracks that are published, as of now."""
        settings = self._settings
        tracks = [
            self._tracks[number]
            for number in sorted(self._tracks)
            if self._tracks[number].existence.artefact >= settings.min_existence
        ]
        boxes = boxes_at([track.estimate for track in tracks], [t.body.shape for t in tracks])
        paths = predicted_paths(tracks, settings) if self.predicts else None
        names = self._behaviours.names if self._tells_behaviours else ()
        reports = tuple(track.report(self._census.classes, names) for track in tracks)
        step_ns = seconds_to_ns(settings.prediction_step)
        return Perception(now_ns, reports, boxes, paths, step_ns)


def _is_due(belief: Belief, now_ns: int, wait_s: float) -> bool:
    """Tell whether it is time for the next look, or for the first one."""
    return belief.looked_ns is None or now_ns - belief.looked_ns >= seconds_to_ns(wait_s)


class _Streams:
    """One generator for each purpose and artefact, for as long as the artefact is known."""

    def __init__(self, seed: int) -> None:
        self._seed = seed
        self._streams: dict[tuple[Purpose, int], np.random.Generator] = {}

    def of(self, purpose: Purpose, number: int) -> np.random.Generator:
        key = purpose, number
        if key not in self._streams:
            self._streams[key] = generator(self._seed, purpose, number)
        return self._streams[key]

    def keep(self, ids: set[int]) -> None:
        """Drop the streams of all other artefacts: ids are never used again."""
        if any(number not in ids for _, number in self._streams):
            self._streams = {key: one for key, one in self._streams.items() if key[1] in ids}


_STEEPNESS = 4


def detection_probability(settings: CertaintyParameters, fraction: float, range_m: float) -> float:
    """Return the probability that a look detects what is visible to this fraction, at this range.

    It is detection / ((1 + (half_fraction / fraction)^4) (1 + (range / half_range)^4)); a half of 0
    leaves out its factor. `fraction` is in [0, 1]; nothing visible is never detected.
    """
    if fraction <= 0.0:
        return 0.0
    odds_of_missing = (settings.half_fraction / fraction) ** _STEEPNESS
    probability = settings.detection / (1.0 + odds_of_missing)
    if settings.half_range > 0.0:
        probability /= 1.0 + (range_m / settings.half_range) ** _STEEPNESS
    return probability


def detection_noise(
    settings: CertaintyParameters, range_m: float, bearing_rad: float
) -> npt.NDArray[np.float64]:
    """Return a factor L (3, 3) of the covariance L L^T of a detected x, y [m] and yaw [rad].

    Along the line of sight, which has this bearing in the map, the deviation is
    hypot(position_noise, range_noise * range); across it hypot(position_noise, bearing_noise *
    range).
    """
    along_m = math.hypot(settings.position_noise, settings.range_noise * range_m)
    across_m = math.hypot(settings.position_noise, settings.bearing_noise * range_m)
    cos, sin = math.cos(bearing_rad), math.sin(bearing_rad)
    return np.array(
        (
            (along_m * cos, -across_m * sin, 0.0),
            (along_m * sin, across_m * cos, 0.0),
            (0.0, 0.0, settings.yaw_noise),
        )
    )
