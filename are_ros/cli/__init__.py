"""`are`: the group of its commands, and the handling of errors.

Exit status: 0 success; 1 an error, printed as one sentence; 2 a usage error; 3 finished, but some
input was refused or left out, a result could not be written, or a check failed; 130 interrupted.
A doubt, as about clocks or the map, is only said.
"""

import errno
import os
import signal
import sys
from types import FrameType
from typing import Final, NoReturn

# OpenCV reads it when it is imported: a damaged picture is refused in our own sentence.
os.environ.setdefault("OPENCV_LOG_LEVEL", "SILENT")

import click

from are_ros._version import __version__
from are_ros.cli import live, offline
from are_ros.cli.options import FAILED, INTERRUPTED
from are_ros.errors import AreError
from are_ros.wording import why_refused


@click.group(
    invoke_without_command=True,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
)
@click.pass_context
@click.version_option(__version__, prog_name="are")
def are(context: click.Context) -> None:
    """ARE: an Augmented Reality Environment for mobile robots.

    Virtual people, cars and pallets in a real robot's place; what its camera could see of
    them reaches its navigation stack.
    """
    if context.invoked_subcommand is None:
        click.echo(context.get_help())


for _command in (*offline.COMMANDS, *live.COMMANDS):
    are.add_command(_command)


_DISK_ERRORS: Final = {errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO}


def main() -> None:
    """Run `are`; an error is one sentence, with exit status 1, or 2 for wrong usage."""
    interrupts = _noted_interrupts()
    _replace_closed_streams()
    # Pictures are written without a backend, but matplotlib refuses to be imported with a bad one.
    os.environ.pop("MPLBACKEND", None)
    try:
        sys.exit(are(standalone_mode=False))
    except AreError as error:
        _fail(str(error), FAILED)
    except click.UsageError as error:
        command = error.ctx.command_path if error.ctx else "are"
        _fail(f"{error.format_message().rstrip('.')} (see `{command} --help`)", error.exit_code)
    except (KeyboardInterrupt, click.Abort):
        _fail("interrupted", INTERRUPTED)
    except Exception as error:
        if interrupts:
            _fail("interrupted", INTERRUPTED)
        if not isinstance(error, OSError) or error.errno not in _DISK_ERRORS:
            raise
        _fail(f"the output cannot be written: {why_refused(error)}", FAILED)


def _noted_interrupts() -> list[int]:
    """Return a list that gets the signal of each Ctrl-C from now on, before it interrupts.

    Numba's C code raises a SystemError in place of the KeyboardInterrupt, or loses it and fails
    later; what cannot be raised then is not shown.
    """
    interrupts: list[int] = []

    def interrupt(number: int, frame: FrameType | None) -> None:
        interrupts.append(number)
        sys.unraisablehook = lambda _: None
        signal.default_int_handler(number, frame)

    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, interrupt)
    return interrupts


def _replace_closed_streams() -> None:
    """Let a stream that is closed, as by `2>&-`, lead nowhere.

    Else the next file that is opened gets its number, and what a library prints; and tqdm fails.
    """
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, mode, encoding="utf-8"))  # noqa: PTH123, SIM115


def _fail(sentence: str, status: int) -> NoReturn:
    click.secho(f"are: {sentence}", err=True, fg="red")
    sys.exit(status)
