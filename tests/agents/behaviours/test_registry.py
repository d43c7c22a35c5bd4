"""Behaviours by name, the user's own, and what all of them have in common."""

import ast
from pathlib import Path

import hypothesis
import hypothesis.strategies as st
import pytest

import are_ros.agents.behaviours as package
from are_ros.agents.behaviours.along_way import AlongWay
from are_ros.agents.behaviours.registry import BEHAVIOURS, make_behaviour, why_not
from are_ros.agents.behaviours.situation import Behaviour, Intent
from are_ros.builder.files.catalogue_file import read_catalogue
from are_ros.errors import CatalogueError
from tests.agents.behaviours.stage import Actor, Stage, alone, lattice, robot_at

DOCUMENT = Path(__file__).parents[3] / "docs" / "behaviours.md"
WITHOUT_OPTIONS = [name for name in BEHAVIOURS if name != AlongWay.name]


def made(name: str) -> Behaviour:
    """Return a behaviour of any of the names."""
    options = {"waypoints_m": ((1.0, 2.0), (5.0, 6.0))} if name == AlongWay.name else None
    return make_behaviour(name, options)


@pytest.mark.parametrize("name", BEHAVIOURS)
def test_each_name_gives_a_new_behaviour_of_that_name(name: str) -> None:
    """Two artefacts never share an instance."""
    first, second = made(name), made(name)
    assert first is not second
    assert first.name == name


def test_an_unknown_name_is_refused_with_the_known_ones() -> None:
    """The sentence lists them, and says how the user's own are named."""
    with pytest.raises(CatalogueError, match=r"dancing is not known; known are standing, .*:Class"):
        make_behaviour("dancing")


def test_why_a_name_cannot_be_had() -> None:
    """What moves needs a speed; along_way needs waypoints; all else is fine."""
    assert why_not("standing", 0.0) is None
    assert [why_not(name, 1.0) for name in WITHOUT_OPTIONS] == [None] * len(WITHOUT_OPTIONS)
    assert "motion.speed_mps is 0" in str(why_not("walking", 0.0))
    assert "only a scenario gives" in str(why_not("along_way", 1.0))


BROKEN = """
def function(): pass
class Nameless:
    def decide(self, situation): pass
class Undecided:
    name = "undecided"
class Choosy:
    name = "choosy"
    def __init__(self, taste): pass
    def decide(self, situation): pass
"""


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("no_such_module_of_mine:Class", "cannot be imported (ModuleNotFoundError"),
        ("broken_behaviours:Missing", "cannot be imported (AttributeError"),
        ("raising_behaviours:Class", "cannot be imported (ZeroDivisionError"),
        (":Class", "needs the full name of a module"),
        ("broken_behaviours:function", "is no class"),
        ("broken_behaviours:Nameless", "has no class attribute name"),
        ("broken_behaviours:Undecided", "has no method decide"),
        ("broken_behaviours:Choosy", "cannot be constructed without arguments (missing"),
    ],
)
def test_a_class_that_is_no_behaviour_is_refused(
    name: str, words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In one sentence that begins with its name, when it is made and by why_not alike."""
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "broken_behaviours.py").write_text(BROKEN)
    (tmp_path / "raising_behaviours.py").write_text("1 / 0\n")
    with pytest.raises(CatalogueError) as caught:
        make_behaviour(name)
    assert str(caught.value).startswith(f"{name} {words}")
    assert "\n" not in str(caught.value)
    assert str(caught.value) == f"{name} {why_not(name)}"


def test_the_example_of_the_documentation_works(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The class of docs/behaviours.md is named in the catalogue shown there, made, and dances."""
    text = DOCUMENT.read_text()
    (tmp_path / "dancing.py").write_text(text.split("```python\n")[1].split("```")[0])
    (tmp_path / "mine.yaml").write_text(text.split("```yaml\n")[1].split("```")[0])
    monkeypatch.syspath_prepend(tmp_path)
    (row,) = read_catalogue(tmp_path / "mine.yaml").rows
    assert row.behaviours == {"dancing:Dancing": 1.0}
    actor = Actor(0, make_behaviour("dancing:Dancing"), (0.0, 0.0), row)
    assert actor.behaviour.name == "dancing"
    stage = Stage([actor])
    activities = [stage.step()[0].activity for _ in range(60)]
    assert {"looking for room", "dancing"} <= set(activities)
    assert stage.actors[0].point_m != (0.0, 0.0)


def test_the_documentation_names_every_behaviour() -> None:
    """Each has its line in docs/behaviours.md."""
    text = DOCUMENT.read_text()
    assert [name for name in BEHAVIOURS if f"`{name}`" not in text] == []


def intents_of(name: str, seed: int, points: list[tuple[float, float]]) -> list[Intent]:
    """Return what one of these does among walkers, on a stage with a robot."""
    actors = [Actor(5, made(name), points[0], seed=seed)]
    actors += [Actor(k, made("walking"), p, seed=seed) for k, p in enumerate(points[1:])]
    stage = Stage(actors, lattice(4), robot_at((-5.0, 0.5), (0.3, 0.0)))
    return [stage.step()[0] for _ in range(15)]


@hypothesis.settings(max_examples=40)
@hypothesis.given(
    name=st.sampled_from(BEHAVIOURS),
    seed=st.integers(0, 2**32),
    points=st.lists(
        st.tuples(st.floats(-9, 9), st.floats(-9, 9)), min_size=1, max_size=5, unique=True
    ),
)
def test_equal_situations_and_seeds_give_equal_intents(
    name: str, seed: int, points: list[tuple[float, float]]
) -> None:
    """No choice depends on anything but the situations and the artefact's own stream."""
    assert intents_of(name, seed, points) == intents_of(name, seed, points)


@hypothesis.settings(max_examples=60)
@hypothesis.given(
    name=st.sampled_from(BEHAVIOURS),
    blocked_s=st.floats(0.0, 100.0),
    arrived=st.booleans(),
    no_way=st.booleans(),
    count=st.integers(0, 3),
    has_robot=st.booleans(),
)
def test_nothing_that_may_happen_breaks_a_behaviour(
    name: str, blocked_s: float, arrived: bool, no_way: bool, count: int, has_robot: bool
) -> None:
    """Whatever became of the last intent, the next is a sane one, also on top of the robot."""
    actor = Actor(3, made(name), (0.0, 0.0))
    robot = robot_at((0.0, 0.0), (0.0, 0.0)) if has_robot else None
    for second in range(30):
        actor.blocked_s, actor.arrived, actor.no_way = blocked_s, arrived, no_way
        intent = alone(actor, lattice(count), robot=robot, now_s=second)
        assert 0.0 <= intent.speed_mps <= actor.row.motion.top_speed_mps
        assert intent.arrive_within_m > 0.0
        assert intent.activity


def test_behaviours_draw_from_nowhere_else_and_read_no_clock() -> None:
    """By reading the sources: no module of randomness or time is imported."""
    forbidden = {"random", "time", "datetime", "secrets", "uuid"}
    for path in Path(package.__file__).parent.glob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Import):
                assert not forbidden & {alias.name for alias in node.names}
            if isinstance(node, ast.ImportFrom):
                assert node.module not in forbidden
            if isinstance(node, ast.Attribute):
                assert node.attr != "default_rng"
