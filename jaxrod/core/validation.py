"""What is asked of every number a user gives.

A refusal is one sentence that names the argument, its value and the remedy.  Values under a JAX transformation are
not known yet and pass: `simulate` answers them with the result code `invalid`.
"""

import types
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Inexact

from . import tracing, units

_FEW = 6  # numbers that are repeated in a representation
_BRIEF = 60  # characters of what is repeated in a message


def fails(condition: Callable[..., Any], *values: Any) -> bool:
    """Whether values are known and `condition` does not hold for them; it receives NumPy arrays.

    NumPy, because under `jit` even an operation on known numbers is traced.
    """
    return all(map(tracing.known, values)) and not np.all(condition(*map(np.asarray, values)))


def number(name: str, value: Any, shape: tuple[int, ...] = (), unit: str | None = "") -> Inexact[Array, "..."]:
    """`value` as a floating-point array of the given shape, finite where that is known.

    A quantity is converted to `unit`, as `units.in_unit` says.  An array keeps its type.  A Python number stays weakly
    typed: beside a float32 array it computes in float32.
    """
    inside = " in SI units" if unit is None else f" in {unit}" if unit else ""
    value = units.in_unit(name, value, unit)
    try:
        array = jnp.asarray(value)
        if array.dtype == bool:
            raise TypeError
        array = array if jnp.issubdtype(array.dtype, jnp.inexact) else array * 1.0
    except (TypeError, ValueError, OverflowError):
        raise ValueError(f"{name}={given(value)} is not a number; give a real number{inside}.") from None
    if array.shape != shape:
        wanted = "one number" if shape == () else f"an array of shape {shape}"
        raise ValueError(
            f"{name} has shape {array.shape} but must be {wanted}; to run many scenes, map over them with jax.vmap or "
            "jaxrod.sweep."
        )
    if jnp.issubdtype(array.dtype, jnp.complexfloating):
        raise ValueError(f"{name}={given(value)} is complex; give a real number{inside}.")
    if fails(np.isfinite, array):
        raise ValueError(f"{name}={shown(array)} is not finite; give a finite number{inside}.")
    return array


def reals(name: str, value: Any, unit: str | None = "") -> Inexact[Array, "..."]:
    """`value` as real floating-point numbers of any shape, finite or not."""
    value = units.in_unit(name, value, unit)
    try:
        array = jnp.asarray(value)
    except (TypeError, ValueError, OverflowError):
        raise ValueError(f"{name}={given(value)} is not numbers; give real ones.") from None
    if array.dtype == bool or jnp.issubdtype(array.dtype, jnp.complexfloating):
        raise ValueError(f"{name} holds numbers of type {array.dtype}; give real ones.")
    return array if jnp.issubdtype(array.dtype, jnp.inexact) else array * 1.0


def along(name: str, value: Any, length: Any) -> Float[Array, " points"]:
    """Material coordinates in m in a row, within a rod of this length where that is known."""
    s = numbers(name, value, "material coordinates in m", "m")
    if fails(lambda s, length: (s >= 0) & (s <= np.min(length) * (1 + 1e-6)), s, length):
        raise ValueError(
            f"{name}={shown(s)} m goes beyond the rod; give coordinates within 0 and length={shown(length)} m."
        )
    return s


def numbers(name: str, value: Any, what: str, unit: str | None = "") -> Float[Array, " N"]:
    """`value` as a floating-point array of one axis with an entry at least."""
    value = units.in_unit(name, value, unit)
    try:
        shape = jnp.asarray(value).shape
    except (TypeError, ValueError, OverflowError):
        shape = (1,)  # `number` says what is wrong
    if len(shape) != 1 or shape == (0,):
        raise ValueError(f"{name} has shape {shape}; give {what} in a row, (T,) with T at least 1.")
    return number(name, value, shape, unit)


def positive(name: str, value: Any, unit: str | None, what: str | None = None) -> Float[Array, ""]:
    """A number above zero, in a unit that Pint reads; `what` says in words what to give."""
    array = number(name, value, unit=unit)
    if fails(lambda x: x > 0, array):
        raise ValueError(f"{name}={shown(array)} must be positive; give it in {what or unit}.")
    return array


def not_negative(name: str, value: Any, unit: str | None, what: str | None = None) -> Float[Array, ""]:
    """A number that may be zero but not below it; likewise."""
    array = number(name, value, unit=unit)
    if fails(lambda x: x >= 0, array):
        raise ValueError(f"{name}={shown(array)} must not be negative; give it in {what or unit}.")
    return array


def switch(name: str, value: Any) -> None:
    """Refuse, by `ValueError`, what is not True or False."""
    if not isinstance(value, bool | np.bool_):
        raise ValueError(f"{name}={given(value)} must be True or False.")


def optional_switch(name: str, value: Any) -> None:
    """Refuse, by `ValueError`, what is not True, False or None."""
    if value is not None:
        switch(name, value)


def count(name: str, value: Any, least: int, what: str, most: int | float = np.inf) -> int:
    """`value` as a whole number that is known, `least` or more, `most` or less."""
    if isinstance(value, bool | np.bool_) or not isinstance(value, int | np.integer) or not least <= value <= most:
        end = "or more" if most == np.inf else f"to {most}"
        raise ValueError(f"{name}={given(value)} must be a whole number of {what}, {least} {end}.")
    return int(value)


def shown(value: Any) -> str:
    """A value as it is written in an error message."""
    array = np.asarray(value)
    return f"{array:.6g}" if array.ndim == 0 else np.array2string(array, precision=6, threshold=8)


def given(value: Any) -> str:
    """What was given in place of something else, as it is written in an error message: in a few words."""
    if isinstance(value, jax.Array | np.ndarray) and (np.ndim(value) > 0 or not tracing.known(value)):
        return f"an array of shape {np.shape(value)}"
    value = value.func if isinstance(value, jax.tree_util.Partial) and not value.args else value
    if isinstance(value, types.FunctionType):
        return f"<function {value.__name__}>"
    text = repr(value)
    told = len(text) <= _BRIEF and not any(x in text for x in ("\n", " at 0x", "Tracer"))
    return text if told else f"{type(value).__name__}(...)"


def brief(value: Any, unit: str = "") -> str:
    """A number as it is written in a representation, with its unit; anything else in a few words."""
    if not tracing.known(value):
        return "traced"
    number = isinstance(value, int | float | np.number | jax.Array) and np.ndim(value) == 0
    return f"{value:.6g} {unit}".rstrip() if number else given(value)


def listed(values: Any) -> str:
    """A few numbers in a row, as they are written in a representation; of many how many there are."""
    if not tracing.known(values) or np.ndim(values) != 1:
        return given(values)
    return shown(values) if np.size(values) <= _FEW else f"[{np.size(values)} numbers]"


def written(module: Any, dtype: Any = None, **in_units: str) -> str:
    """A module as one writes it: the fields named with their units, but those that are None; last the type of its numbers."""
    fields = {name: (getattr(module, name, None), unit) for name, unit in in_units.items()}
    told = [f"{name}={brief(value, unit)}" for name, (value, unit) in fields.items() if value is not None]
    return f"{type(module).__name__}({', '.join([*told, *([] if dtype is None else [str(dtype)])])})"
