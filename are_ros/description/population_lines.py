"""Who comes, how many live at once, how they come and go: the birth-death process in figures."""

from are_ros.artefacts.catalogue import Catalogue
from are_ros.artefacts.mixture import Numbers
from are_ros.description._tables import aligned, section
from are_ros.description.birth_death import BirthDeath
from are_ros.description.catalogue_lines import percent
from are_ros.description.site import Site, site_rows
from are_ros.parameters.choices import Appear, Departures, Leave
from are_ros.parameters.model import Parameters, PopulationParameters

_WORTH_A_WORD = 0.001
_SETTLED = 3.0
"""After so many correlation times 95 % of the expected number are there."""


def population_lines(
    parameters: Parameters, probabilities: Numbers, catalogue: Catalogue, site: Site
) -> list[str]:
    """Return arrivals per minute, lives, and the law of the number alive at a site."""
    settings = parameters.population
    chain = BirthDeath.of(settings, site.area_m2, staying_share(probabilities, catalogue, site))
    where = f"on {site.area_m2:.4g} m^2" + ("" if site.survey else " (no map is given)")
    rows = [
        *site_rows(site, parameters, catalogue, probabilities),
        ("arrivals", _arrivals_text(settings, chain.groups_per_s)),
        ("life", _life_text(chain)),
        ("departures", _departures_text(settings)),
        ("alive at once", _alive_text(chain)),
        ("law", _law_text(chain)),
        ("", _exactness_text(chain)),
        ("bound", _bound_text(chain)),
        *_memory_rows(chain),
        *_forever_rows(chain, probabilities, catalogue, site),
    ]
    lines = section(f"Population {where}", aligned(rows))
    return [*lines, *section("Coming and going", appearing_lines(parameters))]


def appearing_lines(parameters: Parameters) -> list[str]:
    """Return where artefacts appear, and what they do when their life is over."""
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
    }
    rows = [("appear", appear[settings.appear]), ("leave", leave[settings.leave])]
    if settings.leave is Leave.WALK_TO_EXIT:
        rows.append(("", _walking_text(settings)))
    if settings.group_size > 1.0:
        rows.append(("groups", f"all within {settings.group_radius:g} m of the first, at once"))
    return aligned(rows)


def staying_share(probabilities: Numbers, catalogue: Catalogue, site: Site) -> float:
    """Return the probability that an artefact finds a place and is of a row that once leaves."""
    kept = [row.index for row in catalogue.rows if _counts(row.index, row.forever, site)]
    return min(float(probabilities[kept].sum()), 1.0)


def _counts(index: int, forever: bool, site: Site) -> bool:
    return not forever and index not in site.misfits


def _arrivals_text(settings: PopulationParameters, groups_per_s: float) -> str:
    if groups_per_s <= 0.0:
        return "none"
    noun, per_minute = "artefacts", 60.0 * groups_per_s
    if settings.group_size > 1.0:
        noun = f"groups of {settings.group_size:g} on average (1 + Poisson)"
    return f"{per_minute:.3g} {noun} per minute, one every {1.0 / groups_per_s:.3g} s"


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


def _memory_rows(chain: BirthDeath) -> list[tuple[str, str]]:
    """Return for how long the number alive remembers, nothing where it never changes."""
    if chain.members_per_s <= 0.0 or chain.max_alive == 0:
        return []
    forgets, settled = (_duration(n * chain.correlation_s) for n in (1.0, _SETTLED))
    text = f"forgotten in about {forgets} (correlation time)"
    return [("memory", f"{text}; a run begins empty: fewer in its first {settled}")]


def _forever_rows(
    chain: BirthDeath, probabilities: Numbers, catalogue: Catalogue, site: Site
) -> list[tuple[str, str]]:
    """Return how those who never leave add up, nothing if nobody stays."""
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
    for unit, length_s in (("days", 86400.0), ("hours", 3600.0), ("min", 60.0)):
        if duration_s >= 2.0 * length_s:
            return f"{duration_s / length_s:.3g} {unit}"
    return f"{duration_s:.3g} s"
