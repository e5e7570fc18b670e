"""When an event happens: a root finder for Diffrax that is judged by the time alone.  Knows no rods."""

from collections.abc import Callable
from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import optimistix as optx
from jaxtyping import Array, Bool, Float


class _Bracket(NamedTuple):
    lower: Float[Array, ""]
    upper: Float[Array, ""]
    rising: Bool[Array, ""]  # whether the condition is below zero at the lower end


class EventTime(optx.AbstractRootFinder):
    """Bisection of the step in which a condition changes sign, down to the rounding of its times.

    Those of Optimistix also ask for a residual below a fixed number, above which the rounding of a large condition stays.
    """

    rtol: float = eqx.field(static=True, default=0.0)  # not asked for; Optimistix has both
    atol: float = eqx.field(static=True, default=0.0)
    norm: ClassVar[Callable[[Any], Array]] = staticmethod(optx.max_norm)

    def init(self, fn: Any, y: Any, args: Any, options: Any, f_struct: Any, aux_struct: Any, tags: Any):
        lower, upper = (jnp.asarray(options[end], jnp.result_type(y)) for end in ("lower", "upper"))
        return _Bracket(lower, upper, _fallen(fn, lower, args) < 0)

    def step(self, fn: Any, y: Any, args: Any, options: Any, state: _Bracket, tags: Any):
        middle = state.lower + (state.upper - state.lower) / 2
        before = (_fallen(fn, middle, args) < 0) == state.rising
        state = state._replace(
            lower=jnp.where(before, middle, state.lower), upper=jnp.where(before, state.upper, middle)
        )
        return state.upper, state, fn(y, args)[1]

    def terminate(self, fn: Any, y: Any, args: Any, options: Any, state: _Bracket, tags: Any):
        size = jnp.maximum(jnp.abs(state.lower), jnp.abs(state.upper))
        return state.upper - state.lower <= 4 * jnp.finfo(size.dtype).eps * size, optx.RESULTS.successful

    def postprocess(self, fn: Any, y: Any, aux: Any, args: Any, options: Any, state: _Bracket, tags: Any, result: Any):
        return y, aux, {}


def _fallen(fn: Any, t, args) -> Float[Array, ""]:
    """The condition that happened: Diffrax has the others as zeros."""
    return sum(jax.tree.leaves(fn(t, args)[0]), jnp.zeros_like(t))
