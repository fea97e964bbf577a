"""The command line ``skysink`` of this package, and the processes that it starts."""

from __future__ import annotations

import signal
import sys

from skysink._skysink import run_program


def run(name: str, arguments: list[str]) -> int:
    """Runs a program by its name; the first argument is what it was called by."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)  # the program has handlers of its own
    return run_program(name, arguments, [sys.executable, "-P", "-m", "skysink.programs"])


def main() -> int:
    """The command line."""
    return run("skysink", ["skysink", *sys.argv[1:]])


if __name__ == "__main__":
    sys.exit(run(sys.argv[1], sys.argv[1:]))
