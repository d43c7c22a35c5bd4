"""Who comes, how many live at once, and of which kind: the stochastic part in figures."""

import numpy as np

from are_ros.artefacts.catalogue import Catalogue
from are_ros.artefacts.mixture import Numbers, TruncatedPoissonMixture
from are_ros.description._tables import aligned, section
from are_ros.description.stationary_law import stationary_law
from are_ros.parameters.choices import Departures
from are_ros.parameters.model import Parameters, PopulationParameters

UNIT_AREA_M2 = 100.0
"""What is spoken of where no area is known."""

_LIKELIEST = 5


def population_lines(
    parameters: Parameters, probabilities: Numbers, catalogue: Catalogue, area_m2: float | None
) -> list[str]:
    """Return arrivals per minute, lives, and the law of the number alive on an area [m^2]."""
    settings, area = parameters.population, UNIT_AREA_M2 if area_m2 is None else area_m2
    groups_per_s = settings.arrival_rate * area
    members_per_s = groups_per_s * settings.group_size
    where = f"on {area:.4g} m^2" + (" (no map is given)" if area_m2 is None else "")
    rows = [
        ("arrivals", _arrivals_text(settings, groups_per_s)),
        ("life", f"exponential, mean {settings.mean_life:g} s"),
        ("departures", _departures_text(settings, members_per_s)),
        ("alive at once", _alive_text(settings, groups_per_s)),
        ("bound", f"at most {settings.max_alive} alive (population.max_alive)"),
        ("region", f"{settings.region.value} space, {settings.arrival_rate:g} arrivals/(m^2 s)"),
    ]
    forever = sum(probabilities[row.index] for row in catalogue.rows if row.forever)
    if forever > 0.0:
        per_hour = 3600.0 * members_per_s * forever
        text = f"{_percent(forever)} of arrivals never leave: {per_hour:.3g} more per hour"
        rows.append(("for ever", text + ", beside the law above"))
    return section(f"Population {where}", aligned(rows))


def mixture_lines(law: TruncatedPoissonMixture, catalogue: Catalogue) -> list[str]:
    """Return the components of Eq. 1, the probability of each class and the likeliest rows."""
    probabilities = law.probabilities()
    components = [("component", "weight pi", "rate lambda", "mostly")]
    for i, of_rows in enumerate(law.component_probabilities()):
        by_class = catalogue.class_probabilities(of_rows)
        best = int(np.argmax(by_class))
        mostly = f"{catalogue.class_names[best]} ({_percent(by_class[best])})"
        components.append((str(i), f"{law.weights[i]:.3f}", f"{law.rates[i]:g}", mostly))
    by_class = catalogue.class_probabilities(probabilities)
    classes = [
        (name, _percent(share))
        for name, share in sorted(
            zip(catalogue.class_names, by_class.tolist(), strict=True), key=lambda pair: -pair[1]
        )
    ]
    order = np.argsort(-probabilities, kind="stable")[:_LIKELIEST]
    rows = [(catalogue.rows[k].label, _percent(probabilities[k])) for k in order.tolist()]
    return [
        *section("Mixture (Eq. 1)", aligned(components, numbers=(0, 1, 2))),
        *section("Classes", aligned(classes, numbers=(1,))),
        *section("Likeliest rows", aligned(rows, numbers=(1,))),
    ]


def catalogue_lines(probabilities: Numbers, catalogue: Catalogue) -> list[str]:
    """Return the catalogue: row, label, class, size and probability of each."""
    rows = [("row", "label", "class", "size [m]", "probability", "")]
    for row in catalogue.rows:
        size = " x ".join(f"{length:.2f}" for length in row.size_m)
        note = "for ever" if row.forever else ""
        share = _percent(probabilities[row.index])
        rows.append((str(row.index), row.label, row.class_name, size, share, note))
    return section(f"Catalogue ({len(catalogue.rows)} rows)", aligned(rows, numbers=(0, 3, 4)))


def _arrivals_text(settings: PopulationParameters, groups_per_s: float) -> str:
    if groups_per_s <= 0.0:
        return "none"
    noun, per_minute = "artefacts", 60.0 * groups_per_s
    if settings.group_size > 1.0:
        noun = f"groups of {settings.group_size:g} on average (1 + Poisson)"
    return f"{per_minute:.3g} {noun} per minute, one every {1.0 / groups_per_s:.3g} s"


def _departures_text(settings: PopulationParameters, members_per_s: float) -> str:
    load = members_per_s * settings.mean_life
    alone = settings.group_size <= 1.0
    if settings.departures is Departures.INDEPENDENT:
        law = f"Poisson({load:.3g})" if alone else f"mean {load:.3g}, wider than Poisson"
        return f"independent, each at 1/{settings.mean_life:g} s; unbounded: {law}"
    if load >= 1.0:
        return f"constant_rate: {load:.3g} arrive for one that leaves, so the bound is reached"
    law = f"geometric, ratio {load:.3g}" if alone else f"load {load:.3g}"
    return f"constant_rate, one in {settings.mean_life:g} s; unbounded: {law}"


def _alive_text(settings: PopulationParameters, groups_per_s: float) -> str:
    law = stationary_law(
        groups_per_s,
        settings.group_size,
        settings.mean_life,
        settings.departures,
        settings.max_alive,
    )
    mean = float(law @ np.arange(len(law)))
    low, high = np.searchsorted(np.cumsum(law), (0.05, 0.95)).tolist()
    text = f"{mean:.3g} expected, {low} to {high} in nine tenths of the time"
    empty, full = float(law[0]), float(law[-1])
    text += f"; empty {_percent(empty)}" if empty > 0.001 else ""
    return text + (f"; at the bound {_percent(full)}" if full > 0.001 else "")


def _percent(share: float) -> str:
    percent = 100.0 * share
    return f"{percent:.1f} %" if percent >= 0.05 or percent == 0.0 else "< 0.1 %"
