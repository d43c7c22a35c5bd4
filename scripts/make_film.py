"""Makes the pictures of the README: `python scripts/make_film.py [--out FOLDER] [--find SEED]`.

It replays the sample recording with bags/sample_film.yaml, and writes the animation, the overview
and, if there is a Chromium, a picture of the viewer's page, into docs/images. It says when the
three scenes are that the film is to show; its status is 1 if one is missing. Once artefacts decide
otherwise than before, `--find SEED` tries the seeds from this one on, until a run has all three.
"""

import argparse
import math
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping
from itertools import count, pairwise
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

PROJECT: Final = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(PROJECT))  # the browser is that of the tests

from are_ros.builder.tick import MOTION_ONLY  # noqa: E402 - found by the line above
from are_ros.conventions import NS_PER_S  # noqa: E402
from are_ros.draw.scene import Doing, Life, SceneRecord  # noqa: E402
from are_ros.replay.command import effective_parameters  # noqa: E402
from are_ros.replay.recorded_scene import read_recorded_scene  # noqa: E402
from are_ros.replay.session import run_replay  # noqa: E402
from are_ros.replay.timeline import ReplayOptions  # noqa: E402

BAG: Final = PROJECT / "bags" / "sample_office.mcap"
PARAMETERS: Final = PROJECT / "bags" / "sample_film.yaml"
IN_COMPANY: Final = re.compile(r"talking|following artefact \d+")
WAITING: Final = re.compile(r"waiting for artefact (\d+)")
LATE_S, SHORTEST_S, SHORTEST_M = 15.0, 3.0, 2.5
PAGE_PX: Final = (1280, 800)
NOTICE: Final = ".mantine-Notification-closeButton"
PAGE_AT: Final = 0.37
"""The share of the run after which the picture of the page is taken."""


class Spell(NamedTuple):
    """A doing, and when it ended."""

    doing: Doing
    end_ns: int

    @property
    def length_s(self) -> float:
        """How long it took."""
        return (self.end_ns - self.doing.since_ns) / NS_PER_S


def spells(life: Life, end_ns: int) -> list[Spell]:
    """Return what an artefact did in a run that ended at `end_ns`."""
    ends = [doing.since_ns for doing in life.doings[1:]]
    if life.doings:  # a life between two ticks has none
        ends.append(end_ns if life.departure_ns is None else life.departure_ns)
    return [Spell(doing, end) for doing, end in zip(life.doings, ends, strict=True)]


def behaviours(life: Life, end_ns: int) -> list[list[Spell]]:
    """Return the spells, those of one behaviour together."""
    found: list[list[Spell]] = []
    for spell in spells(life, end_ns):
        if not found or found[-1][0].doing.behaviour != spell.doing.behaviour:
            found.append([])
        found[-1].append(spell)
    return found


def moved_m(life: Life, start_ns: int, end_ns: int) -> float:
    """Return how far an artefact went within a time."""
    stamps = life.footprints.stamps_ns
    points_m = life.footprints.poses[(stamps >= start_ns) & (stamps <= end_ns), :2]
    return float(np.linalg.norm(np.diff(points_m, axis=0), axis=1).sum())


def scenes_of(life: Life, classes: Mapping[int, str], end_ns: int) -> Iterator[tuple[str, int]]:
    """Yield the kind of each scene that an artefact plays, and its stamp."""
    for before, after in pairwise(behaviours(life, end_ns)):
        since_ns, behaviour = after[0].doing[:2]
        if before[0].doing.behaviour != "walking":
            continue
        company_s = sum(one.length_s for one in after if IN_COMPANY.fullmatch(one.doing.activity))
        if behaviour in {"gathering", "following"} and company_s >= SHORTEST_S:
            yield "joins", since_ns
        left_s = ((life.departure_ns or math.inf) - since_ns) / NS_PER_S
        ran_m = moved_m(life, since_ns, after[-1].end_ns)
        if behaviour == "running" and left_s <= LATE_S and ran_m >= SHORTEST_M:
            yield "runs", since_ns
    waits = [one for one in spells(life, end_ns) if is_wait(one.doing, life, classes)]
    if sum(one.length_s for one in waits) >= SHORTEST_S:
        yield "waits", waits[0].doing.since_ns


def is_wait(doing: Doing, life: Life, classes: Mapping[int, str]) -> bool:
    """Tell whether a robot waits for a pallet."""
    found = WAITING.fullmatch(doing.activity)
    is_pallet = found is not None and classes.get(int(found[1])) == "pallet"
    return is_pallet and life.row.class_name == "robot"


def scenes(record: SceneRecord) -> dict[str, list[str]]:
    """Return the scenes of a run by their kind, in words."""
    start_ns, end_ns = record.series.stamps_ns[[0, -1]].tolist()
    classes = {life.artefact_id: life.row.class_name for life in record.lives}
    found: dict[str, list[str]] = {"joins": [], "runs": [], "waits": []}
    for life in record.lives:
        for kind, stamp_ns in scenes_of(life, classes, end_ns):
            at_s = (stamp_ns - start_ns) / NS_PER_S
            found[kind].append(f"{at_s:.1f} s: {life.row.label} {life.artefact_id}")
    return found


def say(found: Mapping[str, list[str]]) -> bool:
    """Print the scenes; tell whether there is one of each kind."""
    for kind, places in found.items():
        print(f"{kind:6}", "; ".join(places) or "nobody")
    return all(found.values())


def find(seed: int) -> None:
    """Try one seed after the other until a run has all scenes."""
    for number in count(seed):
        parameters = effective_parameters([PARAMETERS], [], number)
        options = ReplayOptions((BAG,), parameters, demand=MOTION_ONLY)
        outcome = run_replay(options, lambda _: None, lambda *_: lambda _: None)
        print(f"seed {number}")
        if say(scenes(outcome.record)):
            return


def write_page_picture(page: Path, picture: Path) -> None:
    """Write a picture of the viewer's page, if there is a Chromium."""
    from tests.browser import find_browser, open_page
    from tests.draw.test_viewer import PAUSE, go_to, settled

    if find_browser() is None:
        return
    with open_page(page.as_uri(), page.parent / "profile", *PAGE_PX) as shown:
        shown.wait(f"!!document.querySelector('{PAUSE}')")
        shown.run(f"document.querySelector('{PAUSE}').closest('button').click()")
        shown.run(f"document.querySelectorAll('{NOTICE}').forEach(button => button.click())")
        go_to(shown, PAGE_AT)
        settled(shown)
        shown.picture(picture)


def make(out: Path) -> bool:
    """Replay, and write the pictures into a folder; tell whether all scenes are there."""
    out.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as folder:
        run, files = Path(folder), ["--params", str(PARAMETERS), "--out", folder]
        command = [sys.executable, "-m", "are_ros", "replay", str(BAG), *files]
        subprocess.run([*command, "--with-inputs", "--animate"], cwd=PROJECT, check=True)
        shutil.copy(run / "animation.gif", out / "sample_office.gif")
        shutil.copy(run / "overview.png", out / "sample_office.png")
        write_page_picture(run / "view.html", out / "sample_office_live.png")
        record = read_recorded_scene(run / "augmented.mcap", lambda *_: lambda _: None).record
    return say(scenes(record))


def main() -> None:
    """Make the film, or find a seed for it."""
    parser = argparse.ArgumentParser(description="Make the film of the README.")
    parser.add_argument("--out", type=Path, default=PROJECT / "docs" / "images")
    parser.add_argument("--find", type=int, metavar="SEED")
    given = parser.parse_args()
    if given.find is not None:
        find(given.find)
    elif not make(given.out):
        sys.exit(1)


if __name__ == "__main__":
    main()
