"""The `camtorque` command: reads its arguments, has one command done, prints. The only room that prints.

Exit status: 0 done, 1 a campaign with refused recordings (or findings of severity error in `check`), 2 refused,
3 a value outside its limits, 70 an unexpected error, 130 stopped by the user.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import warnings
from collections.abc import Sequence
from importlib import import_module
from typing import NoReturn

from camtorque import __version__
from camtorque.commands import COMMANDS
from camtorque.commands.outcome import Outcome

REFUSED, UNEXPECTED, STOPPED = 2, 70, 130


class OneLineParser(argparse.ArgumentParser):
    """A parser that says what is wrong in one line."""

    def error(self, message: str) -> NoReturn:
        """Print one line on standard error and leave with status 2."""
        self.exit(REFUSED, f"{self.prog}: {message}; see {self.prog} --help\n")


def build_parser() -> argparse.ArgumentParser:
    """Return the parser of the command line."""
    parser = OneLineParser(prog="camtorque", description="Measured-vs-model drive torque of cam-driven pumps.")
    parser.add_argument("--version", action="version", version=f"camtorque {__version__}")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    for name, command in COMMANDS.items():
        arguments = commands.add_parser(name, help=command.help, description=command.help)
        command.arguments(arguments)
        if command.json:
            arguments.add_argument("--json", action="store_true", help="one JSON object on standard output")
        arguments.add_argument("--quiet", action="store_true", help="no progress lines on standard error")
        arguments.add_argument("--debug", action="store_true", help="show where an unexpected error arose")
    return parser


def tell(text: str) -> None:
    """Print a line of progress."""
    print(f"camtorque: {text}", file=sys.stderr, flush=True)


def silent(text: str) -> None:
    """Say nothing."""


def execute(parsed: argparse.Namespace) -> int:
    """Have one command done, print what it found and return the exit status."""
    # progress is for a person who waits; a log file or a pipe gets the result alone
    told = tell if sys.stderr.isatty() and not parsed.quiet else silent
    outcome: Outcome = import_module(COMMANDS[parsed.command].module).execute(parsed, told)
    if getattr(parsed, "json", False):
        print(json.dumps(outcome.document, ensure_ascii=False, allow_nan=False))
    elif outcome.text:
        print(outcome.text)
    return outcome.status


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return the exit status.

    Parameters
    ----------
    arguments : without the program's name; None for those of the process
    """
    parsed = build_parser().parse_args(arguments)
    if not parsed.debug:
        warnings.simplefilter("ignore")
    try:
        return execute(parsed)
    except KeyboardInterrupt:
        return STOPPED
    except BrokenPipeError:
        # the reader of our output (a pager) has gone; keep the interpreter from complaining at exit
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except Exception as error:
        return _failed(error, parsed)


def _failed(error: Exception, parsed: argparse.Namespace) -> int:
    """Say in one line what went wrong."""
    from camtorque.records import Refusal

    if isinstance(error, Refusal):
        print(f"camtorque {parsed.command}: {' '.join(str(error).split())}", file=sys.stderr)
        return REFUSED
    if parsed.debug:
        raise error
    text = " ".join(str(error).split())
    if isinstance(error, OSError):
        print(f"camtorque {parsed.command}: {text}; check the path and its permissions", file=sys.stderr)
        return REFUSED
    print(
        f"camtorque {parsed.command}: unexpected {type(error).__name__}: {text}; run again with --debug and report it",
        file=sys.stderr,
    )
    return UNEXPECTED


if __name__ == "__main__":
    sys.exit(main())
