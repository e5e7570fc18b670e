"""How the rod is held, and what it gives way to axial forces there.

From the point that is held, displacement is u = C (N / EA) and tension N = C* (rho A omega^2 u), where C integrates
from that point.  On Gauss-Legendre nodes C is a matrix, exact for the polynomials of each panel, and with

    F = (rho A ds)^1/2  C  (ds / EA)^1/2

(one more row for the body at the tip) the frequencies are omega = 1 / singular values of F.  In flight the mean of u is
taken out of F.  A pivot inside the rod holds two parts that know nothing of each other.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..core import tracing, validation
from ..rods.lumped import Lumped
from ..rods.rod import Rod
from .mesh import Mesh, panel_ends, safe_sqrt


def support(system: Any) -> tuple[Rod, Float[Array, ""] | None, bool]:
    """The rod, its pivot (m from the root; None: the root itself, or none in flight), and whether it is in flight."""
    rod = getattr(system, "rod", None)
    if rod is None:
        raise ValueError(f"system={validation.given(system)} is no scene; give a System(rod, motion, basis).")
    if isinstance(rod, Lumped):
        raise ValueError("rod=Lumped(...) has no length of material to vibrate; give a Rod(length, section, ...).")
    pivot = system.motion.pivot
    if pivot is not None and validation.fails(lambda s: s != 0, pivot):
        pivot = None
    pivot = None if pivot is None else rod.held_at(pivot)
    return rod, pivot, system.motion.flies


def linear_support(system: Any) -> tuple[Rod, Float[Array, ""] | None, bool]:
    rod, pivot, free = support(system)
    if not rod.linear:
        raise ValueError(f"law={rod.law_name}: the exact steady spin is of Hooke's law; leave out law=.")
    return rod, pivot, free


def order_for(rod: Rod, pivot: Any, n: int) -> int:
    """Nodes for each panel that resolve the first n modes, and the section.

    A wave needs about pi nodes for its length.  Where the rod is not known yet, one panel may hold all the waves.
    """
    if isinstance(n, bool) or not isinstance(n, int | np.integer) or n < 0:
        raise ValueError(f"n={validation.given(n)} must be a whole number of frequencies, 0 or more.")
    ends, s, time = _travel(rod, pivot)
    share = 1.0
    if tracing.known(ends) and tracing.known(time) and np.all(np.isfinite(ends)):
        by_panel, _ = np.histogram(np.asarray(s), np.asarray(ends), weights=np.asarray(time))
        share = float(by_panel.max() / by_panel.sum())
    needed = rod.resolution.order - 4 + 48 / (ends.size - 1) + 1.7 * n * share
    return 4 * int(np.ceil(needed / 4))  # few different orders: each is a compilation


@tracing.at_once
def _travel(rod: Rod, pivot: Any):
    """Ends of the panels; points along the rod and the time in s a wave takes past each."""
    s, ds = rod.quadrature()
    ends = panel_ends(rod, [] if pivot is None else [pivot])
    return ends, s, ds * jnp.sqrt(rod.mass_density(s) / rod.modulus(s))


class AxialCompliance(NamedTuple):
    """F and its nodes; the lever x (m) of its rows, mass-weighted; the tip's displacement (m) for its columns.

    `sides` is F part by part, where a pivot holds two.
    """

    mesh: Mesh
    F: Float[Array, "M N"]
    lever: Float[Array, " M"]
    tip: Float[Array, " N"]
    sides: Float[Array, "parts M N"]


def axial(rod: Rod, pivot: Any, free: bool, order: int) -> AxialCompliance:
    """The compliance of this rod to axial forces on `order` nodes for each panel, supported as `support` says."""
    # In flight any point will do to measure from; from the centre of mass nothing large cancels.
    start = jax.lax.stop_gradient(rod.center_of_mass) if free else pivot
    grid = Mesh.of(rod, [] if start is None else [start], order)
    weight, reach = safe_sqrt(grid.mass), grid.reach(start)
    if free:
        share = grid.mass / jnp.sum(grid.mass)
        reach = reach - (share @ reach[: share.size])[None, :]
        lever = grid.s_mass - share @ grid.s_mass
    else:
        lever = grid.s_mass if pivot is None else grid.s_mass - pivot
    compliance = safe_sqrt(grid.ds / (rod.modulus(grid.s) * rod.area(grid.s)))
    F = weight[:, None] * reach[: weight.size] * compliance[None, :]
    if free or pivot is None:
        sides = F[None]
    else:
        far = (grid.s > pivot)[None, :]
        sides = jnp.stack([jnp.where(far, F, 0.0), jnp.where(far, 0.0, F)])
    return AxialCompliance(grid, F, weight * lever, reach[-1] * compliance, sides)
