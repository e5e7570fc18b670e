"""Plain Diffrax, without the library's `simulate`: many lanes by `jax.vmap`, at once or in blocks.

`naive` is what one writes first: the Lagrangian in the angle and the amplitudes, its equations by automatic
differentiation, `jnp.linalg.solve` of the mass matrix at each evaluation.  `best` is the hand-written form: the plane
for n = 1, the modal form with the angular momentum and the director as states for other n, and the forward loop.

On two cores each takes half of the lanes in a thread of its own; XLA itself keeps these small arrays on one.

    python -m benchmarks.peers.diffrax_
"""

import concurrent.futures
import time

import numpy as np

from .common import Missing, Peer, table
from .problem import Problem

try:
    import diffrax
    import jax
    import jax.numpy as jnp
except ImportError:
    diffrax = None

FORMS = ("naive", "best")
BLOCK = 64


def naive(problem: Problem):
    """Vector field of (psi, a) and their rates, the start for a rate, and the tip of a state."""
    mass, stiffness, moments, tip = (
        jnp.asarray(x) for x in (problem.mass, problem.stiffness, problem.moments, problem.tip)
    )
    n = problem.n

    def lagrangian(q, dq):
        z = jnp.concatenate([jnp.ones(1), q[1:]])
        kinetic = (dq[1:] @ mass[1:, 1:] @ dq[1:] + z @ mass @ z * dq[0] ** 2) / 2
        return kinetic - q[1:] @ stiffness @ q[1:] / 2 - problem.gravity * jnp.sin(q[0]) * (moments @ z)

    def field(t, state, args):
        q, dq = state
        force = jax.grad(lagrangian, 0)(q, dq) - jax.jvp(lambda q: jax.grad(lagrangian, 1)(q, dq), (q,), (dq,))[1]
        return dq, jnp.linalg.solve(jax.hessian(lagrangian, 1)(q, dq), force)

    def start(rate):
        return jnp.zeros(n + 1), jnp.zeros(n + 1).at[0].set(rate)

    def end(state):
        q = state[0]
        return (tip[0] + tip[1:] @ q[1:]) * jnp.stack([jnp.cos(q[0]), jnp.sin(q[0])])

    return field, start, end


def planar(problem: Problem):
    """The same for n = 1 in the plane."""
    k, gamma, length = problem.flat()

    def field(t, state, args):
        x, y, u, v = state
        c = k * jax.lax.rsqrt(x * x + y * y) - k
        return u, v, c * x, c * y - gamma

    def start(rate):
        return jnp.ones_like(rate), jnp.zeros_like(rate), jnp.zeros_like(rate), rate

    return field, start, lambda state: length * jnp.stack(state[:2])


def modal(problem: Problem):
    """The same for any n in the modal form, in single numbers: XLA is slow on axes of length n.

    The director (c, s) is two states instead of the angle, c' = -s psi', s' = c psi', which saves XLA's sin and cos, two
    fifths of the time.
    """
    m, n, g = problem.modal(), problem.n, problem.gravity
    squares, b, P, tips = (x.tolist() for x in (m.squares, m.b, m.P, m.tips))

    def field(t, state, args):
        c, s, momentum, eta, rates = state
        arms = [e + b[i] for i, e in enumerate(eta)]
        omega = momentum / (m.rest + sum(arm * arm for arm in arms))
        square = omega * omega
        torque = g * c * (m.p0 + sum(P[i] * e for i, e in enumerate(eta)))
        pull = tuple(square * arms[i] - squares[i] * eta[i] - g * P[i] * s for i in range(n))
        return -omega * s, omega * c, -torque, rates, pull

    def start(rate):
        zero = jnp.zeros_like(rate)
        return jnp.ones_like(rate), zero, rate * m.inertia, (zero,) * n, (zero,) * n

    def end(state):
        c, s, _, eta, _ = state
        return (m.reach + sum(tips[i] * e for i, e in enumerate(eta))) * jnp.stack([c, s])

    return field, start, end


class Diffrax:
    """A form and a solver; the setting is the tolerance, relative and absolute.  `blocks`: 64 lanes at a time."""

    def __init__(self, form: str = "best", solver: str = "Dopri8", cores: int = 1, *, blocks: bool = False):
        if diffrax is None:
            raise Missing("Diffrax is not installed: pip install diffrax")
        if form not in FORMS:
            raise ValueError(f"form={form!r} must be one of {FORMS}.")
        self.form, self.solver, self.cores, self.blocks = form, solver, cores, blocks
        self.name = f"Diffrax, {form}, {solver}" + (", blocks" if blocks else "")
        self.settings = (1e-5, 1e-7, 1e-9, 1e-11) if solver == "Tsit5" else (1e-5, 1e-7, 1e-9, 1e-11, 1e-13)

    def compile(self, problem: Problem) -> float:
        self.problem = problem
        best = planar if problem.n == 1 else modal
        field, start, end = (naive if self.form == "naive" else best)(problem)
        term, solver = diffrax.ODETerm(field), getattr(diffrax, self.solver)()
        options = {"adjoint": diffrax.ForwardMode()} if self.form == "best" else {}

        def one(rate, tolerance):
            control = diffrax.PIDController(rtol=tolerance, atol=tolerance)
            run = diffrax.diffeqsolve(
                term,
                solver,
                0.0,
                problem.duration,
                None,
                start(rate),
                saveat=diffrax.SaveAt(t1=True),
                stepsize_controller=control,
                max_steps=None,
                throw=False,
                **options,
            )
            return end(jax.tree.map(lambda x: x[-1], run.ys))

        def many(rates, tolerance):
            if self.blocks:
                return jax.lax.map(lambda rate: one(rate, tolerance), rates, batch_size=BLOCK)
            return jax.vmap(one, (0, None))(rates, tolerance)

        self.parts = [jnp.asarray(part) for part in np.array_split(problem.rates, self.cores) if len(part)]
        begin = time.perf_counter()
        compiled = {
            part.shape: jax.jit(many).lower(part, jnp.asarray(1e-5, part.dtype)).compile() for part in self.parts
        }
        self.functions = [compiled[part.shape] for part in self.parts]
        return time.perf_counter() - begin

    def run(self, setting):
        tolerance = jnp.asarray(setting, self.parts[0].dtype)

        def part(function, rates):
            return np.asarray(function(rates, tolerance), np.float64)

        begin = time.perf_counter()
        if len(self.parts) == 1:
            tips = [part(self.functions[0], self.parts[0])]
        else:
            with concurrent.futures.ThreadPoolExecutor(len(self.parts)) as pool:
                tips = list(pool.map(part, self.functions, self.parts))
        seconds = time.perf_counter() - begin
        return np.concatenate(tips), seconds


def peers() -> list[Peer]:
    """Naive and best on one core, best on two."""
    return [
        Diffrax("naive", "Tsit5"),
        Diffrax("naive", "Dopri8"),
        Diffrax("best", "Dopri8"),
        Diffrax("best", "Dopri8", blocks=True),
        Diffrax("best", "Dopri8", 2, blocks=True),
    ]


if __name__ == "__main__":
    table([lambda i=i: peers()[i] for i in range(5)], repeats=1)
