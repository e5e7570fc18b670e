"""Many scenes."""

import warnings
from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, PyTree

from . import checks
from .result import Result


def sweep(fn: Callable[[PyTree[Array]], PyTree[Array]], inputs: PyTree[Array], *, block: int = 64) -> PyTree[Array]:
    """`jax.vmap(fn)(inputs)`, in blocks: memory grows with the block and the answers, not with the runs inside.

    **Arguments:**

    - `fn`: from one input to a pytree of arrays, such as `{"strain": sol.strain.max(), "result": sol.result}`.
    - `inputs`: a pytree of arrays with one leading axis, the scenes.
    - `block`: scenes computed side by side.  A block takes as long as its slowest scene.

    **Returns:** the answers of `fn` with a leading axis.

    **Warns** with the count of scenes whose `result` is not ok, and of answers that are not finite.

    >>> import jax.numpy as jnp, jaxrod
    >>> print(jaxrod.sweep(lambda x: x**2, jnp.arange(4.0), block=3))
    [0. 1. 4. 9.]
    """
    sizes = {jnp.shape(leaf)[:1] for leaf in jax.tree.leaves(inputs)}
    if len(sizes) != 1 or sizes & {(), (0,)}:
        raise ValueError(
            f"inputs have leading axes {sorted(sizes)}; give arrays of one common length, one entry a scene."
        )
    if block < 1:
        raise ValueError(f"block={block} must be a positive whole number of scenes.")
    out = _blocks(fn, jax.tree.map(jnp.asarray, inputs), block)
    _warn(out)
    return out


@eqx.filter_jit
def _blocks(fn, inputs, block):
    return jax.lax.map(fn, inputs, batch_size=block)


def _warn(out: PyTree) -> None:
    leaves = jax.tree.leaves(out, is_leaf=lambda x: isinstance(x, Result))
    if not all(checks.known(x) for x in jax.tree.leaves(out)):
        return
    failed = sum(int(np.sum(~np.asarray(x == Result.ok))) for x in leaves if isinstance(x, Result))
    numbers = [np.asarray(x) for x in leaves if eqx.is_inexact_array(x)]
    scenes = {len(x) for x in numbers}
    lost = sum(np.any(~np.isfinite(x.reshape(len(x), -1)), axis=1) for x in numbers) if len(scenes) == 1 else 0
    lost = int(np.sum(np.asarray(lost) > 0))
    if failed or lost:
        warnings.warn(f"sweep: {failed} scenes did not end ok, {lost} gave answers that are not finite.", stacklevel=3)
