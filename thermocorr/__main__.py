"""The command's entry point."""

import os
import sys


def start() -> int:
    """Run the command, interrupts included.

    OpenBLAS is kept to one thread unless the environment says otherwise: matrices are small, and a tenth of the
    processor time was threads that waited for work.
    """
    if "OMP_NUM_THREADS" not in os.environ:
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    try:
        from .command.cli import main

        return main()
    except KeyboardInterrupt:
        print("thermocorr: stopped", file=sys.stderr)
        return 130


if __name__ == "__main__":
    sys.exit(start())
