"""The kernels are compiled beforehand, for as long as somebody wants them."""

import pickle
import subprocess
import sys
from contextlib import ExitStack
from pathlib import Path

import pytest
from numba.core import event

from are_ros.builder import warm_up as module
from are_ros.builder.warm_up import WarmUpNeeds, warm_up
from are_ros.messages.sensors import MINIATURES
from are_ros.population.catalogue import Catalogue, CatalogueRow, MotionLimits
from are_ros.population.meshes.shapes import Shape

SAMPLE = Path(__file__).resolve().parents[2] / "bags" / "sample_office.mcap"

_REPLAY_AFTER_WARM_UP = """
import sys
from are_ros.builder.files.catalogue_file import SHIPPED_CATALOGUE, read_catalogue
from are_ros.builder.warm_up import WarmUpNeeds, warm_up
from are_ros.cli import main
from are_ros.messages.sensors import MINIATURES

def compiled():
    return {
        (name, kernel, str(signature))
        for name, module in sys.modules.items() if name.startswith("are_ros.")
        for kernel, value in vars(module).items() if not isinstance(value, type)
        for signature in getattr(value, "signatures", ())
        if getattr(value, "__module__", "") == name != "are_ros.messages.markers"
    }

warm_up(read_catalogue(SHIPPED_CATALOGUE), WarmUpNeeds(MINIATURES))
known = compiled()
assert len(known) > 30, known
sys.argv = ["are", "replay", *sys.argv[1:]]
try:
    main()
finally:
    print("new:", sorted(compiled() - known))
"""

_KERNELS_OF_BOXES = """
import sys
from are_ros.builder.warm_up import Demand, WarmUpNeeds, warm_up
from tests.builder.test_warm_up import catalogue_of
warm_up(catalogue_of(2), WarmUpNeeds((), Demand(grids=False), has_voxels=False))
for name, module in list(sys.modules.items()):
    for kernel, value in vars(module).items() if name.startswith("are_ros.") else ():
        if not isinstance(value, type) and getattr(value, "signatures", ()):
            print(f"{value.py_func.__module__}.{kernel}")
"""

ALL = WarmUpNeeds(MINIATURES)


def catalogue_of(count: int) -> Catalogue:
    """Return a catalogue of so many boxes."""
    centre, size = (0.0, 0.0, 0.0), (0.4, 0.4, 1.0)
    rows = (CatalogueRow(i, f"box_{i}", "box", size, centre, Shape.CRATE) for i in range(count))
    return Catalogue(tuple(rows))


@pytest.fixture(autouse=True)
def unrehearsed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Begin as a process does that has rehearsed nothing."""
    monkeypatch.setattr(module, "_REHEARSED", set())


def test_what_is_rehearsed_is_ready_but_still_has_to_be_wanted(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A second replay of one process waits for nothing, another catalogue does."""
    assert warm_up(catalogue_of(1), ALL)
    monkeypatch.setattr(module, "_Scene", None)
    assert warm_up(catalogue_of(1), ALL)
    assert not warm_up(catalogue_of(1), ALL, lambda: False)
    with pytest.raises(TypeError, match="not callable"):
        warm_up(catalogue_of(2), ALL)


@pytest.mark.parametrize("count", [1, 2, 5])
def test_it_works_with_catalogues_of_any_length(count: int) -> None:
    """The mixture of the parameters would not: it is made for the shipped one."""
    assert warm_up(catalogue_of(count), ALL)


def test_it_ends_between_two_steps_when_it_is_not_wanted_any_more() -> None:
    """At once, or later on."""
    assert not warm_up(catalogue_of(2), ALL, lambda: False)
    answers = iter([True] * 3)
    assert not warm_up(catalogue_of(2), ALL, lambda: next(answers, False))


def test_it_ends_before_the_next_kernel_when_it_is_not_wanted_any_more(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """In the midst of a step; afterwards nobody listens to the compiler any more."""
    asked: list[bool] = []

    class Compiling:
        def __init__(self, *_: object) -> None: ...

        def plan(self) -> None: ...

        def live(self) -> None:
            with event.trigger_event("numba:compile"):
                asked.append(True)

        def sense(self) -> None: ...

    monkeypatch.setattr(module, "_Scene", Compiling)
    assert warm_up(catalogue_of(1), ALL)
    assert not warm_up(catalogue_of(2), ALL, lambda: False)
    assert asked == [True]
    Compiling().live()
    assert asked == [True, True]


def test_a_helper_rehearses_what_sees_in_a_process_of_its_own() -> None:
    """It gets the catalogue, comes to its end, and tells of no kernel that is in the cache."""
    catalogue = catalogue_of(2)
    assert warm_up(catalogue, ALL)
    with ExitStack() as stack:
        helper = module._Helper(pickle.dumps((catalogue, ALL)), stack)
        helper.start()
        if helper._process is None:
            pytest.skip("a machine of one core has no helper")
        assert helper._process.wait(timeout=300) == 0
        assert not helper.is_busy()
        assert helper.compiled() == set()


def test_what_nobody_wants_is_not_made_ready() -> None:
    """Neither inflation nor scans, where there are none."""
    command = [sys.executable, "-c", _KERNELS_OF_BOXES]
    made = subprocess.check_output(command, text=True, timeout=900).split()
    assert "are_ros.builder.occlusion.kernels.render" in made
    unwanted = ("are_ros.builder.costmap.inflation", "are_ros.builder.sensors.laser_scan")
    assert not [name for name in made if name.startswith(unwanted)]


def test_afterwards_a_run_needs_no_kernel_for_other_arguments(tmp_path: Path) -> None:
    """Or a live node would lose ticks to the compiler; those that encode messages are small."""
    parameters = str(SAMPLE.with_suffix(".yaml"))
    arguments = [str(SAMPLE), "--params", parameters, "--out", str(tmp_path / "out")]
    done = subprocess.run(
        [sys.executable, "-c", _REPLAY_AFTER_WARM_UP, *arguments],
        capture_output=True,
        text=True,
        timeout=900,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[-1] == "new: []", done.stdout


def test_behaviours_of_the_users_own_have_no_part_in_the_rehearsal() -> None:
    """One that cannot even be made fails nobody before somebody has arrived."""
    motion = MotionLimits(1.0, 1.5, 3.0)
    shares = {"walking": 0.25, "standing": 0.25, "tests.agents.behaviours.failing:Unmade": 0.5}
    planners = {"tests.agents.behaviours.failing:Unmade": 1.0}
    box = ((0.3, 0.5, 1.7), (0.0, 0.0, 0.0), Shape.PERSON)
    row = CatalogueRow(
        0, "guest", "person", *box, motion=motion, behaviours=shares, planners=planners
    )
    assert warm_up(Catalogue((row,)), ALL)
    (tame,) = module._tame(Catalogue((row,))).rows
    assert tame.behaviours == {"walking": 0.75, "standing": 0.25}
    assert tame.planners == {"dynamic_window": 1.0}
