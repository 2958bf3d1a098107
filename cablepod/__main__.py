"""``python -m cablepod`` and the command ``cablepod``: a process that ends on a signal with one line, at every instant."""

import _signal  # type: ignore[import-not-found]  # built in; the module signal takes milliseconds to import
import gc
import os
import sys


def main() -> None:
    """Run the command with the arguments of the process, and end the process."""
    if hasattr(_signal, "pthread_sigmask"):  # until the handlers are there
        _signal.pthread_sigmask(_signal.SIG_BLOCK, {_signal.SIGINT, _signal.SIGTERM})
    gc.set_threshold(50_000)  # the imports leave no garbage, but many objects to search
    try:
        from cablepod.cli import _process, main
    except KeyboardInterrupt:
        os.write(2, b"cablepod: interrupted\n")
        os._exit(130)
    _process.run(main, sys.argv[1:])


if __name__ == "__main__":
    main()
