"""Write the exact versions of all packages that the extras need, for the Python that runs this.

Run by make as `python scripts/pin_packages.py FILE`: pip says what it would install today. With
--keep what FILE names already stays as it is, and only new packages are looked for.
"""

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

PROJECT = Path(__file__).resolve().parents[1]
EXTRAS = "replay,view,test,lint,ros,ros-build,colcon"


def main() -> int:
    """Write the file, and return the exit status."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("file", type=Path)
    parser.add_argument("--keep", action="store_true")
    arguments = parser.parse_args()
    kept = arguments.file if arguments.keep else None
    arguments.file.write_text(pins(report(kept)), encoding="utf-8")
    return 0


def report(kept: Path | None) -> dict[str, Any]:
    """Return pip's report of what it would install; CalledProcessError if it finds no way."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "report.json"
        command = [sys.executable, "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
        command += ["--dry-run", "--ignore-installed", "--report", str(path)]
        command += ["--constraint", str(kept)] if kept else []
        subprocess.run([*command, f"{PROJECT}[{EXTRAS}]"], check=True)
        found: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
        return found


def pins(found: dict[str, Any]) -> str:
    """Return a line `name==version` for every package of a report but our own, sorted."""
    packages = {item["metadata"]["name"]: item["metadata"]["version"] for item in found["install"]}
    packages.pop("are_ros")
    return "".join(f"{name}=={packages[name]}\n" for name in sorted(packages, key=str.lower))


if __name__ == "__main__":
    sys.exit(main())
