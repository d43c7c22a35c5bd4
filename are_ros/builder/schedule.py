"""When ticks run: tick k at exactly k periods since the epoch, once."""

from dataclasses import dataclass

from are_ros.conventions import NS_PER_S


@dataclass
class TickSchedule:
    """Gives out the instants of the ticks [ns], in order, each once.

    The first is the first multiple of the period not before `start_ns`.
    """

    period_ns: int
    next_ns: int

    @classmethod
    def of(cls, rate_hz: float, start_ns: int) -> "TickSchedule":
        """Return the schedule of a rate from an instant on."""
        period_ns = tick_period_ns(rate_hz)
        return cls(period_ns, -(-start_ns // period_ns) * period_ns)

    def pop(self, until_ns: int) -> int | None:
        """Return the next instant if it is not after `until_ns`, and go on to the one after."""
        if self.next_ns > until_ns:
            return None
        instant_ns = self.next_ns
        self.next_ns += self.period_ns
        return instant_ns

    def skip_to(self, now_ns: int, backlog_ns: int) -> int:
        """Leave out the ticks that are late by `backlog_ns` or more; return how many.

        For a machine that cannot keep up, and for clocks that jump ahead.
        """
        behind = (now_ns - backlog_ns - self.next_ns) // self.period_ns + 1
        skipped = max(0, behind)
        self.next_ns += skipped * self.period_ns
        return skipped


def tick_period_ns(rate_hz: float) -> int:
    """Return the time from tick to tick [ns]; tick k is at exactly k of them since the epoch."""
    return round(NS_PER_S / rate_hz)
