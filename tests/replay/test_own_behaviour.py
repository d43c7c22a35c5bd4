"""The example of docs/behaviours.md, run as it says."""

import shlex
from pathlib import Path

import pytest

from are_ros.bag.reader import BagReader
from tests.replay.conftest import RunAre

PROJECT = Path(__file__).parents[2]
DOCUMENT = PROJECT / "docs" / "behaviours.md"


def test_guests_dance(run_are: RunAre, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """By the command of the page, from a folder with the two files of the page."""
    text = DOCUMENT.read_text(encoding="utf-8")
    (tmp_path / "dancing.py").write_text(text.split("```python\n")[1].split("```")[0])
    (tmp_path / "my_catalogue.yaml").write_text(text.split("```yaml\n")[1].split("```")[0])
    command = text.split("```\nPYTHONPATH=. are ")[1].split("```")[0].replace("\\\n", " ")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "bags").symlink_to(PROJECT / "bags")
    done = run_are(*shlex.split(command))
    assert done.returncode == 0, done.stderr
    with BagReader([tmp_path / "out" / "dancing" / "augmented.mcap"]) as reader:
        messages = [reader.deserialize(m) for m in reader.messages(["/ar_builder/artefacts"])]
    features = [one.features for message in messages for one in message.artefacts]
    activities = {pair.value for pairs in features for pair in pairs if pair.key == "activity"}
    assert {"dancing", "looking for room"} <= activities
