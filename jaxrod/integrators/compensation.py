"""A Diffrax solver that carries along what the coordinates alone would lose: full turns, and digits of float32."""

from typing import Any, NamedTuple

import diffrax
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float


class Tracked(NamedTuple):
    """A phase; what rounding cut off it; full turns made.  None stands for what is not tracked."""

    phase: Any  # a pytree with coordinates q
    remainder: Any  # likewise, or None
    turns: Any  # scalar or None


class Tracking(diffrax.AbstractAdaptiveSolver, diffrax.AbstractWrappedSolver):
    """Steps `solver` from one `Tracked` to the next.

    **Turns**: counts how often the angle of the first two coordinates passes +-pi.  Right as long as one step turns the
    rod by less than half a turn; inside a step the count follows the interpolated coordinates.

    **Remainder**: `solver` computes the increment of a step, which is added to the phase with compensation (Kahan
    1965).  Rounding then no longer piles up over thousands of steps.
    """

    solver: Any  # AbstractSolver

    @property
    def term_structure(self) -> Any:
        return Tracked(self.solver.term_structure, diffrax.AbstractTerm, diffrax.AbstractTerm)

    @property
    def term_compatible_contr_kwargs(self) -> Any:
        return Tracked(self.solver.term_compatible_contr_kwargs, {}, {})

    @property
    def interpolation_cls(self) -> Any:
        return jax.tree_util.Partial(_Interpolation, self.solver.interpolation_cls)

    # Diffrax sets these two on the solver itself, by the adjoint and by the step size control.

    @property
    def scan_kind(self) -> Any:
        return self.solver.scan_kind

    @property
    def root_finder(self) -> Any:
        return self.solver.root_finder

    def order(self, terms):
        return self.solver.order(terms.phase)

    def error_order(self, terms):
        return self.solver.error_order(terms.phase)

    def init(self, terms, t0, t1, y0, args):
        return self.solver.init(terms.phase, t0, t1, y0.phase, args)

    def step(self, terms, t0, t1, y0, args, solver_state, made_jump):
        base = None if y0.remainder is None else y0.phase
        term = (
            terms.phase
            if base is None
            else jax.tree.map(lambda term: _Shifted(term, base), terms.phase, is_leaf=_is_term)
        )
        start = y0.phase if base is None else y0.remainder
        phase, error, dense, solver_state, result = self.solver.step(term, t0, t1, start, args, solver_state, made_jump)
        remainder = None
        if base is not None:
            increment = phase
            phase = jax.tree.map(jnp.add, base, increment)
            remainder = jax.tree.map(_cut_off, base, increment, phase)
        turns = None if y0.turns is None else y0.turns + passed(y0.phase.q, phase.q)
        y1 = Tracked(phase, remainder, turns)
        idle = jax.tree.map(jnp.zeros_like, y0)
        error = None if error is None else Tracked(error, idle.remainder, idle.turns)
        return y1, error, {"inner": dense, "y0": y0}, solver_state, result

    def func(self, terms, t0, y0, args):
        idle = jax.tree.map(jnp.zeros_like, y0)
        return Tracked(self.solver.func(terms.phase, t0, y0.phase, args), idle.remainder, idle.turns)


class _Interpolation(diffrax.AbstractLocalInterpolation):
    inner: diffrax.AbstractLocalInterpolation
    y0: Tracked
    t0: Any
    t1: Any

    def __init__(self, interpolation_cls, *, t0, t1, inner, y0):
        self.inner = interpolation_cls(t0=t0, t1=t1, **inner)
        self.t0, self.t1, self.y0 = t0, t1, y0

    def evaluate(self, t0, t1=None, left=True):
        if t1 is not None:
            return jax.tree.map(lambda b, a: b - a, self.evaluate(t1), self.evaluate(t0))
        phase = self.inner.evaluate(t0, left=left)
        if self.y0.remainder is not None:
            phase = jax.tree.map(jnp.add, self.y0.phase, phase)
        turns = None if self.y0.turns is None else self.y0.turns + passed(self.y0.phase.q, phase.q)
        return Tracked(phase, jax.tree.map(jnp.zeros_like, self.y0.remainder), turns)


class _Shifted(diffrax.AbstractTerm):
    """A term for the increment over `base`."""

    term: diffrax.AbstractTerm
    base: Any

    def vf(self, t, y, args):
        return self.term.vf(t, jax.tree.map(jnp.add, self.base, y), args)

    def contr(self, t0, t1, **kwargs):
        return self.term.contr(t0, t1, **kwargs)

    def prod(self, vf, control):
        return self.term.prod(vf, control)


def _is_term(x: Any) -> bool:
    return isinstance(x, diffrax.AbstractTerm)


def _cut_off(a, b, total):
    """a + b - total without error (Knuth's two-sum)."""
    of_b = total - a
    return (a - (total - of_b)) + (b - of_b)


def passed(before: Any, after: Any) -> Float[Array, "*lanes"]:
    """How often (+1, 0, -1) the angle of the first two coordinates passes +-pi on the straight way between them."""
    x0, y0, x1, y1 = before[0], before[1], after[0], after[1]
    area = x0 * y1 - x1 * y0  # its sign tells on which side of the origin the way passes
    up, down = (y0 < 0) & (y1 >= 0) & (area < 0), (y0 >= 0) & (y1 < 0) & (area > 0)
    return jax.lax.stop_gradient(jnp.where(down, 1.0, jnp.where(up, -1.0, 0.0)).astype(jnp.result_type(x0)))
