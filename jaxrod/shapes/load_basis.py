"""Load-dependent Ritz vectors: strain shapes that the rod's own inertia makes."""

import jax
import jax.numpy as jnp
from jaxtyping import Float

from ..rods.quadrature import Panels
from ..rods.rod import Rod
from .basis import AbstractNodalShapes, lumped_mass, orthonormal, until

_NOTHING = 1e8  # energies of a shape, after over before it was made orthogonal, in squares of rounding


class LoadRitz(AbstractNodalShapes):
    """Strain by n load-dependent Ritz vectors (Wilson, Yuan, Dickens 1982): each the static answer to the one before.

    The first is how the rod stretches under a load like that of a spin, rho A x (1 - x^2 / 3 length^2); the next how it
    stretches under the inertia of that, and so on: a Krylov space.  It knows section, steps, tip mass and support, and
    needs the fewest shapes of all bases for frequencies and for motion that inertia drives (docs/accuracy.md).  Its
    tension ends in zero at a tip without mass: for a `TipForce` take `ForceRitz`.  With a pivot inside, both sides take
    turns.

    **Arguments:** `n`, a whole number >= 0.

    >>> import jaxrod
    >>> rod = jaxrod.Rod(length=1.0, section=jaxrod.Cone(0.02, 0.03), young=1e7, density=1200.0)
    >>> for basis in (jaxrod.Ritz(2), jaxrod.ForceRitz(2), jaxrod.LoadRitz(2)):
    ...     error = jaxrod.frequency_error(jaxrod.System(rod, jaxrod.Rotation(), basis))[0]
    ...     print(f"{error:.5f} %")
    0.00744 %
    0.45235 %
    0.00000 %
    """

    def _strains(self, rod: Rod, panels: Panels, pivot, free: bool, s):
        nodes, points = panels.s.size, jnp.concatenate([panels.s, s])
        if self.n == 0:
            return jnp.zeros((0, points.size), points.dtype)
        compliance = 1 / (rod.modulus(points) * rod.area(points))
        rigidity = panels.ds / compliance[:nodes]
        mass = lumped_mass(rod, panels)
        weight = rod.mass_density(panels.s) * rod.area(panels.s)

        def stretched(phi: Float[jax.Array, " nodes_tip"]) -> Float[jax.Array, " nodes_points"]:
            """Strain under the load rho A phi and, at the tip, its mass times phi: the tension beyond each point over EA."""
            load, tip = (weight * phi[:-1])[None], mass[-1] * phi[-1]
            beyond, below = [panels.remaining(load)[0]], []
            if s.size:
                below = [panels.antiderivative(load, s)[0]]
                beyond.append(load[0] @ panels.ds - below[0])
            beyond = jnp.concatenate(beyond) + tip
            if pivot is not None:
                beyond = jnp.where(points > pivot, beyond, -jnp.concatenate([panels.running(load)[0], *below]))
            return beyond * compliance

        def displaced(strain: Float[jax.Array, " nodes"]) -> Float[jax.Array, " nodes_tip"]:
            strain = strain[None]
            phi = jnp.concatenate([panels.running(strain)[0], strain @ panels.ds]) - until(panels, strain, pivot)
            return phi - phi @ mass / jnp.sum(mass) if free else phi

        def add(carry, k):
            found, chains = carry
            # A side of no length adds nothing but rounding: its shapes stay empty.
            rounding = _NOTHING * float(jnp.finfo(rigidity.dtype).eps) ** 2
            strain = orthonormal(stretched(chains[0]), found, rigidity, least=rounding)
            return (found.at[k].set(strain), jnp.concatenate([chains[1:], displaced(strain[:nodes])[None]])), None

        chains = jnp.stack([displaced(seed) for seed in _seeds(rod, panels, pivot)])
        none = jnp.zeros((self.n, points.size), chains.dtype)
        (shapes, _), _ = jax.lax.scan(add, (none, chains), jnp.arange(self.n))
        mean = shapes[:, :nodes] @ panels.ds / rod.length
        first = shapes[0] / mean[0]
        return jnp.concatenate([first[None], shapes[1:] - mean[1:, None] * first[None, :]])


def _seeds(rod: Rod, panels: Panels, pivot) -> list[Float[jax.Array, " nodes"]]:
    """Strain of the first displacement, x (1 - x^2 / 3 length^2); with a pivot inside, that of the far side too.

    Without the cubic part the even modes of a pointed rod would never appear: a spin does not excite them.
    """
    x = panels.s if pivot is None else panels.s - pivot
    strain = 1 - (x / rod.length) ** 2
    return [strain] if pivot is None else [strain, jnp.where(x > 0, strain, 0.0)]
