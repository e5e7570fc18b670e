"""What all peers share: the interface, the reason for a missing one, and the table that each module prints."""

import argparse
from collections.abc import Callable, Iterable
from typing import Protocol

import numpy as np

from .problem import Problem, reference


class Missing(Exception):
    """Why a peer cannot take part."""


class Peer(Protocol):
    """One way to solve the problem: its name, its threads, and its settings from coarse to fine."""

    name: str
    cores: int
    settings: tuple

    def compile(self, problem: Problem) -> float:
        """Prepares for this problem; returns the seconds of what is done once."""
        ...

    def run(self, setting) -> tuple[np.ndarray, float]:
        """Tips at the end, (lanes, 2) in m, NaN for lanes left out, and seconds for all lanes."""
        ...


def sample(lanes: int, most: int) -> np.ndarray:
    """Which lanes a slow peer runs: at most `most`, evenly spread, with both ends."""
    return np.unique(np.linspace(0, lanes - 1, min(most, lanes)).round().astype(int))


def table(makers: Iterable[Callable[[], Peer]], ns=(1, 3), repeats: int = 2) -> None:
    """Prints error and microseconds per trajectory of each peer at each of its settings."""
    # Imported here, so that a peer without JAX does not wait for it where a caller has set JAX up already.
    import jaxrod

    jaxrod.configure(cache=None)
    parser = argparse.ArgumentParser(description="Error of the tip, m, and time per trajectory of 10 s.")
    parser.add_argument("--lanes", type=int, default=64, help="trajectories (default 64)")
    parser.add_argument("--n", type=int, nargs="*", default=ns, help="shapes of the rod (default all this peer has)")
    arguments = parser.parse_args()
    makers = list(makers)
    for n in arguments.n:
        problem = Problem.figure_2(n, np.linspace(14.0, 16.0, arguments.lanes))
        target = reference(problem)
        for make in makers:
            try:
                peer = make()
                once = peer.compile(problem)
            except Missing as reason:
                print(f"n = {n}: left out: {reason}")
                continue
            print(f"n = {n}: {peer.name}, cores {peer.cores}, once {once:.2f} s", flush=True)
            for setting in peer.settings:
                runs = [peer.run(setting) for _ in range(repeats)]
                error = np.nanmax(np.abs(runs[0][0] - target))
                micros = 1e6 * min(seconds for _, seconds in runs) / problem.lanes
                print(f"  {setting:8g}  error {error:.1e}  {micros:10.1f} us", flush=True)
