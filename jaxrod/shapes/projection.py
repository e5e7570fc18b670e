"""The rod as a basis sees it: a few small arrays, which are all that the energies need."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from ..core import linear_algebra
from ..rods.lumped import Lumped


class Projection(eqx.Module):
    """The rod as its basis sees it: M (n+1, n+1) in kg m^2, K (n, n) in N m, p (n+1,) in kg m.

    `mass` in kg; `tip` (n+1,) holds phi_k(length) in m; `strains` (n, points) phi_k' along the rod and `rigidity`
    (points,) E A ds in N m, for `law`, the strain law, None for Hooke's.  `root` (n, n): W with W W^T the inverse of
    M_aa, None where one division does.
    """

    mass_matrix: Float[Array, "all all"]
    stiffness_matrix: Float[Array, "n n"]
    first_moments: Float[Array, " all"]
    mass: Any  # Float[Array, ""]; a Lumped body has none
    tip: Float[Array, " all"]
    strains: Float[Array, "n points"]
    rigidity: Float[Array, " points"]
    law: Any
    root: Float[Array, "n n"] | None

    @property
    def strain_mass(self) -> Float[Array, "n n"]:
        """M_aa: the part of the mass matrix that belongs to the strain amplitudes."""
        return self.mass_matrix[1:, 1:]

    def inertia(self, amplitudes: Float[Array, "*batch n"]) -> Float[Array, "*batch"]:
        """Moment of inertia of the stretched rod, z^T M z, in kg m^2."""
        if amplitudes.shape[-1] == 0:  # rigid: nothing to compute
            return jnp.broadcast_to(self.mass_matrix[0, 0], amplitudes.shape[:-1])
        # by blocks: XLA:CPU (0.10 to 0.12) gets z @ M @ z wrong over 2500 lanes for a known M whose entries are all equal
        central, coupled = self.mass_matrix[0, 0], self.mass_matrix[0, 1:]
        within = jnp.einsum("...k,kl,...l->...", amplitudes, self.strain_mass, amplitudes)
        return central + 2 * (amplitudes @ coupled) + within

    def moment(self, amplitudes: Float[Array, "*batch n"]) -> Float[Array, "*batch"]:
        """First moment of the stretched rod, p^T z, in kg m."""
        return self._along(amplitudes, self.first_moments)

    def reach(self, amplitudes: Float[Array, "*batch n"]) -> Float[Array, "*batch"]:
        """Where the tip is along the director, x(length), in m."""
        return self._along(amplitudes, self.tip)

    def solve_strain(self, right: Float[Array, " n"]) -> Float[Array, " n"]:
        """M_aa^-1 right."""
        if right.size == 0:
            return right
        return right / self.mass_matrix[1:, 1] if self.root is None else self.root @ (self.root.T @ right)

    def _along(self, amplitudes, values):
        if amplitudes.shape[-1] == 0:
            return jnp.broadcast_to(values[0], amplitudes.shape[:-1])
        return values[0] + amplitudes @ values[1:]

    def field(self, amplitudes: Float[Array, "*batch n"]) -> Float[Array, "*batch points"]:
        """Strain along the rod."""
        return amplitudes @ self.strains

    def or_idle(self, sound: Bool[Array, ""]) -> "Projection":
        """This one where it is sound, else one that anything runs with: of unit masses and springs, uncoupled if there are
        several."""
        idle = jax.tree.map(jnp.ones_like, self)
        if self.root is not None:
            eye = [jnp.eye(x.shape[0], dtype=x.dtype) for x in (self.mass_matrix, self.stiffness_matrix, self.root)]
            idle = eqx.tree_at(lambda x: (x.mass_matrix, x.stiffness_matrix, x.root), idle, eye)
        return jax.tree.map(lambda x, y: jnp.where(sound, x, y), self, idle)


def lumped(rod: Lumped, n: int) -> Projection:
    """A body of given inertia with n = 0 or 1 uniform strain."""
    ones = jnp.ones(n + 1, dtype=rod.inertia.dtype)
    return Projection(
        rod.inertia * jnp.outer(ones, ones),
        rod.stiffness * jnp.outer(ones, ones)[1:, 1:],
        rod.first_moment * ones,
        mass=None,
        tip=rod.length * ones,
        strains=ones[1:, None],
        rigidity=rod.stiffness[None],
        law=None,
        root=None,
    )


def inverse_mass_root(mass: Float[Array, "n n"]) -> Float[Array, "n n"]:
    """W with W W^T the inverse; shapes without mass are left at rest."""
    mass = mass + jnp.diag(jnp.where(jnp.diagonal(mass) == 0, mass[0, 0], 0.0))
    return linear_algebra.inverse_root(mass)
