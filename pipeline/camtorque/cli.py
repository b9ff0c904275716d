"""The `camtorque` command: reads its arguments, has one command done, prints. The only room that prints.

Exit status: 0 done, 1 a campaign with refused recordings (findings of severity error in `check` and `predict`, changed
files in `verify`), 2 refused, 3 a value outside its limits or not to be told, 70 an unexpected error, 130 stopped by
Ctrl-C, 143 terminated.
"""

from __future__ import annotations

import argparse
import json
import re
import sys
import warnings
from collections.abc import Mapping, Sequence
from contextlib import suppress
from functools import partial
from importlib import import_module
from typing import Any, NoReturn

from camtorque.commands import COMMANDS, REFUSED, Outcome
from camtorque.commands.arguments import add_arguments
from camtorque.process.stopping import before_leaving, stoppable
from camtorque.process.system import described, forget, no_tracebacks, silence_output, usable_streams
from camtorque.progress import silent
from camtorque.version import __version__

UNEXPECTED, STOPPED = 70, 130
OUTPUT = "standard output"
ESCAPED = re.compile(r"\\u(dc[89a-f][0-9a-f])")
"""A byte of a name of a file in quotes: the stream knows best whether it can be shown."""
ON_WINDOWS = (
    "camtorque: found Windows, expected Linux or macOS, whose locks and signals its commands need; run it in "
    "WSL (`wsl --install`)"
)


class OneLineParser(argparse.ArgumentParser):
    """A parser that says what is wrong in one line."""

    def error(self, message: str) -> NoReturn:
        """Print one line on standard error and leave with status 2."""
        if "expected one argument" in message:
            message += " (a value that begins with a minus is joined to its option by =)"
        self.exit(REFUSED, f"{self.prog}: {message}; see {self.prog} --help\n")

    def _print_message(self, message: str, file: Any = None) -> None:
        """Print; argparse itself would pass over a standard output that takes nothing."""
        if file is sys.stdout:
            put(message, end="")
        else:
            super()._print_message(message, file)


def build_parser() -> argparse.ArgumentParser:
    """Return the parser of the command line."""
    parser = OneLineParser(prog="camtorque", description="Measured-vs-model drive torque of cam-driven pumps.")
    parser.add_argument("--version", action="version", version=f"camtorque {__version__}")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    for name, what in COMMANDS.items():
        add_arguments(commands.add_parser(name, help=what, description=what), name)
    return parser


def _too_many(parsed: argparse.Namespace, more: list[str]) -> str:
    """Return what to say of arguments that a command does not take."""
    options = [text for text in more if text.startswith("-")]
    expected = "no more arguments"
    if options:
        expected = "options of this command"
    elif "recording" in parsed:
        expected = "one RECORDING; camtorque campaign takes a folder of them"
    return f"found {', '.join((options or more)[:3])}, expected {expected}; see camtorque {parsed.command} --help"


def tell(text: str) -> None:
    """Print a line of progress."""
    with suppress(OSError):  # nobody listens any more; the result is still wanted
        print(f"camtorque: {text}", file=sys.stderr, flush=True)


def put(text: str, end: str = "\n") -> None:
    """Print to standard output, whose name an error carries: a report on another disk is well."""
    try:
        print(text, end=end, flush=True)
    except OSError as error:
        raise OSError(error.errno, error.strerror, OUTPUT) from error


def execute(parsed: argparse.Namespace) -> int:
    """Have one command done, print what it found and return the exit status."""
    from camtorque.process.threads import on_one_thread

    # progress is for a person who waits; a log file or a pipe gets the result alone
    progress = tell if sys.stderr.isatty() and not parsed.quiet else silent
    command = import_module(f"camtorque.commands.{parsed.command}")
    outcome: Outcome = on_one_thread(command.execute)(parsed, progress)
    for note in outcome.notes:
        tell(note)
    as_json = getattr(parsed, "json", False)
    for text, document in outcome.stream:
        put(_json(document) if as_json else text)
    if as_json and outcome.document:
        put(_json(outcome.document))
    elif outcome.text:
        put(outcome.text)
    return outcome.status


def _json(document: Mapping[str, Any]) -> str:
    return json.dumps(document, ensure_ascii=False, allow_nan=False)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line, by default that of the process, and return the exit status."""
    usable_streams()
    if sys.platform == "win32":
        print(ON_WINDOWS, file=sys.stderr)
        return REFUSED
    parser = build_parser()
    try:
        parsed, more = parser.parse_known_args(arguments)
    except BrokenPipeError:
        silence_output()
        return 0
    except OSError as error:  # the help, onto a full disk
        print(f"camtorque: {'; '.join(described(error))}", file=sys.stderr)
        silence_output()
        return REFUSED
    if more:
        parser.exit(REFUSED, f"camtorque {parsed.command}: {_too_many(parsed, more)}\n")
    if parsed.debug:
        return _status(parsed)
    warnings.simplefilter("ignore")
    with no_tracebacks():
        return _status(parsed)


def _status(parsed: argparse.Namespace) -> int:
    """Run one command and return the exit status, whatever happens."""
    # hours of work seem lost
    stopped = "stopped; the same command goes on where it was" if parsed.command == "campaign" else "stopped"
    try:
        with stoppable(), before_leaving(partial(tell, stopped)):
            return execute(parsed)
    except KeyboardInterrupt as stop:
        tell(stopped)
        return getattr(stop, "status", STOPPED)
    except BrokenPipeError:
        silence_output()
        return 0
    except Exception as error:
        return _failed(error, parsed)


def _failed(error: Exception, parsed: argparse.Namespace) -> int:
    from camtorque.records import Refusal

    refused = isinstance(error, Refusal)
    if parsed.debug and not refused:
        raise error
    text = str(error) if refused else "; ".join(described(error))
    line = ESCAPED.sub(lambda found: chr(int(found[1], 16)), " ".join(text.split())).removeprefix(f"{parsed.command}: ")
    with suppress(OSError):
        print(f"camtorque {parsed.command}: {line}", file=sys.stderr)
    forget(error)
    if getattr(error, "filename", "") in (None, OUTPUT):
        silence_output()  # most likely the standard output itself, such as a full disk
    return REFUSED if refused or isinstance(error, OSError | MemoryError) else UNEXPECTED


if __name__ == "__main__":
    sys.exit(main())
