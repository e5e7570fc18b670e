"""Checks the reference against a second, independent solver and the known digits.

python -m benchmarks.peers
"""

import jaxrod

jaxrod.configure(cache=None)

import numpy as np  # noqa: E402

from .problem import KNOWN, Problem, reference  # noqa: E402
from .scipy_ import dop853  # noqa: E402


def main() -> None:
    for n in (1, 3):
        problem = Problem.figure_2(n, [14.0, KNOWN[0], 16.0], KNOWN[1])
        tips = reference(problem)
        off = np.max(np.abs(tips - dop853(problem)))
        print(f"n = {n}: reference against DOP853: {off:.1e} m")
        if n == 1:
            known = (1 + KNOWN[3]) * np.array([np.cos(KNOWN[2]), np.sin(KNOWN[2])])
            print(f"n = {n}: reference against the known digits: {np.max(np.abs(tips[1] - known)):.1e} m")
        if not off < 1e-10:
            raise SystemExit(f"n = {n}: the two solvers differ by {off:.1e} m")


if __name__ == "__main__":
    main()
