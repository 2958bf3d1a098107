"""End the process of the command on SIGINT (Ctrl-C) and SIGTERM: one line on stderr, exit status 130 or 143, at any instant.

Python runs a handler of signals between two bytecodes of the main thread, which may be inside a kernel, the compiler or an import
for seconds, and KeyboardInterrupt may be lost in a callback.  Therefore a thread of its own receives the number of the signal
through the wakeup descriptor, prints the line, silences stderr and ends the process after :data:`GRACE`.  Until then
KeyboardInterrupt in the main thread removes temporary files and releases workers.  Files are whole after an end by force too: all
are replaced atomically.  Commands that write what was computed until then have :data:`TIME_TO_KEEP`, or until a second signal.

This module is imported before anything slow and imports only what Python itself has loaded at its start, and :mod:`signal`.
"""

from __future__ import annotations

import _thread
import atexit
import os
import signal
import sys
import time

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Callable
    from types import FrameType
    from typing import Any, NoReturn

#: Exit statuses: 128 and the number of the signal.
STATUS = {signal.SIGINT: 130, signal.SIGTERM: 143}
#: Time for an orderly end [s].
GRACE = 1.2
#: Commands that write what was computed before the signal, and their time for that [s].
KEEPING, TIME_TO_KEEP = ("respond", "tongues"), 10.0
#: Interval at which a second signal is looked for [s].
LOOK_EVERY = 0.05
#: How to go on, by command; the others begin anew.
GO_ON = dict.fromkeys(("ensemble", "design"), "the same command goes on where it stopped")


def message(command: str | None, number: int = signal.SIGINT) -> str:
    """Return the line that is printed after a signal."""
    cause = "interrupted" if number == signal.SIGINT else "terminated"
    how = GO_ON.get(command or "", "--overwrite begins anew")
    return f"cablepod: {cause}; every file that was written is whole, {how}"


class _Ending:
    """Handlers of the signals, and the thread that ends the process."""

    def __init__(self, command: str | None) -> None:
        self.command = command
        self.number = 0  #: the first signal received; 0 before
        self.said = False
        self.raised = False
        self.lock = _thread.RLock()  # reentrant: a handler may run in the main thread inside :meth:`say`

    def install(self) -> None:
        """Handle the signals from now on; one that is ignored, such as SIGINT in the background, remains so."""
        source, target = os.pipe()
        os.set_blocking(target, False)
        signal.set_wakeup_fd(target, warn_on_full_buffer=False)
        for number in STATUS:
            if signal.getsignal(number) != signal.SIG_IGN:
                signal.signal(number, self.handle)
        signal.pthread_sigmask(signal.SIG_UNBLOCK, STATUS)  # the caller may have blocked them until here
        _thread.start_new_thread(self.watch, (source,))

    def watch(self, source: int) -> None:
        """Wait for a signal, print the line, and end the process after :data:`GRACE`; imports and raises nothing."""
        while True:
            number = os.read(source, 1)[0]
            if number in STATUS:
                self.say(number)
                if self.command in KEEPING:
                    wait_for_second(source)
                time.sleep(GRACE)
                kill_children()
                os._exit(self.status())

    def handle(self, number: int, frame: FrameType | None) -> None:
        """Print the line and raise KeyboardInterrupt in the main thread, once."""
        self.say(number)
        deferring: Any = signal.getsignal(signal.SIGINT)
        if number != signal.SIGINT and callable(deferring) and deferring != self.handle:
            deferring(signal.SIGINT, frame)  # while locks are held: calls this again when they are released
        elif not self.raised:
            self.raised = True
            raise KeyboardInterrupt

    def say(self, number: int) -> None:
        """Print the line once; nothing is printed on stderr after it."""
        with self.lock:
            if self.said:
                return
            self.said, self.number = True, number
            clear = "\r\x1b[K" if os.isatty(2) else ""  # the terminal shows ^C, or a bar
            try:
                stderr = os.dup(2)
                os.dup2(os.open(os.devnull, os.O_WRONLY), 2)  # first: other threads may print meanwhile
                os.write(stderr, f"{clear}{message(self.command, number)}\n".encode())
            except OSError:  # stderr is closed
                pass

    def status(self) -> int:
        """Return the exit status after the signal."""
        return STATUS[signal.Signals(self.number)]


def wait_for_second(source: int) -> None:
    """Wait for another signal, at most :data:`TIME_TO_KEEP`."""
    os.set_blocking(source, False)
    end = time.monotonic() + TIME_TO_KEEP
    while time.monotonic() < end:
        try:
            if os.read(source, 1)[0] in STATUS:
                return
        except BlockingIOError:
            time.sleep(LOOK_EVERY)


def kill_children() -> None:
    """Kill the processes that multiprocessing started, of which only this one knows; raises nothing.

    Workers end by themselves when this process is gone, but only as soon as they look: on a busy machine they import modules for
    seconds before, and keep stdout open.
    """
    module = sys.modules.get("multiprocessing.process")
    for child in list(getattr(module, "_children", ())):
        try:
            child.kill()
        except Exception:  # it has ended
            continue


def run(main: Callable[[], int], arguments: list[str]) -> NoReturn:
    """Run the command and end the process with its exit status; signals are handled to the last instruction."""
    ending = _Ending(arguments[0] if arguments else None)
    status = 1
    try:
        ending.install()
        # of children only: multiprocessing's helper clears after an end by force, and would tell of it after the line
        sys.warnoptions.append("ignore:resource_tracker:UserWarning")
        status = main()
    except SystemExit as error:
        if isinstance(error.code, str):
            print(error.code, file=sys.stderr)
        status = error.code if isinstance(error.code, int) else int(error.code is not None)
    except BaseException:  # a traceback is printed, except after a signal
        sys.excepthook(*sys.exc_info())
    try:
        if not ending.said:
            sys.stdout.flush()
            atexit._run_exitfuncs()  # here, because Python's own end would run no handlers
            sys.stdout.flush()
    except BaseException:
        status = status or 1
    if ending.said:
        kill_children()
    signal.pthread_sigmask(signal.SIG_BLOCK, STATUS)
    with ending.lock:
        os._exit(ending.status() if ending.said else status)
