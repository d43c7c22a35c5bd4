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
    hidden = "import sys\nsys.modules |= dict.fromkeys(('rclpy', 'rosbags', 'mcap', 'click'))\n"
    command = [sys.executable, "-c", hidden + program]
    said, again = (subprocess.check_output(command, cwd=PROJECT, text=True) for _ in range(2))
    assert said == again
    words = r"(\d+) alive, (\d+) were perceived\nat x = (.*) m after 60 s, .* stood for (.*) s\n"
    found = re.fullmatch(words, said)
    assert found is not None
    alive, perceived, x_m, stood_s = map(float, found.groups())
    assert min(alive, perceived) > 0
    assert x_m > 1.5
    assert 1.0 < stood_s < 60.0
