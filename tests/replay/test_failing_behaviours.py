"""A behaviour of the user's own that fails ends a replay and a soak with one sentence."""

from collections.abc import Callable
from pathlib import Path
from subprocess import CompletedProcess

import pytest

RunAre = Callable[..., CompletedProcess[str]]
CATALOGUE = """
classes:
  person:
    shape: person
    motion: {{speed_mps: 1.35, turn_rate_radps: 3.0}}
    behaviours: {{"tests.agents.behaviours.failing:{kind}": 1}}
rows:
  - {{label: guest, class: person, size_m: [0.31, 0.55, 1.7]}}
"""
BUSY = ("mixture.weights:=[1.0]", "mixture.rates:=[0.3]", "population.arrival_rate:=0.05")


def options(folder: Path, kind: str) -> list[object]:
    """Return the options for a crowd of such a behaviour."""
    path = folder / "catalogue.yaml"
    path.write_text(CATALOGUE.format(kind=kind), encoding="utf-8")
    settings = (f"catalogue:={path}", *BUSY)
    return [word for setting in settings for word in ("--set", setting)]


@pytest.mark.parametrize(
    ("kind", "words"),
    [
        ("Late", "ValueError: late boom ("),
        ("Unmade", "RuntimeError: no parts ("),
        ("Returns", "decide returned None, which is no Intent ("),
    ],
)
def test_a_replay_ends_with_the_sentence(
    kind: str, words: str, run_are: RunAre, sample_bag: Path, tmp_path: Path
) -> None:
    """Status 1, and no traceback; nobody stands in silence in a replay."""
    done = run_are(
        "replay", sample_bag, "--duration", 20, *options(tmp_path, kind), "--out", tmp_path / "out"
    )
    assert done.returncode == 1
    (sentence,) = (line for line in done.stderr.splitlines() if line.startswith("are: "))
    assert f"the behaviour tests.agents.behaviours.failing:{kind} of artefact " in sentence
    assert " (guest) failed at " in sentence
    assert words in sentence
    assert "failing.py, line " in sentence
    assert "Traceback" not in done.stderr


def test_a_soak_ends_with_the_sentence(run_are: RunAre, sample_bag: Path, tmp_path: Path) -> None:
    """As a replay does."""
    place = sample_bag.with_name("sample_office_map.yaml")
    crowd = options(tmp_path, "Late")
    done = run_are("soak", "--map", place, "--minutes", 5, *crowd, "--out", tmp_path / "out")
    assert done.returncode == 1
    assert "failing:Late of artefact " in done.stderr.splitlines()[-1]
    assert "Traceback" not in done.stderr
