"""The program of docs/library.md, run as it says."""

import re
import subprocess
import sys
from pathlib import Path

PROJECT = Path(__file__).parents[2]


def test_a_robot_stops_for_people_who_are_not_there() -> None:
    """In a process that knows no ROS and no recordings; twice the same."""
    text = (PROJECT / "docs" / "library.md").read_text(encoding="utf-8")
    program = text.split("```python\n")[1].split("```")[0]
    without = (
        "import sys\nfor name in ('rclpy', 'rosbags', 'mcap', 'click'): sys.modules[name] = None\n"
    )
    command = [sys.executable, "-c", without + program]
    said = {subprocess.check_output(command, cwd=PROJECT, text=True) for _ in range(2)}
    assert len(said) == 1
    found = re.fullmatch(
        r"(\d+) alive, (\d+) were perceived\nat x = (.*) m after 60 s, .* stood for (.*) s\n",
        *said,
    )
    assert found is not None
    alive, perceived, x_m, stood_s = map(float, found.groups())
    assert min(alive, perceived) > 0
    assert x_m > 1.5
    assert 1.0 < stood_s < 60.0
