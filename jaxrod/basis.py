"""The ladder of strain approximations: a basis turns a rod into three small arrays.

Deformed position along the director: x(s, t) = phi_0(s) + sum_k a_k(t) phi_k(s), phi_0 = s - s_p, measured from the
pivot s_p (in flight from the centre of mass).  With z = (1, a):

    M_kl = int rho A phi_k phi_l ds     K_kl = int E A phi_k' phi_l' ds     p_k = int rho A phi_k ds
"""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from .rod import Lumped, Rod


class Projection(eqx.Module):
    """The rod as its basis sees it: M (n+1, n+1) in kg m^2, K (n, n) in N m, p (n+1,) in kg m."""

    mass_matrix: Float[Array, "n+1 n+1"]
    stiffness_matrix: Float[Array, "n n"]
    first_moments: Float[Array, " n+1"]

    @property
    def strain_mass(self) -> Float[Array, "n n"]:
        """M_aa: the part of the mass matrix that belongs to the strain amplitudes."""
        return self.mass_matrix[1:, 1:]

    def inertia(self, amplitudes: Float[Array, "*batch n"]) -> Float[Array, "*batch"]:
        """Moment of inertia of the stretched rod, z^T M z, in kg m^2."""
        z = _with_one(amplitudes)
        return jnp.einsum("...k,kl,...l->...", z, self.mass_matrix, z)

    def moment(self, amplitudes: Float[Array, "*batch n"]) -> Float[Array, "*batch"]:
        """First moment of the stretched rod, p^T z, in kg m."""
        return _with_one(amplitudes) @ self.first_moments


class Ritz(eqx.Module):
    """Strain by n polynomial shapes.  `Ritz(0)` is the rigid rod, `Ritz(1)` the paper's uniform strain (2).

    With uniform strain phi_1 = phi_0: the amplitude a_1 is the paper's epsilon, elongation over length.

    **Arguments:** `n`, 0 or 1.

    **Raises:** `ValueError` for another n.

    >>> import jaxrod
    >>> cone = jaxrod.Rod(length=1.0, section=jaxrod.Cone(0.02, 0.03), young=1e7, density=1200.0)
    >>> print(jaxrod.Ritz(1).project(cone, about=0.0).stiffness_matrix.shape)
    (1, 1)
    """

    n: int = eqx.field(static=True)

    def __check_init__(self):
        if type(self.n) is not int or self.n not in (0, 1):
            raise ValueError(f"Ritz(n={self.n}) is not available; take Ritz(0) (rigid) or Ritz(1) (uniform strain).")

    def shapes(self, s: Float[Array, "*points"], about: Float[Array, ""]) -> Float[Array, "n+1 *points"]:
        """phi_0 .. phi_n in m at the material coordinates s (m)."""
        return jnp.stack([s - about] * (self.n + 1))

    def strains(self, s: Float[Array, "*points"]) -> Float[Array, "n *points"]:
        """phi_1' .. phi_n' at the material coordinates s (m)."""
        return jnp.ones((self.n, *jnp.shape(s)), dtype=jnp.result_type(s))

    def project(self, rod: Rod | Lumped, about: Float[Array, ""] | float) -> Projection:
        """M, K and p of a rod about the material coordinate `about` (m): its pivot, or its centre of mass."""
        if isinstance(rod, Lumped):
            ones = jnp.ones(self.n + 1, dtype=rod.inertia.dtype)
            return Projection(
                rod.inertia * jnp.outer(ones, ones),
                rod.stiffness * jnp.outer(ones, ones)[1:, 1:],
                rod.first_moment * ones,
            )
        s, _ = rod.quadrature()
        phi, strain = self.shapes(s, jnp.asarray(about)), self.strains(s)
        return Projection(
            rod.density * rod.integrate(phi[:, None] * phi[None, :]),
            rod.young * rod.integrate(strain[:, None] * strain[None, :]),
            rod.density * rod.integrate(phi),
        )


def _with_one(amplitudes: Float[Array, "*batch n"]) -> Float[Array, "*batch n+1"]:
    return jnp.concatenate([jnp.ones_like(amplitudes, shape=(*amplitudes.shape[:-1], 1)), amplitudes], axis=-1)
