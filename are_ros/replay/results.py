"""The numbers of a replay: metrics.json (reproducible), timing.json (not), a summary.

Wall-clock figures stand in timing.json only; nothing holds a date or a path of the machine.
"""

import json
import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from are_ros.agents.events import EventKind
from are_ros.builder.sensors.sensor_path import SensorPathCounts
from are_ros.conventions import NS_PER_S
from are_ros.draw.artefacts import contacts
from are_ros.draw.scene import Life, SceneRecord
from are_ros.messages.sensors import SENSORS
from are_ros.replay.progress import Stopwatch
from are_ros.wording import counted, listed

Content = dict[str, Any]

REPLAY_PHASE = "replay"
"""The phase of the stopwatch in which the recording goes through the builder."""

_SLOW = 2.0
"""Below this factor of real time two of its digits are said, so that none is 0."""

_OTHER_PHASES = {
    "start_up": "start-up",
    "picture": "picture",
    "view": "view",
    "animation": "animation",
}


def metrics_content(
    record: SceneRecord,
    readings: Mapping[str, Mapping[str, SensorPathCounts]],
    refused: Mapping[str, int],
    written: Mapping[str, int],
) -> Content:
    """Return the content of metrics.json; times are seconds since the first tick.

    `readings` are counted by role, as in `SENSORS`, and topic; messages `refused` and `written` by
    topic. Numbers that are not known are null. The same replay gives the same content.
    """
    series = record.series
    touches_ns: dict[int, list[int]] = {}
    for event in contacts(record):
        touches_ns.setdefault(event.artefact_id, []).append(event.stamp_ns)
    lives = [_life(record, life, touches_ns.get(life.artefact_id, [])) for life in record.lives]
    return {
        "seed": record.seed,
        "ticks": len(series.stamps_ns),
        "first_tick_ns": int(series.stamps_ns[0]) if len(series.stamps_ns) else None,
        "duration_s": record.duration_ns / NS_PER_S,
        "ticks_without_perception": series.blind_ticks,
        **_population(record),
        "alive": _mean_and_max(series.alive),
        "perceived": _mean_and_max(
            series.perceived if record.is_perceiving else series.perceived[:0]
        ),
        "perceived_ever": _perceived_of(record, record.lives),
        "clutter_ratio": _mean_and_max(series.clutter_ratio),
        "classes": _classes(record, lives),
        **_readings(readings),
        "refused": dict(sorted(refused.items())),
        "written": dict(sorted(written.items())),
        "lives": lives,
    }


def timing_content(record: SceneRecord, stopwatch: Stopwatch) -> Content:
    """Return the content of timing.json.

    The real-time factor is the time simulated over that of the replay proper; the overall one
    counts the other phases (start-up, picture, view, animation), too.
    """
    total_s = math.fsum(stopwatch.phases_s.values())
    replay_s = stopwatch.phases_s.get(REPLAY_PHASE, total_s)
    simulated_s = record.duration_ns / NS_PER_S
    ticks_ms = 1e3 * np.array(stopwatch.ticks_s, dtype=np.float64)
    names = {"p50": 50.0, "p90": 90.0, "p99": 99.0, "max": 100.0}
    return {
        "phases_s": {name: round(value, 6) for name, value in stopwatch.phases_s.items()},
        "total_s": round(total_s, 6),
        "real_time_factor": simulated_s / replay_s if replay_s > 0.0 else None,
        "real_time_factor_overall": simulated_s / total_s if total_s > 0.0 else None,
        "tick_ms": {
            name: float(np.percentile(ticks_ms, share)) if len(ticks_ms) else None
            for name, share in names.items()
        },
    }


def write_json(path: Path, content: Content) -> None:
    """Write a content as indented JSON with a newline at its end."""
    text = json.dumps(content, indent=2, allow_nan=False, ensure_ascii=False)
    path.write_text(text + "\n", encoding="utf-8")


def summary_lines(metrics: Content, timing: Content | None = None) -> list[str]:
    """Return the summary of a replay, as aligned lines of text."""
    entries = [
        ("time", _time_text(metrics, timing)),
        ("artefacts", _artefact_text(metrics)),
        ("perceived", _perceived_text(metrics)),
        *(
            (f"  {name}", f"{one['perceived']} of {one['arrived']}")
            for name, one in metrics["classes"].items()
            if one["perceived"] is not None
        ),
        ("robot", _robot_text(metrics)),
        *(
            (f"{role} {topic}", _reading_text(one))
            for role, kind in SENSORS.items()
            for topic, one in metrics.get(kind.parameter, {}).items()
        ),
        *((f"refused {topic}", counted(n, "message")) for topic, n in metrics["refused"].items()),
        ("written", _written_text(metrics["written"])),
    ]
    entries = [(name, text) for name, text in entries if text]
    width = max(len(name) for name, _ in entries)
    return [f"{name:<{width}}  {text}" for name, text in entries]


def _population(record: SceneRecord) -> Content:
    """Return the counts since the start, as SceneMetrics names them, and why."""
    last = record.metrics
    return {
        "arrivals": last.arrivals if last else 0,
        "departures": last.departures if last else 0,
        "departures_by_cause": _by_detail(record, EventKind.DEPARTED),
        "blocked": last.blocked if last else 0,
        "blocked_by_cause": _by_detail(record, EventKind.BLOCKED),
        "displaced": last.displaced if last else 0,
        "robot_contacts": last.robot_contacts if last else 0,
        "area_m2": _number(last.area_m2) if last else None,
    }


def _readings(by_role: Mapping[str, Mapping[str, SensorPathCounts]]) -> Content:
    """Return the counts of each kind of sensor, under "scans" always and under others if any."""
    found: Content = {"scans": {}}
    for role, counts in by_role.items():
        if counts:
            name = SENSORS[role].parameter
            found[name] = {topic: asdict(counts[topic]) for topic in sorted(counts)}
    return found


def _by_detail(record: SceneRecord, kind: EventKind) -> dict[str, int]:
    counts = Counter(event.detail for event in record.events if event.kind is kind)
    return dict(sorted(counts.items()))


def _mean_and_max(values: npt.NDArray[Any]) -> Content:
    known = values[np.isfinite(values)]
    if not len(known):
        return {"mean": None, "max": None}
    return {"mean": float(known.mean()), "max": known.max().item()}


def _number(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _classes(record: SceneRecord, contents: Sequence[Content]) -> Content:
    """Return the counts of each class; `contents` are those of the lives, in their order."""
    lives: dict[str, list[tuple[Life, Content]]] = {}
    for life, content in zip(record.lives, contents, strict=True):
        lives.setdefault(life.row.class_name, []).append((life, content))
    return {
        name: {
            "arrived": len(lives[name]),
            "perceived": _perceived_of(record, [life for life, _ in lives[name]]),
            "closest_m": min(
                (one["closest_m"] for _, one in lives[name] if one["closest_m"] is not None),
                default=None,
            ),
        }
        for name in sorted(lives)
    }


def _perceived_of(record: SceneRecord, lives: Sequence[Life]) -> int | None:
    """Return how many were perceived at some time; None where perception was left out."""
    return sum(life.is_perceived for life in lives) if record.is_perceiving else None


def _life(record: SceneRecord, life: Life, touches_ns: Sequence[int]) -> Content:
    def seconds(stamp_ns: int | None) -> float | None:
        first_ns = int(record.series.stamps_ns[0])
        return None if stamp_ns is None else (stamp_ns - first_ns) / NS_PER_S

    seen_ns = life.seen_ns.tolist()
    closest_m, closest_ns = _closest(record, life, touches_ns)
    return {
        "id": life.artefact_id,
        "row": life.row.index,
        "label": life.row.label,
        "class": life.row.class_name,
        "arrival_s": seconds(life.arrival_ns),
        "departure_s": seconds(life.departure_ns),
        "left_by": life.left_by or None,
        "first_perceived_s": seconds(min(seen_ns, default=None)),
        "last_perceived_s": seconds(max(seen_ns, default=None)),
        "ticks_perceived": len(seen_ns),
        "robot_contacts": len(touches_ns),
        "closest_m": closest_m,
        "closest_s": seconds(closest_ns),
    }


def _closest(
    record: SceneRecord, life: Life, touches_ns: Sequence[int]
) -> tuple[float | None, int | None]:
    """Return the least distance [m] of the robot from an artefact, and when it was first [ns].

    To a micrometre: while both stand, rounding would choose the tick. Who was touched moves away
    within the sub-step, and is not in the way at the tick: the touch counts as 0 m.
    """
    stamps_ns, distances_m = record.robot_distances(life)
    if len(distances_m):
        distances_m = distances_m.round(6)
        at = int(distances_m.argmin())
        if not touches_ns or distances_m[at] <= 0.0:
            return float(distances_m[at]), int(stamps_ns[at])
    return (0.0, min(touches_ns)) if touches_ns else (None, None)


def _time_text(metrics: Content, timing: Content | None) -> str:
    text = f"{metrics['duration_s']:.1f} s in {counted(metrics['ticks'], 'tick')}"
    if timing is None or timing["real_time_factor"] is None:
        return text
    factor, total_s = timing["real_time_factor"], timing["total_s"]
    others = listed([name for key, name in _OTHER_PHASES.items() if key in timing["phases_s"]])
    included = f"with {others}" if others else "in all"
    times = f"{factor:.2g}" if factor < _SLOW else f"{factor:.0f}"
    return f"{text}, {times} times real time; {total_s:.1f} s {included}"


def _artefact_text(metrics: Content) -> str:
    names = ("arrivals", "departures", "blocked", "displaced")
    words = ("arrived", "departed", "blocked", "displaced")
    pairs = [(metrics[name], word) for name, word in zip(names, words, strict=True)]
    shown = [f"{n} {word}" for n, word in pairs if n or word == "arrived"]
    alive = metrics["alive"]
    if alive["mean"] is None:
        return ", ".join(shown)
    return f"{', '.join(shown)}; alive {alive['mean']:.1f} on average, {alive['max']} at most"


def _robot_text(metrics: Content) -> str:
    touched = sum(one["robot_contacts"] > 0 for one in metrics["lives"])
    whom = counted(touched, "artefact") if touched else "artefacts"
    text = f"{counted(metrics['robot_contacts'], 'contact')} with {whom}"
    known = [one for one in metrics["lives"] if one["closest_m"] is not None]
    if not known:
        return text
    closest = min(known, key=lambda one: float(one["closest_m"]))
    distance_m, who = closest["closest_m"], f"{closest['label']} {closest['id']}"
    where = f"closest {distance_m:.2f} m from" if distance_m >= 0.0 else f"{-distance_m:.2f} m into"
    return f"{text}; {where} {who} after {closest['closest_s']:.1f} s"


def _perceived_text(metrics: Content) -> str:
    if metrics["perceived_ever"] is None:
        return "left out"
    total = sum(one["arrived"] for one in metrics["classes"].values())
    blind = metrics["ticks_without_perception"]
    warning = f"; {blind} of {metrics['ticks']} ticks without camera or its pose" if blind else ""
    return f"{metrics['perceived_ever']} of {total} at some time{warning}"


def _reading_text(one: Content) -> str:
    texts = {
        "exact": "augmented at their stamp",
        "held": "augmented with the latest map->odom (that of their stamp came too late)",
        "passed_through": "passed through unaugmented",
    }
    shown = [f"{one[name]} {text}" for name, text in texts.items() if one.get(name)]
    return ", ".join(shown) or "none"


def _written_text(written: Mapping[str, int]) -> str:
    if not written:
        return ""
    return f"{counted(sum(written.values()), 'message')} on {counted(len(written), 'topic')}"
