"""The test of docs/ci.md, run as it says."""

import os
import subprocess
import sys
from pathlib import Path

PROJECT = Path(__file__).parents[2]


def test_a_program_is_tested_among_people(tmp_path: Path) -> None:
    """By pytest, in a folder with the file of the page, for one seed and ten seconds."""
    text = (PROJECT / "docs" / "ci.md").read_text(encoding="utf-8")
    program = text.split("```python\n")[1].split("```")[0]
    for whole, part in (
        ("params=[1, 2]", "params=[1]"),
        ('"--seed"', '"--duration", "10", "--seed"'),
    ):
        assert program.count(whole) == 1
        program = program.replace(whole, part)
    (tmp_path / "test_among_people.py").write_text(program, encoding="utf-8")
    (tmp_path / "bags").symlink_to(PROJECT / "bags")
    (tmp_path / "pytest.ini").write_text("[pytest]\n", encoding="ascii")
    path = os.pathsep.join((str(Path(sys.executable).parent), os.environ["PATH"]))
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider"]
    done = subprocess.run(
        command,
        cwd=tmp_path,
        env={**os.environ, "PATH": path},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout
    assert "2 passed" in done.stdout
