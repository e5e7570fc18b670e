"""The command line: `jaxrod` or `python -m jaxrod`."""

import argparse
import pathlib
import runpy
import sys
from collections.abc import Sequence
from typing import Any

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
    paper.set_defaults(run=_paper)
    trade = commands.add_parser(
        "tradeoff",
        help="measure what accuracy costs on a scene",
        description="Runs a scene with rigid, quasi-static and elastic rungs, several solvers, steps and float types; "
        "prints those that no other beats, with their error and cost on this machine, and saves all of them as a picture.",
    )
    trade.add_argument(
        "scene",
        help="a name (a wrong one shows all of them), or FILE.py:FUNCTION for a scene of your own: what that function, called "
        "without arguments, returns, a jaxrod.scenes.Scene(title, system, start, t1, quantity)",
    )
    trade.add_argument("--seconds", type=float, default=60.0, help="stop after so much time (default: 60)")
    trade.add_argument("--out", type=pathlib.Path, default=pathlib.Path("tradeoff"), help="folder (default: tradeoff)")
    trade.set_defaults(run=_tradeoff)
    arguments = parser.parse_args(argv)
    if arguments.out.exists() and not arguments.out.is_dir():
        parser.error(f"--out {arguments.out} is a file; give a folder")
    if not getattr(arguments, "seconds", 1.0) > 0:
        parser.error(f"--seconds {arguments.seconds:g} is no time to measure in; give a positive number")
    print(jaxrod.configure(), file=sys.stderr)
    return arguments.run(arguments)


def _paper(arguments) -> int:
    print(jaxrod.claims.report(arguments.out))
    print(f"\nsaved to {arguments.out}: {', '.join(sorted(path.name for path in arguments.out.iterdir()))}")
    return 0


def _tradeoff(arguments) -> int:
    # Looked at only now: scenes load JAX and Equinox, which `configure` must come before.
    path, _, function = arguments.scene.rpartition(":")
    if path.endswith(".py"):
        scene, name = _own(pathlib.Path(path), function), function
    else:
        scene, name = jaxrod.scenes.NAMED.get(arguments.scene, lambda: None)(), arguments.scene
    if scene is None:
        names = ", ".join(jaxrod.scenes.NAMED)
        print(f"no scene {arguments.scene!r}; choose from {names}, or give FILE.py:FUNCTION", file=sys.stderr)
        return 2
    found = jaxrod.tradeoff(
        scene.system, scene.start, t1=scene.t1, quantity=scene.quantity, static=scene.static, seconds=arguments.seconds
    )
    arguments.out.mkdir(parents=True, exist_ok=True)
    picture = arguments.out / f"{name}.png"
    jaxrod.plot.tradeoff(found, scene.title).savefig(picture, dpi=130)
    print(f"{scene.title}\n{found}\nsaved to {picture}")
    return 0


def _own(path: pathlib.Path, function: str) -> Any:
    """The scene that a function in a user's file returns, or None."""
    make = runpy.run_path(str(path)).get(function) if path.is_file() else None
    scene = make() if callable(make) else None
    return scene if isinstance(scene, jaxrod.scenes.Scene) else None


if __name__ == "__main__":
    sys.exit(main())
