"""`are`, also as `python -m are_ros`."""

import signal

from are_ros.errors import missing_packages


def main() -> str | None:
    """Run `are`; a Ctrl-C before its modules are there ends it without Python's traceback.

    Returns a sentence for `sys.exit` where a package is not installed: the node needs fewer.
    """
    interrupt = signal.getsignal(signal.SIGINT)
    if interrupt is signal.default_int_handler:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    try:
        from are_ros.cli import main as run

        signal.signal(signal.SIGINT, interrupt)
        run()
    except ModuleNotFoundError as cause:
        return f"are: {missing_packages(cause, ('replay',))}"
    return None


if __name__ == "__main__":
    raise SystemExit(main())
