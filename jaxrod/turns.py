"""A Diffrax solver that counts full turns, for coordinates that do not know them."""

from typing import Any

import diffrax
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float


class CountTurns(diffrax.AbstractAdaptiveSolver, diffrax.AbstractWrappedSolver):
    """Steps `solver` and counts how often the angle of the first two coordinates passes +-pi.

    The state is (phase, turns), the terms (those of `solver`, an idle one).  Right as long as one step turns the rod by
    less than half a turn; between the ends of a step the count follows the interpolated coordinates.
    """

    solver: diffrax.AbstractSolver

    @property
    def term_structure(self) -> Any:
        return (self.solver.term_structure, diffrax.AbstractTerm)

    @property
    def term_compatible_contr_kwargs(self) -> Any:
        return (self.solver.term_compatible_contr_kwargs, {})

    @property
    def interpolation_cls(self) -> Any:
        return jax.tree_util.Partial(_TurnInterpolation, self.solver.interpolation_cls)

    # Diffrax sets these two on the solver itself, by the adjoint and by the step size control.

    @property
    def scan_kind(self) -> Any:
        return self.solver.scan_kind

    @property
    def root_finder(self) -> Any:
        return self.solver.root_finder

    def order(self, terms):
        return self.solver.order(terms[0])

    def error_order(self, terms):
        return self.solver.error_order(terms[0])

    def init(self, terms, t0, t1, y0, args):
        return self.solver.init(terms[0], t0, t1, y0[0], args)

    def step(self, terms, t0, t1, y0, args, solver_state, made_jump):
        phase0, turns0 = y0
        phase1, error, dense, solver_state, result = self.solver.step(
            terms[0], t0, t1, phase0, args, solver_state, made_jump
        )
        turns1 = turns0 + _passed(phase0.q, phase1.q)
        error = None if error is None else (error, jnp.zeros_like(turns0))
        return (phase1, turns1), error, dict(phase=dense, q0=phase0.q, turns0=turns0), solver_state, result

    def func(self, terms, t0, y0, args):
        return self.solver.func(terms[0], t0, y0[0], args), jnp.zeros_like(y0[1])


class _TurnInterpolation(diffrax.AbstractLocalInterpolation):
    phase: diffrax.AbstractLocalInterpolation
    q0: Float[Array, " N"]
    turns0: Float[Array, ""]
    t0: Float[Array, ""]
    t1: Float[Array, ""]

    def __init__(self, interpolation_cls, *, t0, t1, phase, q0, turns0):
        self.phase = interpolation_cls(t0=t0, t1=t1, **phase)
        self.t0, self.t1, self.q0, self.turns0 = t0, t1, q0, turns0

    def evaluate(self, t0, t1=None, left=True):
        if t1 is not None:
            return jax.tree.map(lambda b, a: b - a, self.evaluate(t1), self.evaluate(t0))
        phase = self.phase.evaluate(t0, left=left)
        return phase, self.turns0 + _passed(self.q0, phase.q)


def _passed(before: Float[Array, " N"], after: Float[Array, " N"]) -> Float[Array, ""]:
    """How often (+1, 0, -1) the angle passes +-pi between two positions less than half a turn apart."""
    swept = jnp.arctan2(after[1], after[0]) - jnp.arctan2(before[1], before[0])
    return jax.lax.stop_gradient(-jnp.round(swept / (2 * jnp.pi)))
