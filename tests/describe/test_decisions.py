"""What a type would do on a map: its values, best moves, and the shares of its behaviours."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from are_ros.agents.mdp.model import TravelModel, problem_of, solve, ways_to
from are_ros.agents.mdp.value_tables import ValueTables
from are_ros.builder.files.catalogue_file import read_catalogue
from are_ros.describe import decisions
from are_ros.describe.decisions import (
    Lives,
    Way,
    action_values,
    decision_lines,
    journey_of,
    paces_mps,
    row_named,
    simulate_lives,
    simulated_ns,
)
from are_ros.describe.site import Survey, surveyed
from are_ros.errors import CatalogueError, MapError
from are_ros.parameters.declaration import with_values
from are_ros.parameters.model import Parameters
from are_ros.population.catalogue import Catalogue, CatalogueRow
from are_ros.world.occupancy_grid import OccupancyGrid

ROOM = """
######################
#....................#
#....................#
#......#.............#
#......#.............#
#......#########.....#
#....................#
#....................#
######################
"""
PARAMETERS = with_values(Parameters(), {"behaviour.slip": 0.2})


@pytest.fixture(scope="module")
def shipped() -> Catalogue:
    """Return the shipped catalogue."""
    return read_catalogue()


@pytest.fixture
def adult(shipped: Catalogue) -> CatalogueRow:
    """Return a row that walks and runs."""
    return row_named(shipped, "person_adult")


@pytest.fixture
def survey(shipped: Catalogue, grid_of: Callable[[str], OccupancyGrid]) -> Survey:
    """Return a hall of 10 m with a wall in it."""
    found = surveyed(grid_of(ROOM), PARAMETERS, shipped).survey
    assert found is not None
    return found


def test_values_are_those_of_the_tables(adult: CatalogueRow, survey: Survey) -> None:
    """At each remaining life shown, of the best heading; NaN where no way leads to the goal."""
    journey = journey_of(adult, PARAMETERS.behaviour, survey)
    tables = ValueTables(horizon=40, kept_bytes=2**40)
    table = tables.value(journey.coarse, journey.model, journey.goal_m)
    assert table is not None
    assert [best.left_s for best in journey.horizons] == [5.0, 10.0, 20.0, 40.0]
    is_open = np.isfinite(table.costs)
    for best in journey.horizons:
        of_table = table.planes[min(round(best.left_s), len(table.planes) - 1)].max(axis=0)
        assert np.array_equal(best.values[is_open], of_table[is_open])
        assert np.isnan(best.values[~is_open]).all()
        assert np.array_equal(best.moves >= 0, is_open)


@pytest.mark.parametrize("slip", [0.0, 0.2])
def test_the_best_action_brings_the_value(adult: CatalogueRow, survey: Survey, slip: float) -> None:
    """V_t is the greatest Q_t, computed here from V_(t-1) apart from the compiled induction."""
    coarse = journey_of(adult, PARAMETERS.behaviour, survey).coarse
    model = TravelModel.of(adult, paces_mps(adult), coarse.cell_size_m, 1.0, slip)
    assert len(model.reaches) == 2
    goal = (int(np.argwhere(coarse.components >= 0)[0][0]), 3)
    ways = ways_to(coarse.edges, coarse.nearness, goal, model)
    problem, is_open = problem_of(ways), np.isfinite(ways.costs)
    solution = solve(problem, 12, 2**40)
    for t in range(1, 13):
        greatest = action_values(problem, solution.plane(t - 1)).max(axis=1)
        assert greatest[:, is_open] == pytest.approx(solution.plane(t)[:, is_open], abs=1e-5)


def test_who_slips_runs_for_that_slips_less(adult: CatalogueRow, survey: Survey) -> None:
    """A run takes half the moves: with slips it is best in more places, with any time left."""
    steady, slipping = (
        journey_of(adult, with_values(Parameters(), {"behaviour.slip": slip}).behaviour, survey)
        for slip in (0.0, 0.3)
    )
    assert steady.horizons[-1].running_share == 0.0
    assert slipping.horizons[-1].running_share > 0.1
    for without, with_slips in zip(steady.horizons, slipping.horizons, strict=True):
        assert with_slips.running_share > without.running_share


def test_who_is_late_runs(adult: CatalogueRow, survey: Survey) -> None:
    """The less is left of the life, the more of the floor is for running; arrows go to the goal."""
    journey = journey_of(adult, PARAMETERS.behaviour, survey, shown_s=(3.0,))
    late, early = journey.horizons
    assert (late.left_s, early.left_s) == (3.0, 40.0)
    assert late.running_share > early.running_share


def test_shares_sum_to_one() -> None:
    """At each moment over those who live then, and over all time; lives may differ in length."""
    here = np.zeros((4, 2))
    lives = Lives(
        (
            Way(here, ("walking", "walking", "running", "running")),
            Way(here[:2], ("standing", "walking")),
        ),
        {"walking": 0.5, "standing": 0.25, "running": 0.25},
    )
    shares = lives.shares_over_time
    assert shares.sum(axis=0) == pytest.approx(1.0)
    assert shares[:, 0].tolist() == [0.5, 0.5, 0.0]
    assert shares[:, 3].tolist() == [0.0, 0.0, 1.0]
    assert lives.shares == {"walking": 0.5, "standing": 1 / 6, "running": 1 / 3}


def test_a_crowd_lives(
    adult: CatalogueRow,
    shipped: Catalogue,
    survey: Survey,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Crowds of a size that the map has room for; each artefact is known at all its moments."""
    monkeypatch.setattr(decisions, "CROWD", 5)
    monkeypatch.setattr(decisions, "LIFE_NS", 5 * 10**9)
    monkeypatch.setattr(decisions, "_AREA_OF_ONE_M2", survey.region.area_m2 / 3.5)
    assert decisions.crowds_of(survey) == (2, 3)
    times_ns: list[int] = []
    lives = simulate_lives(adult, shipped, PARAMETERS, survey, times_ns.append)
    assert times_ns[-1] == simulated_ns(survey) == 10 * 10**9
    assert [way.points_m.shape for way in lives.ways] == [(20, 2)] * 6
    assert sum(lives.catalogue.values()) == pytest.approx(1.0)
    assert sum(lives.shares.values()) == pytest.approx(1.0)
    moved_m = [np.ptp(way.points_m, axis=0).max() for way in lives.ways]
    assert max(moved_m) > 1.0
    again = simulate_lives(adult, shipped, PARAMETERS, survey)
    for way, same in zip(lives.ways, again.ways, strict=True):
        assert np.array_equal(way.points_m, same.points_m)
    journey = journey_of(adult, PARAMETERS.behaviour, survey)
    text = str(decision_lines(adult, PARAMETERS.behaviour, journey, lives))
    assert "2 and 4 cells of 0.5 m" in text
    assert "effort 0 at 1.2 m/s and 0.21 at 2.2 m/s" in text
    assert "6 simulated lives" in text
    assert "of an epoch 0.2, up to 0.3 more beside walls; 0.19 less for a stop" in text


@pytest.mark.parametrize(
    ("name", "sentence"),
    [
        ("person_adlt", "no such row; did you mean person_adult or "),
        ("person", "no such row; did you mean person_child_small or person_child_tall or "),
        ("42", "no such row; they are numbered from 0 to 41"),
        ("zzz", "no such row; --all lists them"),
        ("pallet_euro", "pallet_euro never moves, it has no choice"),
    ],
)
def test_other_rows_are_refused(shipped: Catalogue, name: str, sentence: str) -> None:
    """One sentence, with near labels."""
    with pytest.raises(CatalogueError, match=f"--decisions {name}: .*{sentence}"):
        row_named(shipped, name)


def test_a_row_has_a_number_too(shipped: Catalogue, adult: CatalogueRow) -> None:
    """As --all lists it."""
    assert row_named(shipped, str(adult.index)) is adult


def test_a_type_that_is_too_wide_has_no_journey(
    shipped: Catalogue, survey: Survey, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A lorry in a hall of 10 m by 3.5 m with a wall: no destination, and no place."""
    lorry = row_named(shipped, "car_lorry")
    with pytest.raises(MapError, match="car_lorry has no destination on this map"):
        journey_of(lorry, PARAMETERS.behaviour, survey)
    monkeypatch.setattr(decisions, "CROWD", 1)
    with pytest.raises(MapError, match="car_lorry finds no place on this map"):
        simulate_lives(lorry, shipped, PARAMETERS, survey)


def test_the_command_draws(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A picture beside the summary; without a map one sentence."""
    from are_ros.cli import are

    monkeypatch.setattr(decisions, "CROWD", 3)
    monkeypatch.setattr(decisions, "LIFE_NS", 3 * 10**9)
    walls = np.full((40, 60), 254, np.uint8)
    walls[:2], walls[-2:], walls[:, :2], walls[:, -2:] = 0, 0, 0, 0
    (tmp_path / "m.pgm").write_bytes(b"P5 60 40 255\n" + walls.tobytes())
    (tmp_path / "m.yaml").write_text(
        "image: m.pgm\nresolution: 0.1\norigin: [0, 0, 0.3]\nnegate: 0\n"
        "occupied_thresh: 0.65\nfree_thresh: 0.25\n"
    )
    words = ["describe", "--decisions", "person_adult"]
    there = ["--map", str(tmp_path / "m.yaml"), "--plot", str(tmp_path / "made" / "d.png")]
    are([*words, *there], standalone_mode=False)
    assert (tmp_path / "made" / "d.png").read_bytes().startswith(b"\x89PNG")
    said = capsys.readouterr().out
    assert said.startswith("Decisions of person_adult\n")
    assert f"picture: {tmp_path / 'made' / 'd.png'}" in said
    with pytest.raises(MapError, match="needs a map"):
        are(words, standalone_mode=False)
