"""What the model of a straight rod with axial strain leaves out, in numbers of the rod at hand.

Bending (Euler and Bernoulli, small, of the straight unstressed rod): rho A w_tt = -(E I w_xx)_xx.  Curvature gives the
slope and the slope the deflection, each by the integral C of `continuum`, so the frequencies are 1 / singular values of

    F = (rho A ds)^1/2  C ds C  (ds / EI)^1/2

with the rigid motions that the support allows taken out of F: turning about a hinge; in flight shifting and turning; of
a clamped rod none.  (The body at the tip adds a row for its mass and one for its tip_inertia, which the slope turns.)

Lateral inertia (Rayleigh): stretching thins the rod, and that moves mass sideways, nu r u_x at radius r.
"""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..core import tracing
from ..core.linear_algebra import singular_values, svd
from ..rods.rod import Rod
from .compliance import axial, support
from .mesh import Mesh, safe_sqrt

_NU = 0.5  # Poisson's ratio at its greatest, of rubber: the most that lateral inertia can do
_ORDER = 24  # nodes for each panel


class ModelLimits(eqx.Module):
    """What was left out; it prints itself.

    - `bending_frequencies`: the first two in Hz, straight and unstressed.
    - `axial_frequency`: the first of the exact rod in Hz.
    - `lateral_inertia`: by which part of itself it lowers the axial frequency, at the most.
    - `slenderness`: length over the mean radius of gyration of the section.
    - `support`: "hinged", "free" or "clamped".
    """

    bending_frequencies: Float[Array, " 2"]
    axial_frequency: Float[Array, ""]
    lateral_inertia: Float[Array, ""]
    slenderness: Float[Array, ""]
    support: str = eqx.field(static=True)

    def __str__(self):
        first, second = self.bending_frequencies
        return "\n".join(
            [
                f"bending ({self.support}, straight, unstressed): {first:.4g} and {second:.4g} Hz; the model has none",
                f"axial: {self.axial_frequency:.4g} Hz; lateral inertia lowers it by {100 * self.lateral_inertia:.2g} % "
                f"or less (Poisson's ratio {_NU})",
                f"slenderness {self.slenderness:.3g} (length over radius of gyration)",
            ]
        )


def model_limits(system: Any) -> ModelLimits:
    """Bending, lateral inertia and slenderness of this scene's rod, held as it is held.

    `Rotation` and `Spherical` are a hinge at the pivot, about which the rod turns freely; `Driven` clamps the rod there;
    in `Flight` it is free.  The second moment of area is that of a circle, I = A^2 / (4 pi), unless the section has a
    method `second_moment(s, length)` (m^4, the smaller one).  For lateral inertia, the polar one is taken as 2 I.

    **Raises:** `ValueError` for a `Lumped` body.

    >>> import jaxrod
    >>> cone = jaxrod.Rod(length=1.0, section=jaxrod.Cone(0.02, 0.03), young=1e7, density=1200.0)
    >>> print(jaxrod.model_limits(jaxrod.System(cone, jaxrod.Rotation())))
    bending (hinged, straight, unstressed): 2.557 and 8.82 Hz; the model has none
    axial: 19.24 Hz; lateral inertia lowers it by 0.0057 % or less (Poisson's ratio 0.5)
    slenderness 80 (length over radius of gyration)
    """
    rod, pivot, free = support(system)
    held = "free" if free else "clamped" if system.motion.prescribed else "hinged"
    return _limits(rod, pivot, held)


@tracing.run_seldom
def _limits(rod: Rod, pivot: Any, support: str) -> ModelLimits:
    s, ds = rod.quadrature()
    radius_of_gyration = jnp.sum(ds * jnp.sqrt(_second_moment(rod, s) / rod.area(s))) / rod.length
    axial, lateral = _lateral(rod, pivot, support == "free")
    return ModelLimits(_bending(rod, pivot, support), axial, lateral, rod.length / radius_of_gyration, support)


def _second_moment(rod: Rod, s: Float[Array, " N"]) -> Float[Array, " N"]:
    of_its_own = getattr(rod.section, "second_moment", None)
    return rod.area(s) ** 2 / (4 * jnp.pi) if of_its_own is None else of_its_own(s, rod.length)


def _bending(rod: Rod, pivot: Any, support: str, n: int = 2, order: int = _ORDER) -> Float[Array, " n"]:
    """The first n bending frequencies in Hz."""
    # Rigid motions are taken out later, so the slope may be measured from any point, in flight the deflection too: from
    # the centre of mass little is left to take out.
    center = rod.center_of_mass
    held = center if support == "free" else pivot
    turned = held if support == "clamped" else center
    grid = Mesh.of(rod, [x for x in (held, turned) if x is not None], order)
    compliance = safe_sqrt(grid.ds / (rod.modulus(grid.s) * _second_moment(rod, grid.s)))
    slope = grid.reach(turned)
    # Deflection of the nodes and the tip per curvature at the nodes.
    deflection = (grid.reach(held) * grid.ds[None, :]) @ slope[:-1]
    rows, weight = deflection[: grid.mass.size], safe_sqrt(grid.mass)
    ones, lever = jnp.ones_like(grid.s_mass), grid.s_mass - (0.0 if held is None else held)
    if rod.tip_inertia is not None:
        rows = jnp.concatenate([rows, slope[-1:]])
        weight = jnp.append(weight, safe_sqrt(rod.tip_inertia))
        ones, lever = jnp.append(ones, 0.0), jnp.append(lever, 1.0)
    F = weight[:, None] * rows * compliance[None, :]
    if support == "free":
        F = _without(F, weight * ones)
        share = weight**2 * ones / jnp.sum(weight**2 * ones)
        lever = lever - (share @ lever) * ones
    if support != "clamped":
        F = _without(F, weight * lever)
    return 1 / singular_values(F, n) / (2 * jnp.pi)


def _without(F: Float[Array, "M N"], direction: Float[Array, " M"]) -> Float[Array, "M N"]:
    """F with its columns perpendicular to a direction."""
    unit = direction / jnp.linalg.norm(direction)
    return F - unit[:, None] * (unit @ F)[None, :]


def _lateral(rod: Rod, pivot: Any, free: bool) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """First axial frequency in Hz, and the part by which it is lowered: 1 - (1 + m)^-1/2 by Rayleigh's quotient.

    m = nu^2 int rho I_p u_x^2 ds / int rho A u^2 ds over the first mode u, of which u_x = N / EA.
    """
    grid, F, *_ = axial(rod, pivot, free, _ORDER)
    modes, sigma, _ = svd(F, 1)
    omega, rigidity = 1 / sigma[0], rod.modulus(grid.s) * rod.area(grid.s)
    # F^T mode / sigma are the tensions, weighted by (ds / EA)^1/2: u_x^2 ds is their square over EA.
    strain_square = (modes[:, 0] @ F / sigma[0]) ** 2 * omega**2 / rigidity
    sideways = _NU**2 * jnp.sum(rod.mass_density(grid.s) * 2 * _second_moment(rod, grid.s) * strain_square)
    return omega / (2 * jnp.pi), 1 - 1 / jnp.sqrt(1 + sideways)
