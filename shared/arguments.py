"""Command-line arguments of every program: argparse, but bad usage is one line on stderr and exit code 2."""

import argparse
import sys
from typing import Final, NoReturn

EXIT_BAD_INPUT: Final = 2


class OneLineParser(argparse.ArgumentParser):
    """A parser that reports in one line what is wrong, and where help is."""

    def error(self, message: str) -> NoReturn:
        """Refuse the arguments."""
        print(f"{self.prog}: {message} (see {self.prog} --help)", file=sys.stderr)  # noqa: T201 - for the terminal
        sys.exit(EXIT_BAD_INPUT)
