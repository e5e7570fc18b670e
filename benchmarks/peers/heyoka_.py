"""heyoka: Taylor series of adaptive order and step, compiled by LLVM for this problem.

n = 1 is solved in the plane (x, y and their rates), other n in the modal form with the angular momentum as a state.

Tried, and the best kept: `fast_math` on (n = 1 a quarter less time, n = 3 a tenth, same error), `high_accuracy` off (0 to
a fifth less), `compact_mode` off (a fifth to a half less); `force_avx512` and batch 16 instead of the recommended 8 gain
nothing, batch 4 takes a third to a half more.  For n = 1 k / sqrt(x^2 + y^2), (x^2 + y^2)^-0.5 and polar coordinates with
the angular momentum take the same time within the noise; for n = 3 states cos psi and sin psi instead of psi take up to
a sixth more for up to a fifth of the error, which a tolerance a tenth as large gives for the same time.  Tolerances
above 1e-7 save little or nothing.  heyoka's own ensemble copies the integrator for each batch, which for so short a run
(a batch takes 1 ms) costs as much as the run itself; so two cores are best used by `batch` with a thread and a solver
of its own for each.

    python -m benchmarks.peers.heyoka_
"""

import concurrent.futures
import copy
import time

import numpy as np

from .common import Missing, Peer, table
from .problem import Problem, polar

try:
    import heyoka
except ImportError:
    heyoka = None

WAYS = ("scalar", "batch", "ensemble")


def _need() -> None:
    if heyoka is None:
        raise Missing("heyoka is not installed: pip install heyoka")


def equations(problem: Problem) -> list:
    """The right-hand sides."""
    if problem.n == 1:
        k, gamma, _ = problem.flat()
        x, y, u, v = heyoka.make_vars("x", "y", "u", "v")
        c = k * (x * x + y * y) ** -0.5 - k
        return [(x, u), (y, v), (u, c * x), (v, c * y - gamma)]
    m, n, g = problem.modal(), problem.n, problem.gravity
    psi, momentum, *rest = heyoka.make_vars("psi", "l", *(f"e{i}" for i in range(n)), *(f"d{i}" for i in range(n)))
    eta, rates = rest[:n], rest[n:]
    arms = [eta[i] + m.b[i] for i in range(n)]
    omega = momentum / (m.rest + heyoka.sum([arm**2.0 for arm in arms]))
    square, sine = omega * omega, heyoka.sin(psi)
    torque = m.p0 + heyoka.sum([m.P[i] * eta[i] for i in range(n)])
    return [
        (psi, omega),
        (momentum, -g * heyoka.cos(psi) * torque),
        *((eta[i], rates[i]) for i in range(n)),
        *((rates[i], square * arms[i] - m.squares[i] * eta[i] - g * m.P[i] * sine) for i in range(n)),
    ]


def start(problem: Problem) -> np.ndarray:
    """States at the start, (states, lanes)."""
    if problem.n == 1:
        out = np.zeros((4, problem.lanes))
        out[0], out[3] = 1.0, problem.rates
    else:
        out = np.zeros((2 + 2 * problem.n, problem.lanes))
        out[1] = problem.rates * problem.modal().inertia
    return out


def tips(problem: Problem, states: np.ndarray) -> np.ndarray:
    """Tips from the states at the end, (states, lanes)."""
    if problem.n == 1:
        return np.float64(problem.flat().length * states[:2].T)
    return polar(problem, states[0], states[2 : 2 + problem.n].T)


def extended(problem: Problem) -> np.ndarray:
    """The reference: long double where it is longer than double, else double at its best."""
    _need()
    long = np.longdouble if np.finfo(np.longdouble).eps < 1e-18 else np.float64
    states, end = start(problem).astype(long), long(problem.duration)
    options = {"tol": long(max(np.finfo(long).eps, 1e-19)), "high_accuracy": True, "fp_type": long}
    solver = heyoka.taylor_adaptive(equations(problem), list(states[:, 0]), **options)
    for lane in range(problem.lanes):
        solver.time = long(0.0)
        solver.state[:] = states[:, lane]
        solver.propagate_until(end)
        states[:, lane] = solver.state
    return tips(problem, states)


class Heyoka:
    """`scalar`: one lane after the other; `batch`: SIMD batches, shared out to threads; `ensemble`: heyoka's threads."""

    settings = (1e-3, 1e-5, 1e-7, 1e-9, 1e-11, 1e-13, 1e-15)

    def __init__(self, way: str = "batch", cores: int = 1):
        _need()
        if way not in WAYS:
            raise ValueError(f"way={way!r} must be one of {WAYS}.")
        if way == "scalar" and cores != 1:
            raise ValueError("way='scalar' runs on one core; 'batch' and 'ensemble' take more.")
        self.name, self.way, self.cores = f"heyoka, {way}", way, cores

    def compile(self, problem: Problem) -> float:
        self.problem, self.solvers = problem, {}
        # A last batch that is not full runs some lanes twice.
        width = heyoka.recommended_simd_size()
        self.batches = np.resize(np.arange(problem.lanes), (-(-problem.lanes // width), width))
        begin = time.perf_counter()
        self.solvers[1e-11] = self._solvers(1e-11)
        return time.perf_counter() - begin

    def _solvers(self, tolerance: float) -> list:
        """A solver for each thread."""
        states, options = start(self.problem), {"tol": tolerance, "fast_math": True}
        if self.way == "scalar":
            return [heyoka.taylor_adaptive(equations(self.problem), list(states[:, 0]), **options)]
        solver = heyoka.taylor_adaptive_batch(equations(self.problem), states[:, self.batches[0]], **options)
        copies = self.cores - 1 if self.way == "batch" else 0
        return [solver, *(copy.deepcopy(solver) for _ in range(copies))]

    def run(self, setting):
        if setting not in self.solvers:
            self.solvers[setting] = self._solvers(setting)
        solvers, end, states = self.solvers[setting], self.problem.duration, start(self.problem)
        out = np.full_like(states, np.nan)

        def batches(solver, some):
            for lanes in some:
                solver.set_time(0.0)
                solver.state[:] = states[:, lanes]
                solver.propagate_until(end)
                out[:, lanes] = solver.state

        def place(solver, index):
            solver.set_time(0.0)
            solver.state[:] = states[:, self.batches[index]]
            return solver

        heyoka.set_nthreads(self.cores)
        begin = time.perf_counter()
        if self.way == "scalar":
            for lane in range(self.problem.lanes):
                solvers[0].time = 0.0
                solvers[0].state[:] = states[:, lane]
                solvers[0].propagate_until(end)
                out[:, lane] = solvers[0].state
        elif self.way == "ensemble":
            done = heyoka.ensemble_propagate_until_batch(solvers[0], end, len(self.batches), place)
            for lanes, result in zip(self.batches, done, strict=True):
                out[:, lanes] = result[0].state
        elif self.cores == 1:
            batches(solvers[0], self.batches)
        else:
            with concurrent.futures.ThreadPoolExecutor(self.cores) as pool:
                list(pool.map(batches, solvers, np.array_split(self.batches, self.cores)))
        seconds = time.perf_counter() - begin
        heyoka.set_nthreads(0)
        return tips(self.problem, out), seconds


def peers() -> list[Peer]:
    """All ways, on one core and two."""
    return [Heyoka("scalar"), *(Heyoka(way, cores) for way in ("batch", "ensemble") for cores in (1, 2))]


if __name__ == "__main__":
    table([lambda i=i: peers()[i] for i in range(5)])
