"""Every invariant has a test that fails when the code is broken on purpose."""

import importlib.util
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import pytest

PROJECT = Path(__file__).resolve().parents[1]
SCRIPT = PROJECT / "scripts" / "mutate_invariants.py"


@pytest.fixture(scope="module")
def mutations() -> ModuleType:
    """Return the script as a module."""
    spec = importlib.util.spec_from_file_location("mutate_invariants", SCRIPT)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


def test_every_breakage_can_be_applied(mutations: ModuleType) -> None:
    """What it patches is there, and one that is not says so in a sentence."""
    said = []
    for breakage in mutations.BREAKAGES:
        with pytest.MonkeyPatch.context() as patch:
            try:
                mutations.apply(breakage, patch)
            except ValueError as error:
                said.append(str(error))
    assert said == []


def test_every_invariant_is_broken_at_least_once(mutations: ModuleType) -> None:
    """And every breakage names tests that exist."""
    broken = {breakage.invariant for breakage in mutations.BREAKAGES}
    assert broken == set(mutations.INVARIANTS)
    assert (
        len({breakage.name for breakage in mutations.BREAKAGES}) == len(mutations.BREAKAGES) >= 33
    )
    for breakage in mutations.BREAKAGES:
        assert breakage.tests
        for test in breakage.tests:
            path, name = test.split("[")[0].split("::")
            assert f"def {name}(" in (PROJECT / path).read_text(encoding="utf-8")


@pytest.mark.long
def test_every_breakage_is_caught() -> None:
    """The script finds the unbroken copy well, and each broken one ill."""
    done = subprocess.run(
        [sys.executable, str(SCRIPT)], capture_output=True, text=True, timeout=900, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
