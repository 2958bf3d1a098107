"""Group the commands; print errors as one line on stderr and set exit statuses."""

from __future__ import annotations

import io
import os
import re
import signal
import sys
import warnings
from typing import TextIO

import click

from cablepod.cli import _process
from cablepod.errors import ArchiveError, RunStopped, SceneError, closest, printable

#: How commands that run the chain name it, which messages of the package name by its function.
CHAIN = {"ensemble": "the chain (--model chain)", "run": "the chain"}


class Group(click.Group):
    """Group of commands in the order of definition; errors give an exit status instead of a traceback."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the names of the commands in the order of definition."""
        return list(self.commands)

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Find the command; name similar ones if there is none."""
        try:
            return super().resolve_command(ctx, args)
        except click.UsageError as error:
            similar = closest(args[0], self.commands)
            if similar and not getattr(error, "possibilities", None):  # newer versions of click name them
                raise click.UsageError(f"{error.message.rstrip('.')}; try: {' or '.join(similar)}", ctx) from None
            raise

    def invoke(self, ctx: click.Context) -> int:
        """Run a command; return its exit status."""
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("always")
                # restored on exit
                warnings.showwarning = lambda message, *_, **__: note(spoken(message, ctx.invoked_subcommand))
                return super().invoke(ctx) or 0
        except click.UsageError as error:
            path = " ".join(filter(None, (ctx.command_path, ctx.invoked_subcommand)))
            return fail_usage(error, path)
        except (SceneError, ArchiveError, RunStopped) as error:
            return fail(spoken(error, ctx.invoked_subcommand))
        except KeyboardInterrupt:
            return interrupted(ctx.invoked_subcommand)
        except BrokenPipeError:  # the reader of the output, such as head, closed it
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            return 1
        except MemoryError:
            return fail("out of memory; try fewer links, instants or modes")
        except OSError as error:
            return fail(f"{error.filename or 'a file could not be written'}: {error.strerror or error}")

    def status(self, arguments: list[str] | None) -> int:
        """Parse the arguments, by default those of the process, and run the command; return its exit status."""
        for stream in (sys.stdout, sys.stderr):  # a terminal that is not UTF-8 gets escapes of what it cannot show
            if isinstance(stream, io.TextIOWrapper) and stream.errors == "strict":
                stream.reconfigure(errors="backslashreplace")
        try:
            return self.main(arguments, prog_name="cablepod", standalone_mode=False) or 0
        except click.UsageError as error:
            return fail_usage(error, "cablepod")
        except click.Abort:  # Ctrl-C before a command runs
            return interrupted(None)


def import_matplotlib() -> None:
    """Import matplotlib with the backend that draws into files; that of the environment may not exist here."""
    given = os.environ.pop("MPLBACKEND", None)
    try:
        import matplotlib as mpl

        mpl.use("Agg")
    finally:
        if given is not None:
            os.environ["MPLBACKEND"] = given


def say(text: str, *, end: str = "\n", file: TextIO | None = None) -> None:
    """Print a text, on stdout by default; escape what would control the terminal."""
    print(printable(text), end=end, file=file or sys.stdout)


def fail(message: str, status: int = 2) -> int:
    """Print an error as one line; return its exit status."""
    say("cablepod: " + " ".join(message.split()), file=sys.stderr)
    return status


def fail_usage(error: click.UsageError, path: str) -> int:
    """Print an error of the arguments, with the command that explains them; return the exit status."""
    text = error.format_message().rstrip(".?")
    return fail(f"{text[:1].lower()}{text[1:]}; try: {path} --help")


def interrupted(command: str | None) -> int:
    """Print the message after Ctrl-C; return the exit status."""
    print(_process.message(command), file=sys.stderr)
    return _process.STATUS[signal.SIGINT]


def spoken(message: Exception | str, command: str | None) -> str:
    """Return a message of the package in the words of a command: options of the command line for those of Python."""
    text = str(message).replace("overwrite=True", "--overwrite")  # the option of every command that writes
    return re.sub(r"\bchain\.simulate\b(?!\()", CHAIN[command], text) if command in CHAIN else text


def note(message: Warning | str) -> None:
    """Print a warning as one line, without its location in the code."""
    text = "cablepod: note: " + " ".join(printable(str(message)).split())
    if "tqdm" in sys.modules:  # a bar may be drawn: remove it, print, draw it again
        sys.modules["tqdm"].tqdm.write(text, file=sys.stderr)
    else:
        say(text, file=sys.stderr)
