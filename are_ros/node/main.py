"""`ar_builder`, the program: listens to signals before anything that takes long is imported."""

from collections.abc import Sequence

from are_ros.node.startup import stop_on_signals

_OK = 0


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the node until a signal ends it; return the exit status, 1 if it could not run.

    On SIGINT and SIGTERM, at any moment, every marker is deleted and the last map is the real one.
    """
    with stop_on_signals() as stop:
        from are_ros.node.process import run

        return _OK if stop.is_set else run(arguments, stop)
