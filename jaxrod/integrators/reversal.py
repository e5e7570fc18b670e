"""Derivatives that there are not: refused in one sentence where JAX would stop in the middle of a loop.  Knows no rods."""

import contextlib
from collections.abc import Iterator
from typing import Any

import jax
import jax.numpy as jnp
from jax.extend.core import Primitive
from jax.interpreters import ad, batching, mlir
from jaxtyping import Array, Bool

FORWARD = (
    "a run has no forward derivative by default; give simulate adjoint=diffrax.ForwardMode(), and of second "
    "derivatives take both forward: jax.jacfwd(jax.jacfwd(f))"
)
BACKWARD = (
    "a run has no reverse derivative of a reverse derivative, nor any with adjoint=diffrax.ForwardMode(); take the outer one "
    "forward: jax.jacfwd(jax.grad(f)), or jax.jacfwd(f)"
)
ONCE = (
    "a run has no reverse derivative of a reverse derivative; take the outer one forward, as jax.hessian does: "
    "jax.jacfwd(jax.grad(f))"
)

# The identity; a reverse derivative goes through it `times` times, one more is refused.
_limited = Primitive("limited_reversal")
_limited.def_impl(lambda x, *, times, why: x)
_limited.def_abstract_eval(lambda x, *, times, why: x)
mlir.register_lowering(_limited, mlir.lower_fun(lambda x, *, times, why: x, multiple_results=False))
batching.defvectorized(_limited)


def _reversed(bar, _, *, times, why):
    if times == 0:
        raise ValueError(why)
    return [bar if type(bar) is ad.Zero else _limited.bind(bar, times=times - 1, why=why)]


ad.deflinear2(_limited, _reversed)


def reversible(tree: Any, times: int, why: str) -> Any:
    """The same tree of arrays, with at most so many reverse derivatives one of the other; `why`, what is said of more."""
    return jax.tree.map(lambda x: _limited.bind(x, times=times, why=why) if _is_float(x) else x, tree)


def as_far_as(reached: Bool[Array, " T"], followed: Bool[Array, " T"], rows: Any, inputs: Any) -> Any:
    """The `rows` (T, ...) of a tree that were `reached`, others NaN; those that were not `followed` have no derivative.

    By each number of `inputs` it is NaN there in either mode, as zero would be taken for one; but where nothing is asked of
    them they leave the other rows alone.
    """

    # Zero stays zero; all else becomes infinite and, less another infinity, no number, from either side, each before it may
    # cancel with another.  By factors: zero times infinity is no number.  They are no constants, of which XLA would take the
    # product, and one more as it fuses the last.
    def no_number(x):
        zero, beyond = x - jax.lax.stop_gradient(x), jnp.where(jnp.all(reached & followed), 1, jnp.finfo(x.dtype).max)
        return jnp.sum(zero * beyond * beyond * beyond - zero * beyond * beyond * beyond)

    unknown = jnp.sum(jnp.stack([no_number(x).astype(float) for x in jax.tree.leaves(inputs) if _is_float(x)]))

    def row(x):
        known, has_derivative = (mask.reshape((-1,) + (1,) * (x.ndim - 1)) for mask in (reached, reached & followed))
        return jnp.where(
            has_derivative, x, jax.lax.stop_gradient(jnp.where(known, x, jnp.nan)) + unknown.astype(x.dtype)
        )

    return jax.tree.map(row, rows)


class NoForwardDerivative(ValueError, TypeError):
    """What JAX raises as a TypeError, said in a sentence: `fit` then goes backwards."""


@contextlib.contextmanager
def forward_refused(why: str = FORWARD) -> Iterator[None]:
    """Says why where JAX would speak of its rules; and `BACKWARD`, where a run that only goes forwards is to go backwards."""
    try:
        yield
    except TypeError as error:
        if "custom_vjp" not in str(error):
            raise
        raise NoForwardDerivative(why) from None
    except ValueError as error:
        if "Linearization failed" not in str(error):
            raise
        raise ValueError(BACKWARD) from None


def _is_float(x: Any) -> bool:
    return isinstance(x, jax.Array) and jnp.issubdtype(x.dtype, jnp.inexact)
