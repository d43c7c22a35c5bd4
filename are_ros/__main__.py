"""`are`, also as `python -m are_ros`."""

import signal


def main() -> None:
    """Run `are`; a Ctrl-C before its modules are there ends it without Python's traceback."""
    interrupt = signal.getsignal(signal.SIGINT)
    if interrupt is signal.default_int_handler:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    from are_ros.cli import main as run

    signal.signal(signal.SIGINT, interrupt)
    run()


if __name__ == "__main__":
    main()
