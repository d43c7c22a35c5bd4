"""Run the commands with the oldest packages that pyproject.toml allows, in a fresh environment.

A robot brings Ubuntu's scipy and matplotlib, not those of constraints/. Run as
`python scripts/check_oldest.py`, with the oldest Python that has them as wheels. Exit status 0, or
that of the first command that failed.
"""

import os
import re
import subprocess
import sys
import tempfile
import venv
from pathlib import Path

PROJECT = Path(__file__).resolve().parents[1]
SAMPLE = ("bags/sample_office.mcap", "--duration", "30")
OTHER_MAP = ("--map", "bags/sample_office_map.yaml", "--map-frame", "site")
_AT_LEAST = re.compile(r'"([\w.-]+)>=([\d.]+)"')


def oldest() -> list[str]:
    """Return the oldest version of each package that a command needs, with its newest patch."""
    text = (PROJECT / "pyproject.toml").read_text(encoding="utf-8")
    needed = text.partition("\ndependencies = [")[2].partition("\ntest = [")[0]
    return [f"{name}=={version}.*" for name, version in _AT_LEAST.findall(needed)]


def main() -> int:
    """Install the oldest packages, run the commands, and return the exit status."""
    packages = oldest()
    with tempfile.TemporaryDirectory() as folder:
        python = str(Path(folder) / "bin" / "python")
        venv.create(folder, with_pip=True)
        print("with", " ".join(packages), flush=True)
        install = [python, "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
        if status := subprocess.run([*install, *packages], check=False).returncode:
            return status
        environment = {**os.environ, "PYTHONPATH": str(PROJECT), "NUMBA_CACHE_DIR": folder}
        out = str(Path(folder) / "out")
        commands = (
            ("inspect", SAMPLE[0]),
            ("replay", *SAMPLE, "--params", "bags/sample_office.yaml", "--animate", "--out", out),
            ("check", out),
            ("view", out),
            ("export", out, "--mesh", f"{out}/scene.glb"),
            ("align", SAMPLE[0], *OTHER_MAP, "--out", f"{out}/align.png"),
            ("describe", "--plot", f"{out}/plot.png"),
            ("describe", "--decisions", "person_adult", *OTHER_MAP[:2], "--plot", f"{out}/d.png"),
            ("fit", out, "--out", f"{out}/fit"),
        )
        for words in commands:
            print("are", " ".join(words).replace(folder, "."), flush=True)
            command = [python, "-m", "are_ros", *words]
            done = subprocess.run(
                command, cwd=PROJECT, env=environment, capture_output=True, text=True, check=False
            )
            if done.returncode:
                print(done.stdout, done.stderr, file=sys.stderr)
                return done.returncode
    print("the commands work with the oldest packages")
    return 0


if __name__ == "__main__":
    sys.exit(main())
