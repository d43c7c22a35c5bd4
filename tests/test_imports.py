"""Imports go one way (DESIGN, the house), by reading the sources."""

import ast
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import are_ros

PACKAGE = Path(are_ros.__file__).parent
BASE = (
    "errors",
    "conventions",
    "_compiled",
    "_version",
    "yaml_text",
    "whole_file",
    "wording",
    "parameters",
)
LAYERS = (
    BASE,
    ("world",),
    ("population",),
    ("agents",),
    ("builder",),
    ("messages",),
    ("describe",),
    ("bag",),
    ("draw",),
    ("node", "checks"),
    ("replay",),
    ("record", "fit", "export"),
    ("lab",),
    ("cli",),
    ("__main__",),
)
"""From the bottom up. `describe` says what a configuration means; adapters may use it.
`record` joins the two adapters: it plays recordings to live nodes, and records them."""
RANK = {name: rank for rank, names in enumerate(LAYERS) for name in names}
CORE = (*BASE, "world", "population", "agents", "builder")
ADAPTERS = {
    "rclpy": ("node", "record"),
    "rosbags": ("bag", "replay"),
    "mcap": ("bag", "checks", "replay"),
    "click": ("cli",),
}
MODULES = sorted(PACKAGE.rglob("*.py"))


def part_of(module: Path) -> str:
    """Return which part of the house a module belongs to."""
    return module.relative_to(PACKAGE).parts[0].removesuffix(".py")


@cache
def tree_of(module: Path) -> ast.Module:
    """Return a module's syntax tree."""
    return ast.parse(module.read_text(encoding="utf-8"))


def imported(module: Path) -> Iterator[str]:
    """Yield the full names of all that a module imports, also inside functions."""
    for node in ast.walk(tree_of(module)):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            dots = "." * node.level
            yield from (f"{dots}{node.module or ''}.{alias.name}" for alias in node.names)


def imports() -> Iterator[tuple[str, str, str]]:
    """Yield (part, module, imported name) for the whole package."""
    for module in MODULES:
        for name in imported(module):
            yield part_of(module), str(module.relative_to(PACKAGE)), name


def test_every_part_has_its_place() -> None:
    """A new package must be put into the order above; `__init__` imports the version only."""
    assert {part_of(module) for module in MODULES} - {"__init__"} <= RANK.keys()
    top = [name for part, _, name in imports() if part == "__init__"]
    assert all(name.startswith("are_ros._version") for name in top)


def test_imports_go_one_way() -> None:
    """A module imports its own part and lower ones; so node and replay never import each other."""
    wrong = [
        f"{module} imports {name}"
        for part, module, name in imports()
        if name.startswith("are_ros.")
        and part != "__init__"
        and (other := name.split(".")[1]) != part
        and not RANK[other] < RANK[part]
        and not RANK[other] == RANK[part] == RANK["errors"]
    ]
    assert wrong == []


def run_time_imports(module: Path) -> Iterator[str]:
    """Yield the full names of what a module imports where it runs, not for type checkers only."""
    todo: list[ast.AST] = [tree_of(module)]
    while todo:
        node = todo.pop()
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test):
            todo += node.orelse
        elif isinstance(node, ast.ImportFrom):
            yield from (f"{node.module}.{alias.name}" for alias in node.names)
        elif isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        else:
            todo += ast.iter_child_nodes(node)


def test_no_modules_import_each_other_in_a_circle() -> None:
    """Nor from inside functions: a module that is imported by none of those left is taken off."""
    by_name = {
        ".".join(module.relative_to(PACKAGE.parent).with_suffix("").parts): module
        for module in MODULES
        if module.name != "__init__.py"
    }
    found = {
        name: {
            other
            for text in run_time_imports(module)
            for other in (text, text.rpartition(".")[0])
            if other in by_name
        }
        for name, module in by_name.items()
    }
    while free := [name for name, others in found.items() if not others & found.keys()]:
        for name in free:
            del found[name]
    assert sorted(found) == []


def test_imports_are_absolute() -> None:
    """Relative ones would escape the test above."""
    assert [name for _, _, name in imports() if name.startswith(".")] == []


def test_the_core_knows_no_middleware() -> None:
    """Neither rclpy nor rosbags nor a message class, nor what reads or shows them."""
    wrong = [
        f"{module} imports {name}"
        for part, module, name in imports()
        if part in CORE
        and (
            name.split(".")[0] in ADAPTERS
            or name.split(".")[0].endswith(("_msgs", "_srvs", "_interfaces"))
        )
    ]
    assert wrong == []


def test_each_middleware_stays_behind_its_adapter() -> None:
    """Rclpy in node and record, rosbags and mcap where recordings are, click in cli only."""
    wrong = [
        f"{module} imports {name}"
        for part, module, name in imports()
        if part not in ADAPTERS.get(name.split(".")[0], (part,))
    ]
    assert wrong == []


def test_nothing_below_the_command_line_prints_or_exits() -> None:
    """Neither print nor sys.exit, nor their likes."""
    names = {"print", "exit", "quit", "breakpoint", "input"}
    attributes = {("sys", "exit"), ("os", "_exit"), ("sys", "stdout"), ("sys", "stderr")}
    wrong = [
        f"{module.name}:{node.lineno}"
        for module in MODULES
        if part_of(module) != "cli"
        for node in ast.walk(tree_of(module))
        if (isinstance(node, ast.Name) and node.id in names)
        or (
            isinstance(node, ast.Attribute)
            and isinstance(node.value, ast.Name)
            and (node.value.id, node.attr) in attributes
        )
    ]
    assert wrong == []


def test_the_core_asks_no_clock() -> None:
    """The time is an argument, and so are the dice."""
    wrong = [
        f"{module} imports {name}"
        for part, module, name in imports()
        if part in CORE and name.split(".")[0] in {"time", "datetime", "random", "secrets", "uuid"}
    ]
    assert wrong == []


def test_the_core_throws_no_global_dice() -> None:
    """Of numpy.random it uses seeded generators only."""
    allowed = {"Generator", "PCG64", "SeedSequence"}
    wrong = [
        f"{module.name}:{node.lineno} {node.attr}"
        for module in MODULES
        if part_of(module) in CORE
        for node in ast.walk(tree_of(module))
        if isinstance(node, ast.Attribute)
        and isinstance(node.value, ast.Attribute)
        and node.value.attr == "random"
        and node.attr not in allowed
    ]
    assert wrong == []
