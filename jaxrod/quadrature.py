"""Integrals along the rod: Gauss-Legendre points on panels, between which nothing jumps."""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float


class Panels(eqx.Module):
    """A composite Gauss-Legendre rule: `order` points on each panel between the increasing `ends`.

    Exact for polynomials of degree 2 order - 1 on each panel; a panel may have no length.
    """

    ends: Float[Array, " panels+1"]
    order: int = eqx.field(static=True)

    @property
    def s(self) -> Float[Array, " points"]:
        """The points, panel after panel."""
        x, _ = np.polynomial.legendre.leggauss(self.order)
        return (self.ends[:-1, None] + self._half()[:, None] * jnp.asarray(1 + x, self.ends.dtype)[None, :]).reshape(-1)

    @property
    def ds(self) -> Float[Array, " points"]:
        """Their weights."""
        _, w = np.polynomial.legendre.leggauss(self.order)
        return (self._half()[:, None] * jnp.asarray(w, self.ends.dtype)[None, :]).reshape(-1)

    def antiderivative(self, values: Float[Array, "k points"], at: Float[Array, " m"]) -> Float[Array, "k m"]:
        """int from ends[0] to each of `at` of the functions with these values at the points."""
        x, w = np.polynomial.legendre.leggauss(self.order)
        degree = np.arange(self.order)
        project = (degree + 0.5)[:, None] * np.polynomial.legendre.legvander(x, self.order - 1).T * w
        series = values.reshape(len(values), -1, self.order) @ jnp.asarray(project.T, values.dtype)
        half, panel = self._half(), self._panel(at)
        whole = 2 * half * series[:, :, 0]
        before = jnp.cumsum(whole, axis=1) - whole
        # int_-1^x P_k = (P_k+1 - P_k-1) / (2 k + 1), and x + 1 for k = 0
        p = legendre(self.order, self._local(at, panel))
        within = jnp.concatenate([(p[1] + 1)[None], (p[2:] - p[:-2]) / jnp.asarray(2 * degree[1:] + 1, p.dtype)[:, None]])
        return before[:, panel] + half[panel] * jnp.einsum("kmd,dm->km", series[:, panel, :], within)

    def _half(self):
        return jnp.diff(self.ends) / 2

    def _panel(self, at):
        return jnp.clip(jnp.searchsorted(self.ends, at, side="right") - 1, 0, self.ends.size - 2)

    def _local(self, at, panel):
        return local(at, self.ends[panel], self.ends[panel + 1])


def local(s: Any, start: Any, end: Any) -> Any:
    """s as a coordinate in [-1, 1] between start and end; 0 where they coincide."""
    empty = end <= start
    return jnp.where(empty, 0.0, (2 * s - start - end) / jnp.where(empty, 1.0, end - start))


def legendre(degree: int, x: Float[Array, "*points"]) -> Float[Array, "degree+1 *points"]:
    """The Legendre polynomials P_0 .. P_degree at x, by Bonnet's recurrence."""
    p = [jnp.ones_like(x), x]
    for k in range(1, degree):
        p.append(((2 * k + 1) * x * p[k] - k * p[k - 1]) / (k + 1))
    return jnp.stack(p[: degree + 1])
