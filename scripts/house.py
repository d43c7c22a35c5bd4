"""Count how big the house is and how far things go through it; run it before and after a rebuild.

Run as `python scripts/house.py [--json]` with the package installed as for `are replay`. What is
counted depends on no module's name. Three things are taken for granted: `are replay BAG`, a class
`ArBuilder` whose `step` returns a tick, and the tick's `artefacts`.

By reading the sources:

- product lines, files: all lines of are_ros/**/*.py, empty ones too.
- bodies: lines of a function from its first statement that is no docstring to its last, nested
  functions counted within it and for themselves; median, 90th percentile, maximum.
- crowded folders: those with more than twelve modules, `__init__` not counted.
- import circles: strongly connected sets of more than one module (or package) under "is imported
  at run time by", also from inside functions; `if TYPE_CHECKING` does not count. A package here is
  a folder directly below are_ros, a module directly there is one of its own.
- kernels: functions of are_ros that numba compiles, found by importing every module.

By replaying the first seconds of the sample recording twice, with up to 27 artefacts: first to
have every kernel compiled, then under `sys.setprofile`. A function is a code object of are_ros
that is entered: comprehensions and lambdas count, and a generator each time it goes on (so compare
runs of one Python, 3.11 or newer). Kernels count where Python calls them, not each other.

- touched by a tick: the median over all calls of `ArBuilder.step` with 25 to 29 artefacts, of the
  functions, their modules, and the calls.
- hops of a map: the functions that get (as `self` or another argument) or return int8 cells of the
  map's size, or their bytes, or an object or a tuple that has them as an attribute or an item; from
  the reading of the recording until the first tick with a grid in it is written.
- representations of an artefact: the classes of are_ros of which a builder and its tick reach at
  least as many more instances with N artefacts than with none (NamedTuples and dataclasses
  included), or of which an instance has as an attribute an array, a list, a tuple, a dictionary or
  a set of N items, in at least three of the ticks looked at, each with another N if there are.
- hops of an artefact: the functions that are called from another module within `ArBuilder.step`
  and get (other than as `self`) or return an instance of such a class, a list or a tuple of such,
  or an array of N rows.
"""

import argparse
import ast
import contextlib
import functools
import importlib
import inspect
import io
import json
import os
import runpy
import statistics
import sys
import tempfile
from collections import Counter, defaultdict, deque
from collections.abc import Callable, Iterable, Iterator
from enum import Enum
from pathlib import Path
from types import CodeType, FrameType, MethodType
from typing import Any

import numpy as np

PROJECT = Path(__file__).resolve().parents[1]
PACKAGE = PROJECT / "are_ros"
BAG = PROJECT / "bags" / "sample_office.mcap"
REPLAY = (
    *("replay", str(BAG), "--duration", "15", "--set", "population.arrival_rate:=0.05"),
    *("--set", "population.max_alive:=27", "--set", "population.mean_life:=40.0"),
)
MAP_CELLS = 340 * 240
"""Of the sample recording."""
USUAL = range(25, 30)
DOZEN = 12
TICKS_ALIKE = 3
LOOKS = 40
"""Calls of a function that are looked at before it is believed to be no hop."""


def main() -> None:
    """Count, and print a table or JSON."""
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--names", action="store_true", help="name functions, classes and circles")
    given = parser.parse_args()
    os.environ.setdefault("NUMBA_NUM_THREADS", "1")
    sys.path.insert(0, str(PROJECT))
    counted: dict[str, Any] = {**read_sources(), "kernels": len(kernels())}
    watch = replayed()
    counted |= watch.counted()
    if given.json:
        print(json.dumps(counted, indent=2))
        return
    for name, value in counted.items():
        print(f"{name:34s} {_row(value)}")
    if given.names:
        for title in ("map_hops", "artefact_hops", "representations"):
            names = (name.replace(f"{PACKAGE}/", "") for name in getattr(watch, title))
            print(f"\n{title}", *sorted(names), sep="\n  ")


def _row(value: Any) -> str:
    if isinstance(value, dict):
        return ", ".join(f"{name} {part}" for name, part in value.items()) or "none"
    return "; ".join(value) or "none" if isinstance(value, list) else str(value)


# ---------------------------------------------------------------------------- the sources


def read_sources() -> dict[str, Any]:
    """Return what can be counted without running anything."""
    trees, lines = {}, 0
    for path in sorted(PACKAGE.rglob("*.py")):
        text = path.read_text(encoding="utf-8")
        lines += len(text.splitlines())
        trees[_name_of(path)] = ast.parse(text)
    bodies = sorted(body for tree in trees.values() for body in body_lengths(tree))
    folders = Counter(path.parent for path in PACKAGE.rglob("*.py") if path.stem != "__init__")
    modules = {name: set(imports(tree, trees.keys())) - {name} for name, tree in trees.items()}
    packages: dict[str, set[str]] = defaultdict(set)
    for name, imported in modules.items():
        packages[_part(name)] |= {_part(other) for other in imported} - {_part(name), "are_ros"}
    return {
        "product lines": lines,
        "product files": len(trees),
        "bodies": {
            "median": bodies[len(bodies) // 2],
            "90 %": bodies[int(0.9 * len(bodies))],
            "max": bodies[-1],
            "functions": len(bodies),
        },
        "crowded folders": {
            str(path.relative_to(PROJECT)): count
            for path, count in sorted(folders.items())
            if count > DOZEN
        },
        "import circles of modules": [" ".join(sorted(group)) for group in circles(modules)],
        "import circles of packages": [" ".join(sorted(group)) for group in circles(packages)],
    }


def _name_of(path: Path) -> str:
    parts = path.relative_to(PROJECT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def _part(module: str) -> str:
    return ".".join(module.split(".")[:2])


def body_lengths(tree: ast.Module) -> Iterator[int]:
    """Yield the lines of each function's body, without its docstring; none where that is all."""
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            body = node.body[ast.get_docstring(node) is not None :]
            if body:
                yield (body[-1].end_lineno or 0) - body[0].lineno + 1


def imports(tree: ast.AST, known: Any) -> Iterator[str]:
    """Yield the modules of are_ros that a module imports at run time, by absolute names."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test):
            continue
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names if alias.name in known)
        elif isinstance(node, ast.ImportFrom) and node.module in known:
            inner = [f"{node.module}.{alias.name}" for alias in node.names]
            yield from (name if name in known else str(node.module) for name in inner)
        else:
            yield from imports(node, known)


def circles(edges: dict[str, set[str]]) -> list[set[str]]:
    """Return the sets of more than one node that reach each other."""
    reach = {name: _reached(edges, name) for name in edges}
    together = {
        frozenset({other for other in reach[name] if name in reach.get(other, ())})
        for name in edges
    }
    return [set(group) for group in together if len(group) > 1]


def _reached(edges: dict[str, set[str]], start: str) -> set[str]:
    found: set[str] = set()
    left = [start]
    while left:
        new = edges.get(left.pop(), set()) - found
        found |= new
        left.extend(new)
    return found


def kernels() -> dict[str, list[tuple[Any, str]]]:
    """Return the compiled functions of are_ros: their name, and (module, attribute) of each."""
    found: dict[str, list[tuple[Any, str]]] = defaultdict(list)
    for path in sorted(PACKAGE.rglob("*.py")):
        with contextlib.suppress(ImportError):  # a part whose middleware is not installed
            module = importlib.import_module(_name_of(path)) if path.stem != "__main__" else None
            for attribute, value in list(vars(module).items()) if module else ():
                function = getattr(value, "py_func", None)
                if function is not None and function.__module__.startswith("are_ros"):
                    found[f"{function.__module__}.{function.__qualname__}"].append(
                        (module, attribute)
                    )
    return dict(found)


# ---------------------------------------------------------------------------- the run


class Watch:
    """What a profiler sees of a replay; `is_warm` is set for the second one."""

    def __init__(self) -> None:
        self.map_hops: set[str] = set()
        self.artefact_hops: set[str] = set()
        self._called_from_outside: set[str] = set()
        self.ticks: list[tuple[int, Counter[str]]] = []
        self.is_warm = False
        self._looks: Counter[tuple[str, str]] = Counter()
        self._like_artefacts: Counter[str] = Counter()
        self._empty: Counter[str] = Counter()
        self._calls: Counter[str] | None = None
        self._alive = 0
        self._is_map_given = self._is_map_out = False
        self._codes_of_kernels: set[CodeType] = set()

    @property
    def representations(self) -> set[str]:
        """The classes that hold artefacts."""
        return {name for name, ticks in self._like_artefacts.items() if ticks >= TICKS_ALIKE}

    def counted(self) -> dict[str, Any]:
        """Return the numbers."""
        usual = [calls for alive, calls in self.ticks if alive in USUAL]
        if not usual:
            raise RuntimeError(f"no tick had {USUAL.start} to {USUAL.stop - 1} artefacts")
        median = statistics.median_low
        return {
            "hops of a map": _hops(self.map_hops),
            "hops of an artefact": _hops(self.artefact_hops & self._called_from_outside),
            "a tick with 27 artefacts": {
                "functions": median(len(calls) for calls in usual),
                "modules": median(len(_modules(calls)) for calls in usual),
                "calls": median(calls.total() for calls in usual),
                "ticks": len(usual),
            },
            "representations of an artefact": len(self.representations),
        }

    def profile(self, frame: FrameType, event: str, argument: Any) -> None:
        """Be told by the interpreter."""
        code: Any = frame.f_code
        if event not in {"call", "return"} or not code.co_filename.startswith(str(PACKAGE)):
            return
        if code in self._codes_of_kernels:  # numba tells of these calls, too
            return
        is_step = code.co_qualname == "ArBuilder.step"
        if is_step and event == "call":
            self._calls, self._is_map_out = Counter(), self._is_map_given
        if self.is_warm:
            name = f"{code.co_filename}:{code.co_qualname}"
            if event == "call":
                names = _arguments(code)
                is_method = names[:1] in {("self",), ("cls",)}
                self.entered(name, frame, lambda: [frame.f_locals.get(v) for v in names], is_method)
            else:
                self._look(name, lambda: [argument])
        if is_step and event == "return" and argument is not None:
            self._tick_ended(frame.f_locals["self"], argument)

    def tell_of_kernels(self) -> None:
        """Let each kernel tell that it is called; all are compiled, so none sees another's."""
        for name, places in kernels().items():
            for module, attribute in places:
                kernel = getattr(module, attribute)
                code = kernel.py_func.__code__
                self._codes_of_kernels.add(code)
                setattr(module, attribute, _telling(kernel, f"{code.co_filename}:{name}", self))

    def entered(
        self,
        name: str,
        frame: FrameType | None,
        values: Callable[[], list[Any]],
        is_method: bool = False,
    ) -> None:
        """Note that a function or a kernel is called; `values` gives its arguments."""
        if self._calls is not None:
            self._calls[name] += 1
        caller = frame and frame.f_back
        while caller and caller.f_code.co_filename == "<string>":  # what dataclasses generate
            caller = caller.f_back
        if caller and not name.startswith(f"{caller.f_code.co_filename}:"):
            self._called_from_outside.add(name)
        self._look(name, values, is_method)

    def _look(self, name: str, values: Callable[[], list[Any]], is_method: bool = False) -> None:
        """Find out whether a function gets or returns what is followed."""
        if not self._is_map_out and self._is_new("map", name, self.map_hops):
            self.map_hops |= {name} if any(map(_carries_map, values())) else set()
        in_step = self._calls is not None and self._alive in USUAL
        if in_step and self._is_new("artefact", name, self.artefact_hops):
            known = self.representations
            found = any(
                _carries_artefact(value, self._alive, known) for value in values()[is_method:]
            )
            self.artefact_hops |= {name} if found else set()

    def _is_new(self, what: str, name: str, hops: set[str]) -> bool:
        self._looks[what, name] += 1
        return name not in hops and self._looks[what, name] <= LOOKS

    def _tick_ended(self, builder: Any, tick: Any) -> None:
        self.ticks.append((len(tick.artefacts), self._calls or Counter()))
        self._calls, self._alive = None, len(tick.artefacts)
        if self.is_warm:
            self._is_map_given = self._is_map_given or _carries_map(tick.grids.augmented_map)
            return
        if not self._alive:
            self._empty = reachable(builder, tick, 0)[0]
        elif self._alive in USUAL and len(self.ticks) % 10 == 0:
            instances, holders = reachable(builder, tick, self._alive)
            growing = {n for n, c in instances.items() if c - self._empty[n] >= self._alive}
            self._like_artefacts.update(growing | holders)


def reachable(builder: Any, tick: Any, alive: int) -> tuple[Counter[str], set[str]]:
    """Return the number of instances of each class of are_ros, and which hold `alive` items."""
    seen, left = set(), deque([builder, tick])
    instances: Counter[str] = Counter()
    holders = set()
    while left:
        value = left.popleft()
        if id(value) in seen or isinstance(value, str | bytes | int | float | Enum | type):
            continue
        seen.add(id(value))
        items = _items(value)
        left.extend(items)
        name = _class_of(value)
        if name:
            instances[name] += 1
            if any(_length(item) == alive for item in items):
                holders.add(name)
    return instances, holders


def _items(value: Any) -> list[Any]:
    """Return what an object holds."""
    if isinstance(value, dict):
        return [*value.keys(), *value.values()]
    if isinstance(value, list | tuple | set | frozenset | deque):
        return list(value)
    if isinstance(value, MethodType):
        return [value.__self__]
    if isinstance(value, functools.partial):
        return [*value.args, *value.keywords.values()]
    if not _class_of(value):
        return []
    slots = [slot for kind in type(value).__mro__ for slot in getattr(kind, "__slots__", ())]
    fields = [getattr(value, slot) for slot in slots if hasattr(value, slot)]
    return [*fields, *getattr(value, "__dict__", {}).values()]


def _class_of(value: Any) -> str:
    """Return the name of a value's class if it is one of are_ros, else nothing."""
    kind = type(value)
    return f"{kind.__module__}.{kind.__qualname__}" if kind.__module__[:7] == "are_ros" else ""


def _length(value: Any) -> int:
    if isinstance(value, np.ndarray):
        return len(value) if value.ndim else -1
    return len(value) if type(value) in {list, tuple, dict, set, frozenset} else -1


def _carries_artefact(value: Any, alive: int, known: set[str]) -> bool:
    if isinstance(value, np.ndarray):
        return _length(value) == alive
    if type(value) in {list, tuple} and value:
        value = value[0]
    return _class_of(value) in known


def _carries_map(value: Any) -> bool:
    held = _items(value) if _class_of(value) or isinstance(value, tuple) else ()
    return any(map(_is_map, (value, *held)))


def _is_map(value: Any) -> bool:
    if isinstance(value, np.ndarray):
        return value.size == MAP_CELLS and value.dtype == np.int8
    return isinstance(value, bytes | bytearray) and 0 <= len(value) - MAP_CELLS < 1000


def _arguments(code: CodeType) -> tuple[str, ...]:
    count = code.co_argcount + code.co_kwonlyargcount
    count += bool(code.co_flags & inspect.CO_VARARGS)
    return code.co_varnames[:count]


def _modules(names: Iterable[str]) -> set[str]:
    return {name.split(":")[0] for name in names}


def _hops(names: set[str]) -> dict[str, int]:
    return {"functions": len(names), "modules": len(_modules(names))}


def replayed() -> Watch:
    """Replay twice, and return what was seen."""
    watch = Watch()
    for watch.is_warm in (False, True):
        if watch.is_warm:
            watch.ticks.clear()
            watch.tell_of_kernels()
        with tempfile.TemporaryDirectory() as folder, contextlib.redirect_stdout(io.StringIO()):
            sys.argv = ["are", *REPLAY, "--out", f"{folder}/out"]
            sys.setprofile(watch.profile)
            try:
                runpy.run_module("are_ros", run_name="__main__")
            except SystemExit as end:
                if end.code:
                    raise
            finally:
                sys.setprofile(None)
    return watch


def _telling(kernel: Any, name: str, watch: Watch) -> Callable[..., Any]:
    def told(*arguments: Any) -> Any:
        watch.entered(name, inspect.currentframe(), lambda: list(arguments))
        return kernel(*arguments)

    return told


if __name__ == "__main__":
    main()
