"""What is compiled is kept on disk, for as long as it is what the sources say."""

import os
import resource
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from are_ros import _compiled

_INNER = """
from pair._compiled import compiled

@compiled
def inner(x):
    return x + {}
"""
_OUTER = """
from pair._compiled import compiled
from pair.inner import inner

@compiled
def outer(x):
    return 10 * inner(x)
"""
_CALL = """
from pair.outer import outer
print(outer({}), sum(outer.stats.cache_misses.values()))
"""


@pytest.fixture
def pair(tmp_path: Path) -> Path:
    """Return a package of two modules: a kernel of the one calls a kernel of the other."""
    package = tmp_path / "pair"
    package.mkdir()
    shutil.copy(_compiled.__file__, package)
    for name, text in {"__init__": "", "inner": _INNER.format(1), "outer": _OUTER}.items():
        (package / f"{name}.py").write_text(text, encoding="ascii")
    return package


def begin(pair: Path, argument: str, cache: str = "") -> subprocess.Popen[str]:
    """Let a process call `outer`, and print the result and how often it was not in the cache."""
    return run(pair, _CALL.format(argument), cache)


def run(pair: Path, program: str, cache: str = "") -> subprocess.Popen[str]:
    """Begin a program that can import the package."""
    environment = {**os.environ, "PYTHONPATH": str(pair.parent), "NUMBA_CACHE_DIR": cache}
    command = [sys.executable, "-c", program]
    return subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, text=True)


def call(pair: Path, argument: str, cache: str = "") -> list[str]:
    """Return what such a process printed."""
    return begin(pair, argument, cache).communicate(timeout=120)[0].split()


def test_a_kernel_is_made_anew_when_what_it_calls_has_changed(pair: Path) -> None:
    """The callee is in another module, which numba itself does not look at."""
    assert call(pair, "1") == ["20", "1"]
    assert call(pair, "1") == ["20", "0"]
    (pair / "inner.py").write_text(_INNER.format(2), encoding="ascii")
    assert call(pair, "1") == ["30", "1"]


@pytest.mark.parametrize("length_bytes", [0, 50])
@pytest.mark.parametrize("suffix", ["nbi", "nbc"])
def test_a_damaged_cache_is_made_anew(
    pair: Path, tmp_path: Path, suffix: str, length_bytes: int
) -> None:
    """As where the power was cut before the disk had the file."""
    cache = tmp_path / "cache"
    assert call(pair, "1", str(cache)) == ["20", "1"]
    (damaged,) = cache.rglob(f"*.{suffix}")
    os.truncate(damaged, length_bytes)
    assert call(pair, "1", str(cache)) == ["20", "1"]
    assert call(pair, "1", str(cache)) == ["20", "0"]


def test_a_kernel_that_only_kernels_call_has_no_code_of_its_own(pair: Path, tmp_path: Path) -> None:
    """It is kept as a part of its caller; when Python calls it, too, it is compiled by itself."""
    cache = tmp_path / "cache"
    assert call(pair, "1", str(cache)) == ["20", "1"]
    kept = list(cache.rglob("*.nbi"))
    assert len(kept) == 1
    assert kept[0].name.startswith("outer.outer")
    from_python = run(pair, "from pair.inner import inner; print(inner(1))", str(cache))
    assert from_python.communicate(timeout=120)[0].split() == ["2"]
    assert len(list(cache.rglob("*.nbi"))) == 2


@pytest.mark.parametrize("is_kept", [False, True])
def test_a_kernel_that_python_has_called_is_not_compiled_for_others_again(
    pair: Path, is_kept: bool
) -> None:
    """Whether it was compiled by this process, or an earlier one."""
    if is_kept:
        run(pair, "from pair.inner import inner; inner(4)").communicate(timeout=120)
    program = """
from numba.core import event
from pair.inner import inner
from pair.outer import outer
with event.install_recorder("numba:compile") as seen:
    before = inner(4)
    print(before, outer(4))
print(*[e.data["dispatcher"].py_func.__name__ for _, e in seen.buffer if e.is_start])
"""
    compiled = ["outer"] if is_kept else ["inner", "outer"]
    assert run(pair, program).communicate(timeout=120)[0].split() == ["5", "50", *compiled]


def test_calls_far_down_on_a_long_stack_map_no_memory() -> None:
    """Wherever a piece of Python's stack ends, else each call there maps another one."""

    def leaf() -> None:
        return

    def down(depth: int) -> None:
        for _ in range(500):
            leaf()
        if depth:
            down(depth - 1)

    @_compiled.on_long_stack
    def begin_down() -> None:
        down(200)

    def faults() -> int:
        return resource.getrusage(resource.RUSAGE_SELF).ru_minflt

    begin_down()
    before = faults()
    begin_down()
    assert faults() - before < 200


def test_what_a_part_raises_comes_out_of_its_caller(pair: Path) -> None:
    """From code that was just compiled, and from code of the disk."""
    text = _INNER.format(1).replace(
        "return", "if x < 0:\n        raise ValueError('negative')\n    return"
    )
    (pair / "inner.py").write_text(text, encoding="ascii")
    program = (
        "from pair.outer import outer\ntry:\n    outer(-1)\nexcept ValueError as e:\n    print(e)"
    )
    for _ in range(2):
        assert run(pair, program).communicate(timeout=120)[0] == "negative\n"


def test_a_touched_source_is_no_other_source(pair: Path) -> None:
    """Contents count, not times: a package that is unpacked again keeps its kernels."""
    assert call(pair, "1") == ["20", "1"]
    os.utime(pair / "inner.py", (0, 0))
    assert call(pair, "1") == ["20", "0"]


def test_a_named_cache_serves_all_places_of_the_same_sources(pair: Path, tmp_path: Path) -> None:
    """As a workspace is built copied and linked; other sources there get kernels of their own."""
    cache = str(tmp_path / "cache")
    elsewhere = tmp_path / "elsewhere" / "pair"
    shutil.copytree(pair, elsewhere)
    assert call(pair, "1", cache) == ["20", "1"]
    assert call(elsewhere, "1", cache) == ["20", "0"]
    (elsewhere / "inner.py").write_text(_INNER.format(2), encoding="ascii")
    assert call(elsewhere, "1", cache) == ["30", "1"]
    assert call(pair, "1", cache) == ["20", "1"]


def test_processes_that_compile_at_once_keep_what_both_made(pair: Path) -> None:
    """One kernel for two kinds of numbers: neither loses its entry, nor gets the other's code."""
    both = [begin(pair, argument) for argument in ("1", "1.5")]
    assert [each.communicate(timeout=120)[0].split() for each in both] == [
        ["20", "1"],
        ["25.0", "1"],
    ]
    assert call(pair, "1") == ["20", "0"]
    assert call(pair, "1.5") == ["25.0", "0"]


def test_of_processes_that_want_the_same_kernel_one_compiles_it(pair: Path) -> None:
    """The others wait for it."""
    all_three = [begin(pair, "1") for _ in range(3)]
    said = sorted(each.communicate(timeout=120)[0].split() for each in all_three)
    assert said == [["20", "0"], ["20", "0"], ["20", "1"]]


_REFUSED = """
import os, resource
from are_ros.errors import InstallationError
{}
try:
    from pair.outer import outer
    outer(1)
except InstallationError as error:
    print(error)
"""


def test_where_no_folder_can_be_written_the_variable_is_named(pair: Path) -> None:
    """As in a container without a home, with a package of root's: each start would take minutes."""
    (pair / "__pycache__").touch()
    nowhere = "os.environ |= {'HOME': '/proc/none', 'XDG_CACHE_HOME': '/proc/none'}"
    said = run(pair, _REFUSED.format(nowhere)).communicate(timeout=120)[0]
    assert f"neither in {pair} nor in" in said
    assert "Set NUMBA_CACHE_DIR to a folder" in said


def test_a_full_disk_is_one_sentence(pair: Path, tmp_path: Path) -> None:
    """The kernels cannot be kept; the folder is named."""
    full = "resource.setrlimit(resource.RLIMIT_FSIZE, (0, 0))"
    said = run(pair, _REFUSED.format(full), str(tmp_path / "cache")).communicate(timeout=120)[0]
    folder = tmp_path / "cache" / "pair"
    assert said == f"compiled kernels cannot be kept in {folder}: File too large\n"
