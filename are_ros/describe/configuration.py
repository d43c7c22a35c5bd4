"""`are describe`: what a configuration means, for a person."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from are_ros.describe.site import Site, site_rows
from are_ros.parameters.choices import (
    Appear,
    CameraModel,
    CostmapGate,
    Departures,
    Initial,
    Leave,
    SensorGate,
)
from are_ros.parameters.declaration import Value, describe, flatten
from are_ros.parameters.model import (
    CameraParameters,
    CertaintyParameters,
    Parameters,
    PopulationParameters,
)
from are_ros.population.birth_death import BirthDeath
from are_ros.population.catalogue import Catalogue, CatalogueRow
from are_ros.population.mixture import Numbers, TruncatedPoissonMixture, mixture_of
from are_ros.population.scenario import Scenario
from are_ros.wording import aligned, counted, percent, section, time_unit

_MORE: Final = "Each row of the catalogue, and what it does: --all."


def describe_lines(
    parameters: Parameters,
    catalogue: Catalogue,
    site: Site | None = None,
    scenario: Scenario | None = None,
    *,
    everything: bool = False,
) -> list[str]:
    """Return the description, line by line; figures are for a site, or else for 100 m^2.

    `scenario` is the one that the parameters name, if any. Rows of the catalogue are summed up by
    class, unless `everything` is asked for. Raises ParameterError where the mixture does not fit
    the catalogue.
    """
    law = mixture_of(parameters, catalogue)
    probabilities = law.probabilities()
    lines = [
        *population_lines(
            parameters, probabilities, catalogue, site or Site(), scenario or Scenario()
        ),
        *mixture_lines(law, catalogue),
        *class_lines(probabilities, catalogue),
        *behaviour_lines(probabilities, catalogue, of_rows=everything),
        *(catalogue_lines(probabilities, catalogue) if everything else ()),
        *section("Perception and outputs", aligned(_outputs(parameters))),
        *section("Parameters that differ from their defaults", _changed_lines(parameters)),
    ]
    return lines[:-1] if everything else [*lines, _MORE]


def _outputs(parameters: Parameters) -> list[tuple[str, str]]:
    occlusion, sensors, robot = parameters.occlusion, parameters.sensors, parameters.robot
    hidden_by = "walls and each other" if occlusion.mutual else "walls only"
    scans = ", ".join(sensors.scans) or "none"
    return [
        ("ticks", f"{parameters.builder.tick_rate:g} Hz, seed {parameters.seed}"),
        ("robot", f"footprint {robot.footprint or f'a disc of {robot.radius:g} m'}"),
        ("camera", _camera_text(parameters.camera)),
        ("perceived", f"more than {occlusion.tau} px visible within {occlusion.max_range:g} m"),
        ("hidden by", f"{hidden_by} ({occlusion.shape.value})"),
        *_detector_lines(parameters.certainty),
        ("grids", _grid_text(parameters)),
        ("scans", f"{scans}; {_sensor_text(sensors.gate)}, as {sensors.shape.value}"),
    ]


def _detector_lines(certainty: CertaintyParameters) -> list[tuple[str, str]]:
    """Say how sure what is perceived is; nothing where it is certain."""
    if not certainty.enabled:
        return []
    alarms = f"{60.0 * certainty.false_alarm_rate:g} false alarms a minute"
    best = f"detects {100.0 * certainty.detection:g} % at best"
    half = f", half of that at {certainty.half_range:g} m" if certainty.half_range else ""
    return [("detector", f"{best}{half}; {alarms}; {certainty.latency:g} s late")]


def _camera_text(camera: CameraParameters) -> str:
    where = f"in {camera.frame}" if camera.frame else f"{camera.mount[2]:g} m above the base"
    size = f"{camera.width} x {camera.height} px"
    if camera.model is CameraModel.OMNIDIRECTIONAL:
        return f"omnidirectional, {size}, {math.degrees(camera.vfov):.0f} degrees high, {where}"
    pinhole = f"pinhole, {size}, {math.degrees(camera.hfov):.0f} degrees wide, {where}"
    if camera.model is CameraModel.PINHOLE:
        return pinhole
    kind = "rectified" if camera.rectified else "raw"
    return f"that of CameraInfo ({kind}); where there is none: {pinhole}"


def _grid_text(parameters: Parameters) -> str:
    costmap = parameters.costmap
    inflated = f"inflated by {costmap.inflation_radius:g} m"
    if costmap.gate is CostmapGate.ALL:
        return f"all artefacts, {inflated}"
    kept = f" and for {costmap.memory:g} s after" if costmap.memory > 0.0 else " only"
    return f"artefacts while perceived{kept}, {inflated}"


def _sensor_text(gate: SensorGate) -> str:
    perceived_only = gate is SensorGate.PERCEIVED
    return "only perceived artefacts" if perceived_only else "whatever artefact a ray meets"


def _changed_lines(parameters: Parameters) -> list[str]:
    values = flatten(parameters)
    rows = [
        (
            item.path,
            f"{_text(values[item.path])} {item.unit}".rstrip(),
            f"not {_text(item.default)}",
        )
        for item in describe(parameters)
        if values[item.path] != item.default
    ]
    return aligned(rows) if rows else ["  none"]


def _text(value: Value) -> str:
    if isinstance(value, tuple):
        return "[" + ", ".join(_text(one) for one in value) + "]"
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, float):
        return f"{value:.6g}"
    return repr(value) if value == "" else str(value)


# The population: arrivals, lives, and the law of the number alive.


_WORTH_A_WORD = 0.001


def population_lines(
    parameters: Parameters,
    probabilities: Numbers,
    catalogue: Catalogue,
    site: Site,
    scenario: Scenario,
) -> list[str]:
    """Return arrivals per minute, lives, and the law of the number alive at a site.

    The law is that of random arrivals: without those of a scenario.
    """
    settings = parameters.population
    if not scenario.random:
        settings = replace(settings, arrival_rate=0.0)
    chain = BirthDeath.of(settings, site.area_m2, staying_share(probabilities, catalogue, site))
    where = f"on {site.area_m2:.4g} m^2" + ("" if site.survey else " (no map is given)")
    rows = [
        *site_rows(site, parameters, catalogue, probabilities),
        ("arrivals", _arrivals_text(settings, chain.groups_per_s)),
        *_scenario_rows(scenario),
        ("life", _life_text(chain)),
        ("departures", _departures_text(settings)),
        ("alive at once", _alive_text(chain)),
        ("law", _law_text(chain)),
        ("", _exactness_text(chain)),
        ("bound", _bound_text(chain)),
        *_memory_rows(chain, settings.initial),
        *_forever_rows(chain, probabilities, catalogue, site),
    ]
    lines = section(f"Population {where}", aligned(rows))
    return [*lines, *section("Coming and going", appearing_lines(parameters))]


def appearing_lines(parameters: Parameters) -> list[str]:
    """Return where artefacts appear, and what they do at the end of their life."""
    settings = parameters.population
    appear = {
        Appear.ANYWHERE: "anywhere in the region where there is room",
        Appear.OUT_OF_VIEW: "in the region, where no camera of the robot sees them appear",
        Appear.ZONES: "in the entrances that population.zones lists",
    }
    leave = {
        Leave.VANISH: "they vanish where they are",
        Leave.WALK_TO_EXIT: "those who can walk to an exit vanish there, after at most "
        f"{settings.exit_patience:g} s",
        Leave.BY_EXIT: "they walk to an exit out of the robot's sight before, and vanish in time",
    }
    rows = [("appear", appear[settings.appear]), ("leave", leave[settings.leave])]
    if settings.leave is Leave.WALK_TO_EXIT:
        rows.append(("", _walking_text(settings)))
    if settings.group_size > 1.0:
        rows.append(("groups", f"all within {settings.group_radius:g} m of the first, at once"))
    return aligned(rows)


def staying_share(probabilities: Numbers, catalogue: Catalogue, site: Site) -> float:
    """Return the probability that an artefact finds a place and is of a row that once leaves."""
    rows = (row for row in catalogue.rows if not row.forever)
    kept = [row.index for row in rows if row.index not in site.misfits]
    return min(float(probabilities[kept].sum()), 1.0)


def _arrivals_text(settings: PopulationParameters, groups_per_s: float) -> str:
    if groups_per_s <= 0.0:
        return "none"
    noun, per_minute = "artefacts", 60.0 * groups_per_s
    if settings.group_size > 1.0:
        noun = f"groups of {settings.group_size:g} on average (1 + Poisson)"
    length_s, unit = time_unit(1.0 / groups_per_s)
    every = f"one every {1.0 / groups_per_s / length_s:.3g} {unit}"
    return f"{per_minute:.3g} {noun} per minute, {every}"


def _scenario_rows(scenario: Scenario) -> list[tuple[str, str]]:
    """Return what a scenario adds to random arrivals, or that it takes their place."""
    if scenario.random and not scenario.artefacts:
        return []
    added = counted(len(scenario.artefacts), "artefact")
    if scenario.random:
        return [("scenario", f"{added}, beside random arrivals and the law below")]
    return [("scenario", f"{added}; it has random: false, so nobody else arrives")]


def _departures_text(settings: PopulationParameters) -> str:
    if settings.departures is Departures.INDEPENDENT:
        return f"independent: n alive leave at {_per_life(settings, 'n')}"
    return f"constant_rate: while anyone is alive, one leaves at {_per_life(settings, '1')}"


def _life_text(chain: BirthDeath) -> str:
    """Return the law of a life; at a constant rate its mean is that of Little's law."""
    if chain.departures is Departures.INDEPENDENT:
        return f"exponential, mean {chain.mean_life_s:g} s"
    text = "until it is drawn, uniformly among those alive"
    admitted_per_s = chain.members_per_s * (1.0 - chain.blocked_share)
    mean = f": mean {_duration(chain.mean / admitted_per_s)}" if admitted_per_s > 0.0 else ""
    return text + mean


def _per_life(settings: PopulationParameters, leavers: str) -> str:
    return f"rate {leavers}/({settings.mean_life:g} s)"


def _alive_text(chain: BirthDeath) -> str:
    low, high = chain.band()
    text = f"{chain.mean:.3g} expected, {low} to {high} in nine tenths of the time"
    empty, full = float(chain.law[0]), float(chain.law[-1])
    text += f"; empty {percent(empty)}" if empty > _WORTH_A_WORD else ""
    return text + (f"; at the bound {percent(full)}" if full > _WORTH_A_WORD else "")


def _law_text(chain: BirthDeath) -> str:
    """Return the law of the number alive, by name where it has one."""
    load = f"{chain.load:.3g}"
    if chain.departures is Departures.INDEPENDENT:
        if chain.is_grouped:
            return f"of groups, wider than Poisson: deviation {chain.deviation:.3g}, mean {load}"
        return f"Poisson({load}), cut at the bound"
    if chain.is_grouped:
        growth = ", so the bound is reached" if chain.load >= 1.0 else ""
        return f"of groups, wider than geometric; {load} arrive for one that leaves{growth}"
    if chain.load >= 1.0:
        return f"geometric, {load} arrive for one that leaves, so the bound is reached"
    return f"geometric, ratio {load}, cut at the bound"


def _exactness_text(chain: BirthDeath) -> str:
    """Return what the law rests on."""
    where = "exact while all find room, and none is displaced or placed on request"
    if chain.is_grouped:
        return f"{where}; computed level by level"
    if chain.departures is Departures.INDEPENDENT:
        return f"{where}; so for lives of any law"
    return where


def _bound_text(chain: BirthDeath) -> str:
    """Return how much the bound takes away."""
    text = f"at most {chain.max_alive} alive (population.max_alive)"
    if chain.blocked_share > _WORTH_A_WORD:
        return f"{text} blocks {percent(chain.blocked_share)} of the arrivals"
    return f"{text}; it blocks hardly anyone" if chain.members_per_s > 0.0 else text


def _memory_rows(chain: BirthDeath, initial: Initial) -> list[tuple[str, str]]:
    """Return for how long the number alive remembers, nothing where it never changes."""
    if chain.members_per_s <= 0.0 or chain.max_alive == 0:
        return []
    forgets, settled = _duration(chain.correlation_s), _duration(chain.settles_s)
    text = f"forgotten in about {forgets} (correlation time)"
    if initial is Initial.STATIONARY:
        return [("memory", f"{text}; a run begins with as many (population.initial)")]
    return [("memory", f"{text}; a run begins empty: fewer in its first {settled}")]


def _forever_rows(
    chain: BirthDeath, probabilities: Numbers, catalogue: Catalogue, site: Site
) -> list[tuple[str, str]]:
    """Return how artefacts that never leave accumulate, nothing if all leave."""
    staying = [row.index for row in catalogue.rows if row.forever and row.index not in site.misfits]
    share = float(probabilities[staying].sum())
    if share <= 0.0:
        return []
    per_s = chain.groups_per_s * chain.mean_group_size * share
    text = f"{percent(share)} of arrivals never leave: {3600.0 * per_s:.3g} more per hour"
    full = f", the bound in about {_duration(chain.max_alive / per_s)}" if per_s > 0.0 else ""
    return [("for ever", f"{text}, beside the law above{full}")]


def _walking_text(settings: PopulationParameters) -> str:
    """Return what walking out adds to the law."""
    if settings.departures is Departures.INDEPENDENT and settings.group_size <= 1.0:
        return "until then they count as alive: the law above with the way out added to the life"
    return "until then they count as alive: more than the law above, by arrivals times way out"


def _duration(duration_s: float) -> str:
    length_s, unit = time_unit(duration_s)
    return f"{duration_s / length_s:.3g} {unit}"


# The mixture and the catalogue.


_A_LINE: Final = 5


def mixture_lines(law: TruncatedPoissonMixture, catalogue: Catalogue) -> list[str]:
    """Return the components of Eq. 1: weights, rates, and the rows that each stands for."""
    components = [("component", "weight pi", "rate lambda", "rows", "mostly")]
    for i, of_rows in enumerate(law.component_probabilities()):
        by_class = catalogue.class_probabilities(of_rows)
        best = int(np.argmax(by_class))
        mostly = f"{catalogue.class_names[best]} ({percent(by_class[best])})"
        low, high = np.searchsorted(np.cumsum(of_rows), (0.05, 0.95)).tolist()
        weight, rate = f"{law.weights[i]:.3f}", f"{law.rates[i]:g}"
        components.append((str(i), weight, rate, f"{low} to {high}", mostly))
    return section("Mixture (Eq. 1)", aligned(components, numbers=(0, 1, 2)))


def class_lines(probabilities: Numbers, catalogue: Catalogue) -> list[str]:
    """Return the classes, likeliest first: their rows in numbers, and the likeliest of them."""
    by_class = catalogue.class_probabilities(probabilities).tolist()
    shares = dict(zip(catalogue.class_names, by_class, strict=True))
    lines = [("class", "probability", "rows", "length [m]", "speed [m/s]", "likeliest")]
    for name, share in sorted(shares.items(), key=lambda pair: -pair[1]):
        rows = [row for row in catalogue.rows if row.class_name == name]
        best = max(rows, key=lambda row: float(probabilities[row.index]))
        likeliest = f"{best.label} ({percent(probabilities[best.index])})"
        numbers = _range([row.index for row in rows], "{}")
        lengths_m = _range([row.size_m[0] for row in rows], "{:.2f}")
        speeds_mps = _range([row.motion.speed_mps for row in rows], "{:g}")
        lines.append((name, percent(share), numbers, lengths_m, speeds_mps, likeliest))
    title = f"Classes, of {counted(len(catalogue.rows), 'row')} in the catalogue"
    return section(title, aligned(lines, numbers=(1,)))


def behaviour_lines(probabilities: Numbers, catalogue: Catalogue, *, of_rows: bool) -> list[str]:
    """Return what artefacts do, and how likely: all, and each class.

    With `of_rows` also the rows of a class, where they differ.
    """
    rows = [("who", "probability", "behaviours")]
    rows += _habits("all", 1.0, _behaviours(catalogue.rows, probabilities))
    by_class = catalogue.class_probabilities(probabilities)
    for name, share in zip(catalogue.class_names, by_class.tolist(), strict=True):
        of_class = tuple(row for row in catalogue.rows if row.class_name == name)
        rows += _habits(name, share, _behaviours(of_class, probabilities))
        alike = _alike(of_class) if of_rows else []
        for group in alike if len(alike) > 1 else ():
            chance = float(probabilities[[row.index for row in group]].sum())
            rows += _habits(f"  {_span(group)}", chance, dict(group[0].behaviours))
    return section("Behaviours, the shares by which they are drawn", aligned(rows, numbers=(1,)))


def catalogue_lines(probabilities: Numbers, catalogue: Catalogue) -> list[str]:
    """Return the whole catalogue: row, label, class, size, speed and probability of each."""
    rows = [("row", "label", "class", "size [m]", "speed", "probability", "")]
    for row in catalogue.rows:
        size = " x ".join(f"{length:.2f}" for length in row.size_m)
        share, speed = percent(probabilities[row.index]), f"{row.motion.speed_mps:g} m/s"
        note = "for ever" if row.forever else ""
        rows.append((str(row.index), row.label, row.class_name, size, speed, share, note))
    return section(
        f"Catalogue ({counted(len(catalogue.rows), 'row')})", aligned(rows, numbers=(0, 3, 4, 5))
    )


def _range(numbers: Sequence[float], layout: str) -> str:
    """Return the least and the greatest, one number where they are alike."""
    low, high = layout.format(min(numbers)), layout.format(max(numbers))
    return low if low == high else f"{low} to {high}"


def _behaviours(rows: tuple[CatalogueRow, ...], probabilities: Numbers) -> dict[str, float]:
    """Return the probability of each behaviour, given one of these rows."""
    shares: dict[str, float] = {}
    for row in rows:
        for name, chance in row.behaviours.items():
            shares[name] = shares.get(name, 0.0) + float(probabilities[row.index]) * chance
    total = sum(shares.values())
    return {name: share / total for name, share in shares.items()} if total > 0.0 else {}


def _alike(rows: tuple[CatalogueRow, ...]) -> list[list[CatalogueRow]]:
    """Return the rows in runs of the same behaviours."""
    runs: list[list[CatalogueRow]] = []
    for row in rows:
        if runs and dict(runs[-1][-1].behaviours) == dict(row.behaviours):
            runs[-1].append(row)
        else:
            runs.append([row])
    return runs


def _span(rows: Sequence[CatalogueRow]) -> str:
    first, last = rows[0].index, rows[-1].index
    return f"row {first}" if first == last else f"rows {first} to {last}"


def _habits(who: str, chance: float, shares: Mapping[str, float]) -> list[tuple[str, str, str]]:
    """Return the lines of one entry: the behaviours, likeliest first, wrapped."""
    ordered = sorted(shares.items(), key=lambda pair: -pair[1])
    words = [f"{name} {percent(share)}" for name, share in ordered if share > 0.0]
    return [
        (
            who if i == 0 else "",
            percent(chance) if i == 0 else "",
            ", ".join(words[i : i + _A_LINE]),
        )
        for i in range(0, max(len(words), 1), _A_LINE)
    ]
