"""The command, as ``thermocorr`` and ``python -m thermocorr`` begin it."""

import sys


def start() -> int:
    """Run the command; an interrupt while its first modules load ends it in one line too."""
    try:
        from .command.cli import main

        return main()
    except KeyboardInterrupt:
        print("thermocorr: stopped", file=sys.stderr)
        return 130


if __name__ == "__main__":
    sys.exit(start())
