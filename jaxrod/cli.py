"""The command line: `jaxrod` or `python -m jaxrod`."""

import argparse
import pathlib
import sys
from collections.abc import Sequence

import jaxrod


def main(argv: Sequence[str] | None = None) -> int:
    """Runs one command and returns the exit code."""
    parser = argparse.ArgumentParser(
        prog="jaxrod", description="Thin rods that stretch while they swing, spin and fly."
    )
    parser.add_argument("--version", action="version", version=f"jaxrod {jaxrod.__version__}")
    commands = parser.add_subparsers(dest="command", required=True)
    paper = commands.add_parser(
        "paper",
        help="reproduce and correct the paper this library starts from",
        description="Reproduces and corrects Vikhrenko, Lasovsky, Tishevich (2013): prints each claim with what was "
        "measured, the slips with their corrections and what the model leaves out; saves Figure 2 and the release from "
        "stretch as pictures, Figure 2 also as CSV.",
    )
    paper.add_argument(
        "--out", type=pathlib.Path, default=pathlib.Path("paper"), help="folder to write (default: paper)"
    )
    arguments = parser.parse_args(argv)
    if arguments.out.exists() and not arguments.out.is_dir():
        parser.error(f"--out {arguments.out} is a file; give a folder")
    print(jaxrod.configure(), file=sys.stderr)
    print(jaxrod.claims.report(arguments.out))
    print(f"\nsaved to {arguments.out}: {', '.join(sorted(path.name for path in arguments.out.iterdir()))}")
    return 0
