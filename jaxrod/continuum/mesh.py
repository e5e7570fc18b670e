"""The exact rod's nodes: Gauss-Legendre points on panels, and the matrix that integrates from any of their ends."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..core import precision
from ..rods.quadrature import gauss
from ..rods.rod import Rod


class Mesh(NamedTuple):
    """A rod on its nodes: coordinates s and weights ds in m (N,), the running integral `within` each panel (N, N).

    `s_mass` (m) and `mass` (kg) are N long, or N + 1 with the body at the tip.
    """

    s: Float[Array, " N"]
    ds: Float[Array, " N"]
    within: Float[Array, "N_tip N"]
    s_mass: Float[Array, " M"]
    mass: Float[Array, " M"]

    @staticmethod
    def of(rod: Rod, at: list[Float[Array, ""]], order: int) -> "Mesh":
        """The rod on `order` nodes for each panel; panels end at `at` (m) too."""
        dtype = precision.float_type(rod, at)
        ends = panel_ends(rod, at)
        x, w = (jnp.asarray(column, dtype) for column in gauss(order))
        half = jnp.diff(ends)[:, None] / 2
        s, ds = (ends[:-1, None] + half * (1 + x)[None, :]).reshape(-1), (half * w[None, :]).reshape(-1)
        panels = half.shape[0]
        panel = jnp.arange(panels * order) // order
        inner = jnp.tile(jnp.asarray(_running_integral(order), dtype), (panels, panels))
        within = jnp.where(panel[:, None] == panel[None, :], inner, (panel[:, None] > panel[None, :]).astype(dtype))
        within = jnp.concatenate([within, jnp.ones((1, s.size), dtype)])
        mass = ds * rod.mass_density(s) * rod.area(s)
        if rod.tip_mass is None:
            return Mesh(s, ds, within, s, mass)
        # A rounding error of mass, for a derivative at no mass at all: the square root has none there.
        tip = rod.tip_mass + jax.lax.stop_gradient(jnp.finfo(dtype).eps * jnp.sum(mass))
        s_tip = rod.length.astype(dtype)
        return Mesh(s, ds, within, jnp.append(s, s_tip), jnp.append(mass, tip.astype(dtype)))

    def reach(self, start: Float[Array, ""] | None) -> Float[Array, "N_tip N"]:
        """1 where a strain at s_j moves the point s_i (-1 on the root's side), both on one side of `start`.

        The integral from `start` to s_i is reach @ (ds * values); the last row is the tip.  `start` must be the end of
        a panel (None: the root).
        """
        if start is None:
            return self.within
        far = self.s > start
        far_rows = jnp.concatenate([far, jnp.ones(1, bool)])[:, None]
        kernel = jnp.where(far_rows, self.within, self.within - 1)
        return jnp.where(far_rows == far[None, :], kernel, 0.0)


def safe_sqrt(x: Float[Array, "*any"]) -> Float[Array, "*any"]:
    """Square root, with derivative zero at zero: for panels of no length, which stay so."""
    empty = x <= 0  # and not NaN
    return jnp.where(empty, 0.0, jnp.sqrt(jnp.where(empty, 1.0, x)))


def panel_ends(rod: Rod, at: list[Float[Array, ""]]) -> Float[Array, " ends"]:
    """Ends of the panels in m, ascending."""
    return rod.panels(at=at).ends


def _running_integral(order: int) -> np.ndarray:
    """K with int_-1^x_i f = sum_j K_ij w_j f(x_j), exact for polynomials: sum over k of P_k(x_j) int_-1^x_i P_k (2k+1)/2."""
    x, _ = gauss(order)
    legendre = np.polynomial.legendre.legvander(x, order)
    before = np.concatenate([-np.ones((order, 1)), legendre[:, : order - 1]], axis=1)
    return (legendre[:, 1:] - before) @ legendre[:, :order].T / 2
