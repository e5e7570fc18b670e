"""CasADi: CVODES, one lane after the other or on threads.

n = 1 is solved in the plane, other n in the modal form with the angular momentum as a state.  A few lanes are run and
the time is scaled up to all; the others are NaN.

Tried, and the best kept: the Adams methods with Newton's iteration take a quarter to two thirds of the time of BDF and
two thirds of that of functional iteration; compiling the right-hand side (`jit`) saves nothing.

    python -m benchmarks.peers.casadi_
"""

import time

import numpy as np

from .common import Missing, Peer, sample, table
from .heyoka_ import start, tips
from .problem import Problem

try:
    import casadi
except ImportError:
    casadi = None


def right_hand_side(problem: Problem):
    """State and its derivative, in the order of the heyoka module's states."""
    if problem.n == 1:
        k, gamma, _ = problem.flat()
        state = casadi.SX.sym("state", 4)
        c = k / casadi.sqrt(state[0] ** 2 + state[1] ** 2) - k
        return state, casadi.vertcat(state[2], state[3], c * state[0], c * state[1] - gamma)
    m, n, g = problem.modal(), problem.n, problem.gravity
    state = casadi.SX.sym("state", 2 + 2 * n)
    psi, momentum, eta, rates = state[0], state[1], state[2 : 2 + n], state[2 + n :]
    arms = eta + m.b
    omega = momentum / (m.rest + casadi.sumsqr(arms))
    torque = g * casadi.cos(psi) * (m.p0 + casadi.dot(m.P, eta))
    pull = omega**2 * arms - m.squares * eta - g * m.P * casadi.sin(psi)
    return state, casadi.vertcat(omega, -torque, rates, pull)


class CasADi:
    """CVODES with one tolerance for both kinds of error, on `most` lanes."""

    name = "CasADi, CVODES (Adams)"
    settings = (1e-6, 1e-8, 1e-10, 1e-12, 1e-14)

    def __init__(self, cores: int = 1, most: int = 4):
        if casadi is None:
            raise Missing("CasADi is not installed: pip install casadi")
        self.cores, self.most = cores, most

    def compile(self, problem: Problem) -> float:
        self.problem, self.chosen, self.solvers = problem, sample(problem.lanes, self.most), {}
        begin = time.perf_counter()
        self.solvers[1e-8] = self._solver(1e-8)
        return time.perf_counter() - begin

    def _solver(self, tolerance: float):
        state, derivative = right_hand_side(self.problem)
        options = {"abstol": tolerance, "reltol": tolerance, "max_num_steps": 10**8}
        options["linear_multistep_method"] = "adams"
        ode = {"x": state, "ode": derivative}
        one = casadi.integrator("end", "cvodes", ode, 0.0, self.problem.duration, options)
        lanes = len(self.chosen)
        return one.map(lanes) if self.cores == 1 else one.map(lanes, "thread", self.cores)

    def run(self, setting):
        if setting not in self.solvers:
            self.solvers[setting] = self._solver(setting)
        solver, part = self.solvers[setting], self.problem.at(self.chosen)
        states, out = start(part), np.full((self.problem.lanes, 2), np.nan)
        begin = time.perf_counter()
        end = solver(x0=states)["xf"]
        seconds = time.perf_counter() - begin
        out[self.chosen] = tips(part, np.array(end))
        return out, seconds * self.problem.lanes / part.lanes


def peers() -> list[Peer]:
    return [CasADi(1), CasADi(2)]


if __name__ == "__main__":
    table([lambda: CasADi(1), lambda: CasADi(2)], repeats=1)
