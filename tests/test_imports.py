"""Imports go one way (DESIGN, the house), by reading the sources."""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

import are_ros

PACKAGE = Path(are_ros.__file__).parent
BASE = ("errors", "conventions", "_compiled", "_version", "parameters")
LAYERS = (
    BASE,
    ("world",),
    ("artefacts",),
    ("builder",),
    ("messages",),
    ("node", "replay", "simulation", "description"),
    ("experiments",),
    ("cli",),
)
RANK = {name: rank for rank, names in enumerate(LAYERS) for name in names}
CORE = (*BASE, "world", "artefacts", "builder")
MIDDLEWARE = ("rclpy", "rosbags", "mcap", "click")
UPWARDS = {("world", "parameters"), ("replay", "description"), ("replay", "simulation")}
MODULES = sorted(PACKAGE.rglob("*.py"))


def part_of(module: Path) -> str:
    """Return which part of the house a module belongs to."""
    return module.relative_to(PACKAGE).parts[0].removesuffix(".py")


def imported(module: Path) -> Iterator[str]:
    """Yield the full names of all that a module imports, also inside functions."""
    for node in ast.walk(ast.parse(module.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{module}: a relative import"
            assert node.module is not None
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def names(module: Path) -> str:
    """Return the name of a module for a test's id."""
    return str(module.relative_to(PACKAGE))


def test_every_part_has_its_place() -> None:
    """A new package must be put into the order above."""
    parts = {part_of(module) for module in MODULES} - {"__init__"}
    assert parts <= RANK.keys()


@pytest.mark.parametrize("module", MODULES, ids=names)
def test_imports_go_one_way(module: Path) -> None:
    """A module imports its own part and lower ones; the parts of one layer know only their own.

    The replay serves the commands that describe; so it alone may use `description`.
    """
    part = part_of(module)
    if part == "__init__":
        return
    for name in imported(module):
        if not name.startswith("are_ros."):
            continue
        other = name.split(".")[1]
        if other == part or (part, other) == ("replay", "description"):
            continue
        if (part, other) == ("simulation", "replay"):
            pytest.fail(f"{module} imports {name}")
        assert RANK[other] < RANK[part] or RANK[other] == RANK[part] == 0, f"{name} in {module}"


@pytest.mark.parametrize("module", [m for m in MODULES if part_of(m) in CORE], ids=names)
def test_the_core_knows_no_middleware(module: Path) -> None:
    """Neither rclpy nor rosbags nor a message class, nor what reads or shows them."""
    for name in imported(module):
        top = name.split(".")[0]
        assert top not in MIDDLEWARE
        assert not top.endswith(("_msgs", "_srvs", "_interfaces"))


@pytest.mark.parametrize("module", MODULES, ids=names)
def test_each_middleware_stays_behind_its_adapter(module: Path) -> None:
    """Rclpy in node only, rosbags and mcap in replay only, click in the command line only."""
    allowed = {"rclpy": ("node",), "rosbags": ("replay",), "mcap": ("replay",), "click": ("cli",)}
    for name in imported(module):
        parts = allowed.get(name.split(".")[0])
        assert parts is None or part_of(module) in parts, f"{name} in {module}"


@pytest.mark.parametrize("module", [m for m in MODULES if part_of(m) != "cli"], ids=names)
def test_nothing_below_the_command_line_prints_or_exits(module: Path) -> None:
    """Neither print nor sys.exit, nor their likes."""
    forbidden = {"print", "exit", "quit", "breakpoint", "input"}
    for node in ast.walk(ast.parse(module.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Name):
            assert node.id not in forbidden, f"{node.id} in {module}"
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
            assert (node.value.id, node.attr) not in {("sys", "exit"), ("os", "_exit")}


@pytest.mark.parametrize("module", [m for m in MODULES if part_of(m) in CORE], ids=names)
def test_the_core_asks_no_clock_and_no_global_dice(module: Path) -> None:
    """No wall clock, no unseeded randomness: the same input gives the same output."""
    for name in imported(module):
        assert name.split(".")[0] not in {"time", "datetime", "random", "secrets", "uuid"}
    source = ast.parse(module.read_text(encoding="utf-8"))
    calls = [node for node in ast.walk(source) if isinstance(node, ast.Attribute)]
    for call in calls:
        if isinstance(call.value, ast.Attribute) and call.value.attr == "random":
            assert call.attr in {"Generator", "PCG64", "SeedSequence"}, f"{call.attr} in {module}"
