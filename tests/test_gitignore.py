"""What the commands of the README and the docs leave in the tree is none of git's business."""

import re
from pathlib import Path

from are_ros.cli import are

PROJECT = Path(__file__).resolve().parents[1]
OUTPUT = re.compile(r"(?:--out|--plot|--save-scenario|are record) +([a-z][\w./]*)")


def test_what_documented_commands_write_is_ignored() -> None:
    """Every folder after --out and its like, and the defaults of the commands."""
    lines = (PROJECT / ".gitignore").read_text(encoding="utf-8").splitlines()
    ignored = {line.strip("/") for line in lines if line and not line.startswith("#")}
    pages = [PROJECT / "README.md", *sorted((PROJECT / "docs").glob("*.md"))]
    texts = [page.read_text(encoding="utf-8") for page in pages]
    written = [found for text in texts for found in OUTPUT.findall(text)]
    defaults = [
        str(option.default)
        for command in are.commands.values()
        for option in command.params
        if option.name == "out" and isinstance(option.default, Path)
    ]
    assert len(written) > 8
    assert len(defaults) >= 3
    tops = {Path(path).parts[0] for path in (*written, *defaults) if not path.startswith("/")}
    assert tops - ignored == set()
