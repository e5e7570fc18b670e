"""SciPy: LSODA and DOP853, one lane after the other, right-hand sides in Python numbers.

n = 1 is solved in the plane, other n in the modal form with the angular momentum as a state.  A few lanes are run and
the time is scaled up to all; the others are NaN.

Besides `solve_ivp`, whose loop over steps is Python, the same methods with the loop compiled: `odeint` (LSODA) and
`ode("dop853")`; these are SciPy at its best.

    python -m benchmarks.peers.scipy_
"""

import math
import time

import numpy as np

from .common import Missing, sample, table
from .problem import Problem, polar

try:
    import scipy.integrate
except ImportError:
    scipy = None

WAYS = ("solve_ivp DOP853", "solve_ivp LSODA", "ode dop853", "odeint LSODA")


def right_hand_side(problem: Problem):
    """f(t, state) -> list of numbers; NumPy's overhead on so few numbers costs more than the loop."""
    if problem.n == 1:
        k, gamma, _ = problem.flat()

        def planar(t, state):
            x, y, u, v = state.tolist()
            c = k / math.sqrt(x * x + y * y) - k
            return [u, v, c * x, c * y - gamma]

        return planar
    m, n, g = problem.modal(), problem.n, problem.gravity
    squares, b, P = m.squares.tolist(), m.b.tolist(), m.P.tolist()

    def modal(t, state):
        psi, momentum, *rest = state.tolist()
        eta, rates = rest[:n], rest[n:]
        arms = [e + b[i] for i, e in enumerate(eta)]
        omega = momentum / (m.rest + sum(arm * arm for arm in arms))
        square, pull = omega * omega, g * math.sin(psi)
        torque = m.p0 + sum(P[i] * e for i, e in enumerate(eta))
        return [
            omega,
            -g * math.cos(psi) * torque,
            *rates,
            *(square * arms[i] - squares[i] * eta[i] - pull * P[i] for i in range(n)),
        ]

    return modal


def start(problem: Problem, rate: float) -> np.ndarray:
    """State at the start."""
    if problem.n == 1:
        return np.array([1.0, 0.0, 0.0, rate])
    return np.array([0.0, rate * problem.modal().inertia] + [0.0] * (2 * problem.n))


def end(problem: Problem, way: str, tolerance: float, rate: float) -> np.ndarray:
    """State at the end."""
    f, state, time_end = right_hand_side(problem), start(problem, rate), problem.duration
    if way.startswith("solve_ivp"):
        method = way.split()[1]
        run = scipy.integrate.solve_ivp(f, (0.0, time_end), state, method=method, rtol=tolerance, atol=tolerance)
        return run.y[:, -1]
    if way == "ode dop853":
        run = scipy.integrate.ode(f).set_integrator("dop853", rtol=tolerance, atol=tolerance, nsteps=10**8)
        return run.set_initial_value(state).integrate(time_end)
    options = {"tfirst": True, "rtol": tolerance, "atol": tolerance, "mxstep": 10**8}
    return scipy.integrate.odeint(f, state, [0.0, time_end], **options)[-1]


def tips(problem: Problem, states: np.ndarray) -> np.ndarray:
    """Tips from states (lanes, states)."""
    if problem.n == 1:
        return problem.flat().length * states[:, :2]
    return polar(problem, states[:, 0], states[:, 2 : 2 + problem.n])


def dop853(problem: Problem, tolerance: float = 1e-13) -> np.ndarray:
    """Tips by DOP853 at a tight tolerance."""
    SciPy("ode dop853")
    return tips(problem, np.stack([end(problem, "ode dop853", tolerance, rate) for rate in problem.rates]))


class SciPy:
    """One of `WAYS`, on `most` lanes."""

    cores = 1

    def __init__(self, way: str = "ode dop853", most: int = 3):
        if scipy is None:
            raise Missing("SciPy is not installed: pip install scipy")
        if way not in WAYS:
            raise ValueError(f"way={way!r} must be one of {WAYS}.")
        self.name, self.way, self.most = f"SciPy, {way}", way, most
        fine = (1e-11, 1e-13) if "dop853" in way.lower() else (1e-11, 1e-12)
        self.settings = (1e-5, 1e-7, 1e-9, *fine)

    def compile(self, problem: Problem) -> float:
        self.problem = problem
        return 0.0

    def run(self, setting):
        chosen, out = sample(self.problem.lanes, self.most), np.full((self.problem.lanes, 2), np.nan)
        begin = time.perf_counter()
        states = [end(self.problem, self.way, setting, rate) for rate in self.problem.rates[chosen]]
        seconds = time.perf_counter() - begin
        out[chosen] = tips(self.problem, np.stack(states))
        return out, seconds * self.problem.lanes / len(chosen)


if __name__ == "__main__":
    table([lambda way=way: SciPy(way) for way in WAYS], repeats=1)
