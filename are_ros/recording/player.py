"""`are play`: a recording to live topics, with /clock, as `ros2 bag play --clock` does."""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Final

from are_ros.errors import BagError
from are_ros.recording.clock_teller import ClockTeller
from are_ros.recording.lockstep import Lockstep
from are_ros.recording.pace import Lifelike, Pace, ShouldStop
from are_ros.recording.play_options import PlayOptions
from are_ros.recording.play_outlets import PlayOutlets
from are_ros.recording.play_window import PlayWindow
from are_ros.recording.ros_session import ros_session
from are_ros.recording.subscribers import await_subscribers
from are_ros.replay.bag_reader import BagMessage, BagReader
from are_ros.replay.stopwatch import Progress
from are_ros.wording import duration_text

__all__ = ("PlayOptions", "PlayOutcome", "play")

_LATE_S: Final = 0.1
_LINGER_S: Final = 0.1
"""So long the publishers stay, for the last messages to arrive. (Acknowledgements take up to
three seconds: readers give them when asked, and an idle publisher asks that seldom.)"""
_LATCHED_S: Final = 5.0
"""The time does not go on before the map of the start has arrived, or this is over."""


@dataclass
class PlayOutcome:
    """What was played: messages by recorded topic, how often, what was not and why."""

    counts: Mapping[str, int] = field(default_factory=dict)
    skipped: Mapping[str, str] = field(default_factory=dict)
    passes: int = 0
    is_complete: bool = True


def play(
    options: PlayOptions,
    say: Callable[[str], None],
    open_progress: Callable[[int, int], Progress],
    should_stop: ShouldStop,
) -> PlayOutcome:
    """Play a recording until its end, or until told to stop.

    The first /clock is the start; the next are multiples of its period since the epoch, each sent
    after all messages of before it. What was latched before the start, and the transforms of the
    ten seconds before it, count as sent at the start. `should_stop` is asked at least every 50 ms.
    Raises AreError.
    """
    with BagReader(options.bags) as reader, ros_session("are_player") as node:
        recording = PlayWindow.of(reader, options)
        if recording.clock.sentence:
            say(recording.clock.sentence)
        if recording.gaps_ns:
            say(
                f"nothing moves for {duration_text(recording.gaps_ns)} of the recording, which are "
                "played too: --start and --duration choose a part"
            )
        options.check_topics([topic.name for topic in reader.topics])
        outlets = PlayOutlets(node, reader, options, say)
        if not outlets.topics:
            raise BagError("nothing is left to play of the recording")
        teller = ClockTeller(node, options.clock_hz)
        pace: Pace = Lifelike(options.rate, should_stop)
        if options.lockstep:
            pace = Lockstep(node, options.lockstep, outlets, should_stop)
        publishers = {options.target(name): one for name, one in outlets.publishers.items()}
        publishers |= teller.publishers
        is_complete = await_subscribers(node, publishers, options, say, should_stop)
        outcome = PlayOutcome(outlets.counts, outlets.skipped, is_complete=is_complete)
        progress = open_progress(recording.start_ns, recording.end_ns)
        while outcome.is_complete and (options.loop or not outcome.passes):
            outcome.is_complete = _play_once(recording, outlets, teller, pace, progress)
            outcome.passes += 1
        if outcome.is_complete:
            pace.end()
        time.sleep(_LINGER_S)
        if isinstance(pace, Lifelike) and pace.worst_s > _LATE_S:
            say(f"the player fell behind by up to {pace.worst_s:.2f} s; nothing was left out")
    return outcome


def _play_once(
    recording: PlayWindow, outlets: PlayOutlets, teller: ClockTeller, pace: Pace, progress: Progress
) -> bool:
    """Play the recording once; tell whether it came to its end."""
    pace.begin(recording.start_ns)
    _tell(recording.start_ns, teller, pace)
    for message in recording.earlier(outlets.topics):
        if not pace.wait_a_little():
            return False
        _send(message, outlets, pace)
    pace.begin(recording.start_ns)
    clock = teller.times_after(recording.start_ns, recording.end_ns)
    clock_ns = next(clock, None)
    has_begun = False
    for now_ns, message in recording.messages(outlets.topics):
        while clock_ns is not None and clock_ns <= now_ns:
            if not pace.wait_until(clock_ns):
                return False
            if not has_begun:
                _let_it_arrive(outlets, pace)
                pace.begin(clock_ns)
                has_begun = True
            _tell(clock_ns, teller, pace)
            clock_ns = next(clock, None)
        if not pace.wait_until(now_ns):
            return False
        _send(message, outlets, pace)
        progress(now_ns)
    while clock_ns is not None:
        if not pace.wait_until(clock_ns):
            return False
        _tell(clock_ns, teller, pace)
        clock_ns = next(clock, None)
    progress(recording.end_ns)
    return True


def _let_it_arrive(outlets: PlayOutlets, pace: Pace) -> None:
    """Wait until the map of the start has arrived, if there was one."""
    if outlets.wait_for_latched(_LATCHED_S):
        pace.rest()


def _send(message: BagMessage, outlets: PlayOutlets, pace: Pace) -> None:
    pace.about_to_send(message)
    outlets.publish(message)
    pace.sent(message)


def _tell(now_ns: int, teller: ClockTeller, pace: Pace) -> None:
    pace.about_to_tell()
    teller.tell(now_ns)
    pace.told()
