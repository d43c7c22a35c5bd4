"""The result of one check of a recording, and the tally that counts for it."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum

from are_ros.conventions import NS_PER_S
from are_ros.wording import counted, several


class Outcome(Enum):
    """How a check ended."""

    PASSED = "passed"
    FAILED = "failed"
    SKIPPED = "skipped"


@dataclass(frozen=True)
class CheckResult:
    """One check: how many things were looked at, and the first that was wrong.

    `looked_at` counts things, `noun` names one of them; `failures` were wrong. `reason` says why a
    check was skipped, or what part of it could not be done; `counter_example` is empty unless it
    failed. `needs_inputs`: it was skipped for want of the inputs of a replay.
    """

    name: str
    outcome: Outcome
    looked_at: int = 0
    noun: str = "message"
    failures: int = 0
    counter_example: str = ""
    reason: str = ""
    needs_inputs: bool = False

    def sentence(self) -> str:
        """Return the result in one line of plain words, without a full stop."""
        if self.outcome is Outcome.SKIPPED:
            return f"{self.name}: skipped, {self.reason}"
        reason = f" ({self.reason})" if self.reason else ""
        if self.outcome is Outcome.PASSED:
            return f"{self.name}: passed, {counted(self.looked_at, self.noun)}{reason}"
        wrong = f"{self.failures} wrong of {counted(self.looked_at, self.noun)}{reason}"
        return f"{self.name}: FAILED, {wrong}; the first: {self.counter_example}"


class Tally:
    """Counts what a check looks at, and keeps the first counter-example."""

    def __init__(self, name: str, noun: str) -> None:
        self.name = name
        self.looked_at = 0
        self.failures = 0
        self._noun = noun
        self._first = ""
        self._notes: list[str] = []
        self._left_out: Counter[tuple[str, str]] = Counter()

    def look(self, count: int = 1) -> None:
        """Count things looked at."""
        self.looked_at += count

    def fail(self, counter_example: str, count: int = 1) -> None:
        """Count things that are wrong, of those looked at; the first text is kept."""
        self.failures += count
        self._first = self._first or counter_example

    def require(self, condition: bool, counter_example: str) -> None:
        """Fail unless the condition holds."""
        if not condition:
            self.fail(counter_example)

    def note(self, text: str) -> None:
        """Say which part could not be done; the same text counts once."""
        if text not in self._notes:
            self._notes.append(text)

    def leave_out(self, noun: str, text: str) -> None:
        """Count a thing that could not be checked; the note gives the number and this text.

        `noun` is in the singular; `text` has to fit one thing and several.
        """
        self._left_out[noun, text] += 1

    def result(self) -> CheckResult:
        """Return the outcome; a check that had nothing to look at is skipped."""
        left_out = [
            f"{counted(count, noun)} {text}" for (noun, text), count in self._left_out.items()
        ]
        left_out[:1] = [f"not looked at: {first}" for first in left_out[:1]]
        notes = "; ".join((*self._notes, *left_out))
        if self.failures:
            outcome = Outcome.FAILED
        elif self.looked_at:
            outcome = Outcome.PASSED
        else:
            return skipped(self.name, notes or f"there are no {several(self._noun)}")
        return CheckResult(
            self.name, outcome, self.looked_at, self._noun, self.failures, self._first, notes
        )


def skipped(name: str, reason: str, *, needs_inputs: bool = False) -> CheckResult:
    """Return the result of a check that could not be done."""
    return CheckResult(name, Outcome.SKIPPED, reason=reason, needs_inputs=needs_inputs)


def want_of_inputs(results: Sequence[CheckResult]) -> str:
    """Return how many checks the inputs would make possible, in a sentence; empty if none."""
    count = sum(result.needs_inputs for result in results)
    if not count:
        return ""
    verb = "needs" if count == 1 else "need"
    which = "which `are replay BAG --with-inputs` writes beside the outputs"
    return f"{counted(count, 'skipped check')} {verb} the inputs, {which}"


def merged(results: Sequence[CheckResult]) -> CheckResult:
    """Return the outcome of one check that was done in parts, at least one."""
    failed = [result for result in results if result.outcome is Outcome.FAILED]
    done = [result for result in results if result.outcome is not Outcome.SKIPPED]
    if not done:
        return results[0]
    reasons = dict.fromkeys(result.reason for result in done if result.reason)
    return CheckResult(
        results[0].name,
        Outcome.FAILED if failed else Outcome.PASSED,
        sum(result.looked_at for result in done),
        done[0].noun,
        sum(result.failures for result in failed),
        failed[0].counter_example if failed else "",
        "; ".join(reasons),
    )


def at_s(stamp_ns: int) -> str:
    """Return "at SECONDS s" with all nine digits, as ROS stamps are written."""
    return f"at {stamp_ns // NS_PER_S}.{stamp_ns % NS_PER_S:09d} s"
