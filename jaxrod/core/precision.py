"""The float type of a run: which numbers of a scene decide it, and what to do where it is float32."""

import warnings
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from .. import configuration

_NAMED = 3  # numbers in a message


def float_type(*trees: Any) -> jnp.dtype:
    """The type that JAX's promotion gives all numbers of these pytrees together."""
    leaves = [leaf for leaf in jax.tree.leaves(trees) if isinstance(leaf, jax.Array | np.ndarray | float)]
    return jnp.result_type(float, *leaves)


def in_type(dtype: Any, tree: Any) -> Any:
    """The tree with its floats in a type."""
    return jax.tree.map(lambda x: x.astype(dtype) if eqx.is_inexact_array(x) else x, tree)


def warn_if_lowered(dtype: Any, system: Any, start: Any, stacklevel: int = 3) -> None:
    """Warn where a few numbers in float32 have a whole run computed in it, though JAX's default is float64."""
    if dtype != jnp.float32:
        return
    low = _in_float32(system, start)
    plain = any(getattr(x, "weak_type", isinstance(x, float)) for x in jax.tree.leaves((system, start)))
    if low and plain:
        warnings.warn(
            f"{low} in float32, and so the run is; give Python numbers or float64, or all numbers in float32.",
            stacklevel=stacklevel,
        )


def remedy(system: Any, start: Any) -> str:
    """What to do so that a scene computes in float64."""
    low = _in_float32(system, start)
    return f"{low} in float32, so give Python numbers or float64" if low else configuration.remedy_of_float32()


def _in_float32(system: Any, start: Any) -> str:
    """The numbers in float32 although JAX's default is float64, as the subject of a sentence.

    The start only where it is alone: a state takes the type of its system.
    """
    if jnp.result_type(float) == jnp.float32:
        return ""
    leaves = jax.tree_util.tree_leaves_with_path(system)
    low = [jax.tree_util.keystr(path, simple=True, separator=".") for path, x in leaves if _is_low(x)]
    if not low:
        return "start is" if any(map(_is_low, jax.tree.leaves(start))) else ""
    few = [*low[:_NAMED], *["others"] * (len(low) > _NAMED)]
    return f"{', '.join(few[:-1])} and {few[-1]} are" if few[1:] else f"{few[0]} is"


def _is_low(x: Any) -> bool:
    return getattr(x, "dtype", None) == np.float32 and not getattr(x, "weak_type", False)
