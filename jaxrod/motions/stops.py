"""Where steps end: at the times that are saved, and where loads change in between."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ..core import tracing, validation
from .preview import Preview

_BESIDE = 1e-11  # of a run's length, below which a knot counts as a save time


class Stops(eqx.Module):
    """Times at which a step ends: save times, and `inner` ones; `saves`, where the save times are among `ends`."""

    ends: Float[Array, " E"]
    saves: Int[Array, " T"] | None
    inner: Float[Array, " K"] | None

    @staticmethod
    def of(t0, ts: Float[Array, " T"], knots, looked: Preview | None) -> "Stops":
        """The save times, with `knots` and those of what was looked at, if there are any."""
        inner = [x for x in (knots, None if looked is None else looked.knots) if x is not None]
        return Stops.merged(t0, ts, jnp.concatenate(inner).astype(ts.dtype) if inner else None)

    @staticmethod
    def merged(t0, ts, inner) -> "Stops":
        if inner is None:
            return Stops(ts, None, None)
        # A knot by a save time becomes that time, derivative and all: no leg of rounding's length is left between them.
        inner = jnp.clip(jax.lax.stop_gradient(inner), t0, ts[-1])
        after = jnp.clip(jnp.searchsorted(ts, inner), 0, ts.size - 1)
        before = jnp.maximum(after - 1, 0)
        nearest = jnp.where(jnp.abs(ts[before] - inner) < jnp.abs(ts[after] - inner), ts[before], ts[after])
        beside = jnp.abs(nearest - inner) <= _BESIDE * (ts[-1] - t0)
        ends = jnp.sort(jnp.concatenate([ts, jnp.where(beside, nearest, inner)]))
        return Stops(ends, jnp.searchsorted(ends, ts, side="right") - 1, inner)

    def last_until(self, t) -> Int[Array, " *any"]:
        """The last of `ends` that is not after t."""
        return jnp.clip(jnp.searchsorted(self.ends, t, side="right") - 1, 0, self.ends.size - 1)

    def at_saves(self, tree: Any) -> Any:
        """Rows of all ends, at the save times."""
        return tree if self.saves is None else jax.tree.map(lambda x: x[self.saves], tree)

    def distinct(self, t0) -> Float[Array, " E"]:
        """The ends without derivatives, each once; in place of doubles, times beyond the last."""
        ends = jax.lax.stop_gradient(self.ends)
        beyond = ends[-1] + (ends[-1] - t0) * (1 + jnp.arange(ends.size, dtype=ends.dtype))
        return jnp.sort(jnp.where(jnp.diff(ends, prepend=t0) <= 0, beyond, ends))


def known_knots(system: Any, clock, start, end) -> tuple[Float[Array, " K"] | None, Any]:
    """Knots of a scene's `Record`s and `Impulse`s, in s since `clock` (None: as they are); whether a run from `start` to
    `end`, since then too, leaves a `Record`.  Each None if it is not so.

    **Raises:** `ValueError` where it is known to leave one.
    """
    found = system.knots
    if found is None:
        return None, None
    zero = jnp.zeros_like(start) if clock is None else clock
    begin, end = zero + start, zero + end
    unknown = system.unknown(begin, end)
    if validation.fails(lambda unknown: ~unknown, unknown):
        raise ValueError(
            f"a Record of the scene does not reach over the run, from {validation.shown(begin)} to {validation.shown(end)} s; "
            "add samples, or of a force one of zero at its end."
        )
    return jnp.asarray(since(zero, found), start.dtype), None if tracing.known(unknown) else unknown


def since(t0, ts) -> Any:
    """Times since t0: of known ones in float64, whatever the type of the run."""
    if tracing.known(t0) and tracing.known(ts):
        return np.asarray(ts, np.float64) - np.asarray(t0, np.float64)
    return jnp.asarray(ts) - jnp.asarray(t0)
