"""Many scenes on all cores: short blocks of them side by side, in memory that does not grow with their number.

Each scene is a lane of the vectors that the compiled loop works on.  The program is 64 lanes wide, whatever the block and
the number of scenes, so that a scene is computed by the same instructions wherever it stands.  Blocks follow one another
within a call, and calls go to all devices at once (`configure` shows JAX one device a core).
"""

import contextlib
import math
import warnings
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import Mesh, NamedSharding, PartitionSpec
from jaxtyping import Array, ArrayLike, PyTree
from tqdm import tqdm

from . import configuration
from .core import calling, tracing, validation
from .core.progress import line, wanted
from .core.result import Result

_LANES = 64  # of every program: eight of the widest registers, which is what hides their latency
_WANTED = "of one input -> a pytree of arrays"
_BLOCKS = 16  # in one call: its overhead is spread over them, and the progress bar still moves


def sweep(
    fn: Callable[[PyTree[Array]], PyTree[Array]],
    inputs: PyTree[Array],
    *,
    block: int = 64,
    order_by: ArrayLike | Callable[[PyTree[Array]], Array] | None = None,
    devices: int | None = None,
    progress: bool | None = None,
) -> PyTree[Array]:
    """`jax.vmap(fn)(inputs)`, in blocks on all cores.  The same bits whatever block, order, devices and neighbours.

    **Arguments:**

    - `fn`: from one input to a pytree of arrays, such as `{"strain": sol.strain.max(), "result": sol.result}`.
    - `inputs`: a pytree of arrays with one leading axis, the scenes.
    - `block`: scenes computed side by side, at most 64 (more are several blocks).  A block takes as long as its slowest
      scene, and a short one as long as a full one.
    - `order_by`: predicted cost of each scene, an array or a function of one input; those of like cost share a block.
    - `devices`: how many of JAX's devices to use; all, if left out.
    - `progress`: a bar with rate and remaining time; if left out, on a terminal or in a notebook, after two seconds.

    **Returns:** the answers of `fn`, each of shape (scenes, ...), in the order of `inputs`.

    **Raises:** `ValueError` for inputs without a common first axis, and for a block, devices or costs that make no sense.

    **Warns** with the count of scenes whose `result` is not ok, and of answers that are not finite.

    Memory is that of `inputs`, the answers, and one call of 16 blocks on each device.  Under `jax.jit` and other
    transformations a sweep is `jax.lax.map` in blocks: there `order_by`, `devices` and `progress` mean nothing, and the
    same bits are not promised.

    >>> import jax.numpy as jnp, jaxrod
    >>> print(jaxrod.sweep(lambda x: x**2, jnp.arange(4.0), block=3))
    [0. 1. 4. 9.]
    """
    if not callable(fn):
        raise ValueError(f"fn={validation.given(fn)} is not a function; give one of one input.")
    for leaf in jax.tree.leaves(inputs):
        text = isinstance(leaf, np.ndarray | np.generic) and leaf.dtype.kind in "OSUV"
        if text or not eqx.is_array_like(leaf):
            raise ValueError(f"inputs holds {validation.given(leaf)}, which is no array of numbers; give arrays.")
    sizes = {jnp.shape(leaf)[:1] for leaf in jax.tree.leaves(inputs)}
    if len(sizes) != 1 or sizes & {(), (0,)}:
        shapes = {jax.tree_util.keystr(path) or "inputs": jnp.shape(x) for path, x in jax.tree.leaves_with_path(inputs)}
        raise ValueError(f"inputs have shapes {shapes}; give arrays of one common first axis, an entry for each scene.")
    if isinstance(block, bool) or not isinstance(block, int | np.integer) or block < 1:
        raise ValueError(f"block={validation.given(block)} must be a positive whole number of scenes.")
    validation.optional_switch("progress", progress)
    if tracing.closes_over_traced(fn) or not all(map(tracing.known, jax.tree.leaves((fn, inputs)))):
        return jax.lax.map(lambda x: calling.arrays("fn", _WANTED, fn, x), inputs, batch_size=block)
    workers = _workers(devices)
    configuration.complain_once()
    inputs = jax.tree.map(_on_host, inputs)
    scenes = next(iter(sizes))[0]
    order = _order(order_by, inputs, scenes)

    mesh = Mesh(np.array(jax.local_devices()), ("cores",))  # all: with fewer the program would be another one
    spread = NamedSharding(mesh, PartitionSpec("cores"))
    block, out = min(block, _LANES), None
    size = workers * _BLOCKS * block
    with tqdm(total=scenes, unit=" scenes", delay=2, disable=not wanted(progress)) as bar:
        for begin in range(0, scenes, size):
            picked = order[begin : begin + size]
            lanes, counts, places = _dealt(picked.size, block, workers, mesh.size)
            part = jax.tree.map(lambda x, at=picked[lanes]: x[at], inputs)
            part, counts = jax.device_put((part, counts), spread)
            with line("sweep: the first scenes", progress) if out is None else contextlib.nullcontext():
                answers = jax.block_until_ready(_call(fn, part, counts, mesh))
            if out is None:
                out = jax.tree.map(lambda x: np.empty((scenes, *x.shape[1:]), x.dtype), answers)
            jax.tree.map(lambda x, answer, at=picked, of=places: _store(x, at, answer, of), out, answers)
            bar.update(picked.size)
    out = jax.tree.map(jnp.asarray, out)
    _warn(out)
    return out


def _workers(count: int | None) -> int:
    found = jax.local_device_count()
    if count is None:
        return found
    if isinstance(count, bool) or not isinstance(count, int | np.integer) or count < 1:
        raise ValueError(f"devices={validation.given(count)} must be a positive whole number.")
    if count > found:
        raise ValueError(
            f"devices={count} are not there, JAX has {found}; call jaxrod.configure(devices={count}) before anything "
            "else touches JAX."
        )
    return int(count)


def _on_host(x: Any) -> Any:
    return x if jnp.issubdtype(jnp.result_type(x), jax.dtypes.prng_key) else np.asarray(jnp.asarray(x))


def _order(order_by: Any, inputs, scenes: int) -> np.ndarray:
    if order_by is None:
        return np.arange(scenes)

    # In blocks too: of a million scenes at once it would take gigabytes.
    def cost_of(x):
        return calling.answer("order_by", "of one input -> its predicted cost", order_by, x, shapes=[()])

    many = jax.jit(lambda inputs: jax.lax.map(cost_of, inputs, batch_size=_LANES))
    cost = np.asarray(many(inputs) if callable(order_by) else validation.reals("order_by", order_by))
    if cost.shape != (scenes,) or not np.all(np.isfinite(cost)):
        raise ValueError(
            f"order_by gives numbers of shape {cost.shape} for {scenes} scenes; give one predicted cost a scene, finite."
        )
    return np.argsort(cost, kind="stable")


def _dealt(scenes: int, block: int, workers: int, devices: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The scene of each lane of a call, the count of blocks on each device, and the lane of each scene.

    Lanes that are left over repeat a scene of their block.
    """
    blocks, each = -(-scenes // block), np.arange(devices)
    counts = np.where(each < workers, blocks // workers + (each < blocks % workers), 0)
    lanes = np.zeros((devices, _BLOCKS, _LANES), dtype=int)
    places, first = np.empty(scenes, dtype=int), 0
    for device, count in enumerate(counts):
        for k in range(count):
            last = min(first + block, scenes)
            lanes[device, k] = np.minimum(first + np.arange(_LANES), last - 1)
            places[first:last] = (device * _BLOCKS + k) * _LANES + np.arange(last - first)
            first = last
    return lanes.reshape(-1), counts, places


@eqx.filter_jit
def _call(fn, inputs, counts, mesh: Mesh):
    """The answers of `fn`, block after block on each device: one program, however many scenes there are."""
    spread, alike = PartitionSpec("cores"), PartitionSpec()
    arrays, rest = eqx.partition(fn, eqx.is_array)

    def on_device(arrays, inputs, count):
        lanes = jax.vmap(lambda x: calling.arrays("fn", _WANTED, eqx.combine(arrays, rest), x))
        inputs = jax.tree.map(lambda x: x.reshape(_BLOCKS, _LANES, *x.shape[1:]), inputs)

        def block(k, out):
            answer = lanes(jax.tree.map(lambda x: x[k], inputs))
            return jax.tree.map(lambda x, a: x.at[k].set(a), out, answer)

        shapes = jax.eval_shape(lanes, jax.tree.map(lambda x: x[0], inputs))
        empty = jax.tree.map(lambda x: jnp.zeros((_BLOCKS, *x.shape), x.dtype), shapes)
        out = jax.lax.fori_loop(0, count[0], block, empty)
        return jax.tree.map(lambda x: x.reshape(_BLOCKS * _LANES, *x.shape[2:]), out)

    run = jax.shard_map(on_device, mesh=mesh, in_specs=(alike, spread, spread), out_specs=spread, check_vma=False)
    return run(arrays, inputs, counts)


def _store(out: np.ndarray, at: np.ndarray, answer, places: np.ndarray) -> None:
    out[at] = np.asarray(answer)[places]


def _warn(out: PyTree) -> None:
    def scenes(trouble: list[np.ndarray]) -> int:
        return int(np.sum(sum(np.any(x.reshape(len(x), math.prod(x.shape[1:])), axis=1) for x in trouble) > 0))

    leaves = jax.tree.leaves(out)
    failed = scenes([np.asarray(x) != Result.ok for x in leaves if x.dtype == jnp.int8])  # the type of result codes
    lost = scenes([~np.isfinite(np.asarray(x)) for x in leaves if eqx.is_inexact_array(x)])
    if failed or lost:
        warnings.warn(f"sweep: {failed} scenes did not end ok, {lost} gave answers that are not finite.", stacklevel=3)
