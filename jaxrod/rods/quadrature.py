"""Integrals along the rod: Gauss-Legendre points on panels, between which nothing jumps."""

import functools
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

gauss = functools.cache(np.polynomial.legendre.leggauss)  # nodes and weights of an order on [-1, 1]


class Panels(eqx.Module):
    """A composite Gauss-Legendre rule: `order` points on each panel between the increasing `ends`.

    Exact for polynomials of degree 2 order - 1 on each panel; a panel may have no length.
    """

    ends: Float[Array, " ends"]
    order: int = eqx.field(static=True)

    @property
    def s(self) -> Float[Array, " points"]:
        """The points, panel after panel."""
        x, _ = gauss(self.order)
        return (self.ends[:-1, None] + self._half()[:, None] * jnp.asarray(1 + x, self.ends.dtype)[None, :]).reshape(-1)

    @property
    def ds(self) -> Float[Array, " points"]:
        """Their weights."""
        _, w = gauss(self.order)
        return (self._half()[:, None] * jnp.asarray(w, self.ends.dtype)[None, :]).reshape(-1)

    def running(self, values: Float[Array, "k points"]) -> Float[Array, "k points"]:
        """int from ends[0] to each point of the functions with these values at the points."""
        return self._running(values, upwards=True)

    def remaining(self, values: Float[Array, "k points"]) -> Float[Array, "k points"]:
        """int from each point to ends[-1]: not the difference of two, which would be rounding at a thin tip."""
        return self._running(values, upwards=False)

    def _running(self, values, upwards: bool):
        x, w = gauss(self.order)
        within = _integrals(x) @ _series(self.order)
        within = within if upwards else w[None, :] - within
        panels = values.reshape(len(values), -1, self.order)
        half = self._half()[None, :, None]
        whole = half * (panels @ jnp.asarray(w[:, None], values.dtype))
        others = jnp.cumsum(whole, axis=1) if upwards else jnp.cumsum(whole[:, ::-1], axis=1)[:, ::-1]
        inside = half * (panels @ jnp.asarray(within.T, values.dtype))
        return (others - whole + inside).reshape(values.shape)

    def antiderivative(self, values: Float[Array, "k points"], at: Float[Array, " m"]) -> Float[Array, "k m"]:
        """The same integrals up to any coordinates `at`."""
        panel = jnp.clip(jnp.searchsorted(self.ends, at, side="right") - 1, 0, self.ends.size - 2)
        series = values.reshape(len(values), -1, self.order) @ jnp.asarray(_series(self.order).T, values.dtype)
        half = self._half()
        whole = 2 * half[None, :] * series[:, :, 0]
        before = jnp.cumsum(whole, axis=1) - whole
        p = legendre(self.order, local(at, self.ends[panel], self.ends[panel + 1]))
        odd = jnp.arange(3, 2 * self.order, 2, dtype=p.dtype)[:, None]
        within = jnp.concatenate([(p[1] + 1)[None], (p[2:] - p[:-2]) / odd])
        return before[:, panel] + half[panel][None, :] * jnp.einsum("kmd,dm->km", series[:, panel, :], within)

    def _half(self):
        return jnp.diff(self.ends) / 2


def _series(order: int) -> np.ndarray:
    """From values at the points of a panel to the coefficients of their Legendre series."""
    x, w = gauss(order)
    return (np.arange(order) + 0.5)[:, None] * np.polynomial.legendre.legvander(x, order - 1).T * w


def _integrals(x: np.ndarray) -> np.ndarray:
    """int_-1^x P_k = (P_k+1 - P_k-1) / (2 k + 1), and x + 1 for k = 0, at the points x of a panel."""
    p = np.polynomial.legendre.legvander(x, x.size)
    return np.concatenate([p[:, 1:2] + 1, (p[:, 2:] - p[:, :-2]) / np.arange(3, 2 * x.size, 2)], axis=1)


def local(s: Any, start: Any, end: Any) -> Any:
    """s as a coordinate in [-1, 1] between start and end; 0 where they coincide."""
    empty = end <= start
    return jnp.where(empty, 0.0, (2 * s - start - end) / jnp.where(empty, 1.0, end - start))


@functools.partial(jax.custom_jvp, nondiff_argnums=(0,))
def legendre(degree: int, x: Float[Array, "*points"]) -> Float[Array, "degrees *points"]:
    """The Legendre polynomials P_0 .. P_degree at x, by Bonnet's recurrence."""
    p = [jnp.ones_like(x), x]
    for k in range(1, degree):
        p.append(((2 * k + 1) * x * p[k] - k * p[k - 1]) / (k + 1))
    return jnp.stack(p[: degree + 1])


@legendre.defjvp
def _legendre_jvp(degree, primals, tangents):
    """P_k' is a sum of the P of lower degrees; XLA needs minutes for the recurrence backwards."""
    (x,), (dx,) = primals, tangents
    p = legendre(degree, x)
    slopes = np.polynomial.legendre.legder(np.eye(degree + 2))[:, :-1].T
    return p, jnp.tensordot(jnp.asarray(slopes, p.dtype), p, 1) * dx[None]
