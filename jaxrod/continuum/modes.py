"""The exact rod's axial modes: standing waves of any rod, held as its motion holds it.

They are the singular vectors of the compliance F = U diag(1 / omega) V^T.  Displacement is u = sum_k q_k U_k / sqrt(rho A ds)
and tension N = sum_k q_k omega_k V_k sqrt(EA / ds), so that the energy is 1/2 sum_k (q_k'^2 + omega_k^2 q_k^2).
"""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..core.linear_algebra import svd
from ..rods.quadrature import Panels
from ..rods.rod import Rod
from .compliance import axial
from .mesh import panel_ends, safe_sqrt


class Waves(eqx.Module):
    """The first n modes, ascending.  Amplitudes q (n,) are in m kg^1/2.

    `omega` (rad/s), mode by mode; by these amplitudes `lever` (kg^1/2 m), int rho A x u ds; `moment` (kg^1/2), int rho A
    u ds; `tip` (kg^-1/2), the displacement of the tip, `elongation` of
    the whole rod; `tension` (N, n) at the nodes, N per amplitude.  Of the rod at rest
    `inertia` (kg m^2), `first_moment` (kg m) and `reach` (m, of the tip) about the pivot, in flight the centre of mass,
    which is `origin` (m from the root); `mass` (kg); `rigidity` EA ds (N m) at the nodes of `panels`.

    The modes beyond the n-th follow their loads as if at rest.  `slack` (3,) and `slack_tension` (N, 3) are what they add
    to the tip's displacement and to the tension per unit of the three loads: |d'|^2, g . d and the force along the rod.
    `slack_elongation` (3,) is what they add to that of the whole rod.
    """

    omega: Float[Array, " n"]
    lever: Float[Array, " n"]
    moment: Float[Array, " n"]
    tip: Float[Array, " n"]
    elongation: Float[Array, " n"]
    tension: Float[Array, "N n"]
    inertia: Float[Array, ""]
    first_moment: Float[Array, ""]
    reach: Float[Array, ""]
    origin: Float[Array, ""]
    mass: Float[Array, ""]
    rigidity: Float[Array, " N"]
    slack: Float[Array, "3"]
    slack_tension: Float[Array, "N 3"]
    panels: Panels

    def first(self, n: Any) -> "Waves":
        """These waves as if there were n modes: the others carry nothing.  n may be traced."""
        beyond = jnp.arange(self.omega.size) >= n
        carried = jnp.stack([self.lever, self.moment, self.tip], axis=1) * (beyond / self.omega**2)[:, None]
        slack = self.slack + self.tip @ carried, self.slack_tension + self.tension @ carried
        by_mode = lambda waves: (waves.lever, waves.moment, waves.tip, waves.elongation, waves.tension)  # noqa: E731
        kept = eqx.tree_at(
            by_mode,
            self,
            [jnp.where(beyond, 0.0, x) for x in by_mode(self)[:4]] + [jnp.where(beyond[None, :], 0.0, self.tension)],
        )
        return eqx.tree_at(lambda waves: (waves.slack, waves.slack_tension), kept, slack)

    def amplitudes(self, strain: Float[Array, " N"]) -> Float[Array, " n"]:
        """Of a field of strain, given at the nodes: omega_k^2 q_k = int N_k strain ds."""
        return (self.panels.ds * strain) @ self.tension / self.omega**2

    def strain(self, q: Float[Array, " n"], nodes: Any = slice(None)) -> Float[Array, " N"]:
        """Strain at the nodes, or at some of them."""
        return self._strained(self.tension[nodes] @ q, nodes)

    @property
    def slack_elongation(self) -> Float[Array, "3"]:
        return self.panels.ds @ jax.vmap(self._strained, 1, 1)(self.slack_tension)

    def _strained(self, tension: Float[Array, " N"], nodes: Any = slice(None)) -> Float[Array, " N"]:
        rigidity = self.rigidity[nodes]
        return tension * self.panels.ds[nodes] / jnp.where(rigidity > 0, rigidity, 1.0)

    def tension_at(self, s: Float[Array, " points"]) -> Float[Array, "points columns"]:
        """Tension in N per amplitude, and per load, at the material coordinates s (m): its polynomial on each panel."""
        tension = jnp.concatenate([self.tension, self.slack_tension], axis=1)
        ends, order = self.panels.ends, self.panels.order
        panel = jnp.clip(jnp.searchsorted(ends, s, side="right") - 1, 0, ends.size - 2)
        nodes = self.panels.s.reshape(-1, order)[panel]
        weight = _lagrange(s, nodes)
        return jnp.einsum("po,pok->pk", weight, tension.reshape(-1, order, tension.shape[1])[panel])


def waves(rod: Rod, pivot: Any, free: bool, n: int, order: int) -> Waves:
    """The first n modes of this rod on `order` nodes for each panel, supported as `support` says."""
    held = axial(rod, pivot, free, order)
    U, sigma, V = svd(held.F, n)
    omega = 1 / sigma
    root = safe_sqrt(held.mesh.mass)
    start = rod.center_of_mass if free else pivot
    ends = panel_ends(rod, [] if start is None else [jax.lax.stop_gradient(start) if free else start])
    origin = jnp.zeros_like(rod.length) if start is None else start
    s, ds = held.mesh.s, held.mesh.ds
    rigidity = rod.modulus(s) * rod.area(s) * ds
    stretched = omega[None, :] * V
    by_force = jnp.where(ds > 0, safe_sqrt(rigidity) / jnp.where(ds > 0, ds, 1.0), 0.0)[:, None]
    compliance = jnp.where(ds > 0, ds / jnp.where(ds > 0, safe_sqrt(rigidity), 1.0), 0.0)
    inertia = held.lever @ held.lever
    answers = jnp.stack([held.lever @ held.F, root @ held.F, held.tip], axis=1)
    answers = answers - V @ (V.T @ answers)
    return Waves(
        omega=omega,
        lever=held.lever @ U,
        moment=root @ U,
        tip=held.tip @ stretched,
        elongation=compliance @ stretched,
        tension=stretched * by_force,
        inertia=inertia if rod.tip_inertia is None else inertia + rod.tip_inertia,
        first_moment=root @ held.lever,
        reach=rod.length - origin,
        origin=origin,
        mass=root @ root,
        rigidity=rigidity,
        slack=held.tip @ answers,
        slack_tension=answers * by_force,
        panels=Panels(ends, order),
    )


def _lagrange(s: Float[Array, " points"], nodes: Float[Array, "points order"]) -> Float[Array, "points order"]:
    """Value at s of the polynomials that are 1 at one node and 0 at the others."""
    others = ~jnp.eye(nodes.shape[1], dtype=bool)
    gaps = nodes[:, :, None] - nodes[:, None, :]
    ratio = (s[:, None, None] - nodes[:, None, :]) / jnp.where((gaps != 0) & others[None], gaps, 1.0)
    return jnp.prod(jnp.where(others[None], ratio, 1.0), axis=2)
