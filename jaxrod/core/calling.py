"""How a function that a user gives is called: whatever goes wrong in it becomes one sentence.

`tried` does so without computing, when a scene is built; `answer` where the function is run.
"""

import re
from collections.abc import Callable, Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Inexact

from . import units, validation

# What JAX raises where a program asks for the value of a number that is only traced.
_TRACED = (jax.errors.JAXTypeError, jax.errors.JAXIndexError)
_MOST = 150  # characters of what a function raised


def attempt(name: str, wanted: str, function: Callable[..., Any], *given: Any, **named: Any) -> Any:
    """What `function` returns.

    **Raises:** `ValueError` where it raises: `name` says which argument it is, `wanted` what it should be.
    """
    try:
        return function(*given, **named)
    except Exception as error:
        raise ValueError(f"{name} {_said(error)}; give a function {wanted}, written with jax.numpy.") from error


def answer(
    name: str, wanted: str, function: Callable[..., Any], *given: Any, shapes: Sequence[tuple[int, ...]] | None = None
) -> Inexact[Array, "..."]:
    """What `function` returns, as real floating-point numbers of one of the `shapes` (of any, if None).

    **Raises:** `ValueError` where it raises, and where it returns anything else.
    """
    found = attempt(name, wanted, function, *given)

    def refused(what: str) -> ValueError:
        return ValueError(f"{name} returned {what}; give a function {wanted}, written with jax.numpy.")

    try:
        array = real(found)
    except (TypeError, ValueError):
        raise refused(validation.given(found)) from None
    if jnp.issubdtype(array.dtype, jnp.complexfloating):
        raise refused("complex numbers")
    if shapes is not None and array.shape not in shapes:
        raise refused(f"an array of shape {array.shape}")
    return array


def arrays(name: str, wanted: str, function: Callable[..., Any], *given: Any) -> Any:
    """What `function` returns, as it is: a pytree of arrays.

    **Raises:** `ValueError` where it raises, and where it returns anything else.
    """
    found = attempt(name, wanted, function, *given)
    leaves = jax.tree.leaves(found)
    wrong = [x for x in leaves if not eqx.is_array_like(x)]
    if wrong or not leaves:
        what = validation.given(wrong[0]) if wrong else f"{validation.given(found)}, which holds no array"
        raise ValueError(f"{name} returned {what}; give a function {wanted}, written with jax.numpy.")
    return found


def tried(
    name: str, wanted: str, function: Callable[..., Any], *given: Any, shapes: Sequence[tuple[int, ...]] | None = None
) -> None:
    """Refuse, by `ValueError`, a function that has no `answer` to arguments like these, which may be `jax.ShapeDtypeStruct`s.

    Nothing is computed or compiled.
    """
    rehearsed(lambda given: answer(name, wanted, function, *given, shapes=shapes), given)


def rehearsed(function: Callable[..., Any], *given: Any) -> None:
    """What `function` refuses, by `ValueError`, without computing anything."""
    refused: list[ValueError] = []

    def rehearsal(*given):
        try:
            function(*given)
        except ValueError as error:
            refused.append(error)

    eqx.filter_eval_shape(rehearsal, *given)
    if refused:  # raised out here, as JAX adds a note on its own frames to what passes through them
        raise ValueError(str(refused[0])) from refused[0].__cause__


def like(*shape: int) -> jax.ShapeDtypeStruct:
    """Numbers of this shape that `tried` has a function try."""
    return jax.ShapeDtypeStruct(shape, jnp.result_type(float))


def real(found: Any) -> Array:
    """Numbers that a function returned as an array, whole ones as floating-point numbers.

    **Raises:** `ValueError` for quantities with a unit, whose unit JAX would strip.
    """
    if units.carries_unit(found):
        raise ValueError("a function returned a quantity with a unit; return plain numbers in SI.")
    array = jnp.asarray(found)
    return array if jnp.issubdtype(array.dtype, jnp.inexact) else array * 1.0


def _said(error: Exception) -> str:
    if isinstance(error, _TRACED):
        return "needs the value of a number that JAX only traces, as numpy, math, float() and if do"
    text = re.sub(r"\w*Tracer\w*", "array", " ".join(str(error).split()))
    text = text if len(text) <= _MOST else f"{text[:_MOST]}..."
    return f"raised {type(error).__name__}{f': {text}' * bool(text)}".rstrip(".")
