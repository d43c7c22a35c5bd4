"""When sub-steps end: at multiples of their length since the epoch, while anything comes in."""

from typing import Final

from are_ros.conventions import NS_PER_S

IDLE_NS: Final = 60 * NS_PER_S
"""Once nothing came in for this long, the world stands still between the population's events."""


class StepClock:
    """Gives the end of the next sub-step [ns], `next_ns`, of all that last `period_ns`."""

    def __init__(self, period_ns: int) -> None:
        self.period_ns = period_ns
        self.next_ns = 0
        self.is_running = False
        self._last_input_ns = 0

    def touch(self, received_ns: int) -> None:
        """Say that an input came in."""
        self._last_input_ns = received_ns

    def begin(self, now_ns: int) -> None:
        """Let the first sub-step end now, or as soon after as one can."""
        self.next_ns, self.is_running = -(-now_ns // self.period_ns) * self.period_ns, True

    def stop(self, now_ns: int) -> None:
        """Wait for the next beginning: the clock jumped to `now_ns`."""
        self.next_ns, self.is_running = 0, False
        self._last_input_ns = now_ns

    def go_on(self, now_ns: int) -> None:
        """Turn to the following sub-step; the idle ones of a long pause are left out."""
        step_ns, period_ns = self.next_ns, self.period_ns
        self.next_ns += period_ns
        if step_ns - self._last_input_ns >= IDLE_NS:
            self.next_ns = max(self.next_ns, now_ns // period_ns * period_ns + period_ns)

    @property
    def is_idle(self) -> bool:
        """Whether nothing has come in for long when the next sub-step ends."""
        return self.next_ns - self._last_input_ns > IDLE_NS
