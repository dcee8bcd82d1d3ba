"""The program: `pardalis` in a terminal, or `python -m pardalis`."""

import signal
import sys

from . import _pardalis


def main() -> None:
    # Commands that take long have their own handler; Python's would wait until they end.
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    sys.exit(_pardalis.run_program(sys.argv[1:], _pardalis.__file__))


if __name__ == "__main__":
    main()
