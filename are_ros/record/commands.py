"""The commands of `are` that play, record and show; `say` prints their text."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from are_ros.draw.viewer import MISSING_VISER, has_viser
from are_ros.errors import BagError
from are_ros.node.startup import stop_on_signals
from are_ros.record.demo import DemoOptions, run_demo
from are_ros.record.demo_summary import summary_of
from are_ros.record.player import PlayOutcome, play
from are_ros.record.publishers import PlayOptions
from are_ros.record.recorder import record
from are_ros.record.topics import RecordOptions
from are_ros.replay.command import effective_parameters
from are_ros.replay.output_folder import (
    AUGMENTED,
    VIEW,
    alone_in,
    animation_path,
    earlier_exports,
    no_empty_folders,
)
from are_ros.replay.pictures import draw_recording, view_recording
from are_ros.replay.progress import ProgressBar, Say
from are_ros.wording import counted


def play_command(say: Say, remaps: Sequence[str], **options: Any) -> bool:
    """Run `are play`; return whether everything could be played."""
    wanted = PlayOptions(remaps=read_remaps(remaps), **options)
    with stop_on_signals(is_last=False) as stop, ProgressBar("play") as bar:
        outcome = play(wanted, say, bar.open, stop.should_stop)
    say(_played(outcome))
    if stop.is_set and not wanted.loop:  # which nothing else ends
        raise KeyboardInterrupt
    return outcome.is_whole


def record_command(say: Say, **options: Any) -> bool:
    """Run `are record`; return whether something is recorded, and nothing was lost."""
    with stop_on_signals(is_last=False) as stop:
        ready = f"recording into {options['path']}; Ctrl-C ends it"
        outcome = record(RecordOptions(**options), say, lambda: say(ready), stop.should_stop)
    for topic, count in sorted(outcome.counts.items()):
        say(f"{count:8d} {topic}")
    for sentence in outcome.sentences():
        say(sentence)
    say(f"{outcome.file}: {outcome.file_bytes / 1e6:.1f} MB")
    return bool(outcome.counts) and not (outcome.skipped or outcome.missed or outcome.dropped)


def demo_command(
    say: Say,
    bag: Path,
    out: Path,
    parameter_files: Sequence[Path],
    assignments: Sequence[str],
    seed: int | None,
    animate: Path | None = None,
    **options: Any,
) -> bool:
    """Run `are demo`; return whether everything could be played."""
    film = None if animate is None else animation_path(animate, out)
    beside = bag.with_suffix(".yaml")
    files = [*([beside] if beside.is_file() else []), *parameter_files]
    parameters = effective_parameters(files, assignments, seed)
    wanted = DemoOptions(bag, parameters, out, **options)
    with no_empty_folders(out), alone_in(out):
        with stop_on_signals(is_last=False) as stop, ProgressBar("demo") as bar:
            outcome = run_demo(wanted, say, bar.open, stop.should_stop)
        say(_played(outcome))
        for line in summary_of(out / AUGMENTED):
            say(line)
        draw_recording(out / AUGMENTED, out / "overview.png", film, say)
        say(f"picture      {out / 'overview.png'}")
        if has_viser():
            view_recording(out / AUGMENTED, out / VIEW, say)
        else:
            say(MISSING_VISER)
        say(f"recording    {out / AUGMENTED}\nnode's log   {out / 'node.log'}")
        for line in earlier_exports(out):
            say(line)
    return outcome.is_whole


def read_remaps(texts: Sequence[str]) -> dict[str, str]:
    """Return {from: to} of texts like "/scan:=/front/scan"; BagError for another form."""
    remaps: dict[str, str] = {}
    for text in texts:
        source, separator, target = text.partition(":=")
        if not (separator and source.strip() and target.strip()):
            raise BagError(f"--remap {text}: it must be /FROM:=/TO, as /scan:=/front/scan")
        remaps[source.strip()] = target.strip()
    return remaps


def _played(outcome: PlayOutcome) -> str:
    """Return how much was played."""
    messages = counted(sum(outcome.counts.values()), "message")
    return f"played       {messages} on {counted(len(outcome.counts), 'topic')}"
