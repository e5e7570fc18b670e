"""The exact rod: longitudinal waves rho A u_tt = (E A u_x)_x of any rod, held anywhere or free.

From the point that is held, displacement is u = C (N / EA) and tension N = C* (rho A omega^2 u), where C integrates
from that point.  On Gauss-Legendre nodes C is a matrix, exact for the polynomials of each panel, and with

    F = (rho A ds)^1/2  C  (ds / EA)^1/2

(one more row for the body at the tip) the frequencies are omega = 1 / singular values of F.  In flight the mean of u is
taken out of F.  A pivot inside the rod holds two parts that know nothing of each other.  In a spin of rate W the points
at x (from the pivot, in flight from the centre of mass) rest at y with y = x + W^2 F F^T y in mass-weighted numbers.

Shares no code with the strain bases; of this library it reads the rod and how it is held.  Cones have closed forms,
`held_free` and `free_free`: with w = radius * u a cone obeys the plain wave equation.
"""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jaxtyping import Array, Float

from . import checks
from .mesh import Mesh, mesh, panel_ends, safe_sqrt
from .rod import Lumped, Rod
from .section import Cone, Profile, Uniform


def natural_frequencies(system: Any, n: int) -> Float[Array, " n"]:
    """The first n axial natural frequencies of the exact rod in Hz, ascending, held as the system's motion holds it.

    Unstressed, without spin and gravity; to 1e-10 or better.  A pivot inside the rod holds both its parts: the
    frequencies are those of the two together.  In flight the rod is free at both ends.  Differentiable in every number
    of the rod and in the pivot, forward and reverse, where frequencies coincide too.

    **Raises:** `ValueError` for a `Lumped` body and for n that is not a whole number >= 0.

    >>> import jaxrod
    >>> cone = jaxrod.Rod(length=1.0, section=jaxrod.Cone(0.02, 0.03), young=1e7, density=1200.0)
    >>> print(jaxrod.continuum.natural_frequencies(jaxrod.System(cone, jaxrod.Rotation()), 2).round(3))
    [19.239 67.424]
    """
    rod, pivot, free = support(system)
    return _natural(rod, pivot, free, n, _order(rod, pivot, n)) / (2 * jnp.pi)


def critical_rate(system: Any) -> Float[Array, ""]:
    """Rate of spin in rad/s at which a rod driven steadily would stretch without bound: the first natural frequency."""
    return 2 * jnp.pi * natural_frequencies(system, 1)[0]


def spinning_frequencies(system: Any, rate: Float[Array, ""], n: int, *, free: bool = False) -> Float[Array, " n"]:
    """The first n axial frequencies in Hz of small vibrations about a steady spin of `rate` (rad/s), without gravity.

    With the rate prescribed, sqrt(omega^2 - rate^2): the first falls to zero at the critical rate.  With `free=True` the
    angular momentum is conserved instead: stretching slows the spin, and that stiffens the rod.  NaN where there is
    no such vibration: prescribed, for a frequency below the rate; free, for all n at and beyond the critical rate, where
    no steady spin exists.  Hooke's law.

    **Raises:** `ValueError` for a `Lumped` body, and for another strain law than Hooke's.

    >>> import jaxrod
    >>> cone = jaxrod.Rod(length=1.0, section=jaxrod.Cone(0.02, 0.03), young=1e7, density=1200.0)
    >>> system = jaxrod.System(cone, jaxrod.Rotation())
    >>> print(jaxrod.continuum.spinning_frequencies(system, 15.0, 2).round(3))
    [19.09  67.381]
    >>> print(jaxrod.continuum.spinning_frequencies(system, 15.0, 2, free=True).round(3))
    [19.665 67.385]
    """
    rod, pivot, flying = _linear_support(system)
    rate, order = checks.number("rate", rate), _order(rod, pivot, n)
    if free:
        return _spinning(rod, pivot, flying, rate, n, order) / (2 * jnp.pi)
    square = _natural(rod, pivot, flying, n, order) ** 2 - rate**2
    stable = square > 0
    return jnp.where(stable, jnp.sqrt(jnp.where(stable, square, 1.0)), jnp.nan) / (2 * jnp.pi)


def steady_spin(system: Any, rate: Float[Array, ""]) -> Float[Array, ""]:
    """Displacement of the tip in m at a steady spin `rate` (rad/s) about the pivot, without gravity.

    In flight: about the centre of mass and away from it.  Grows without bound as the rate nears the critical one; NaN
    beyond.  Uniform rod held at its root: (tan K / K - 1) length, with K = rate length / sqrt(E / rho).  Hooke's law.

    **Raises:** `ValueError` for a `Lumped` body, and for another strain law than Hooke's.

    >>> import jaxrod
    >>> cone = jaxrod.Rod(length=1.0, section=jaxrod.Cone(0.02, 0.03), young=1e7, density=1200.0)
    >>> print(f"{jaxrod.continuum.steady_spin(jaxrod.System(cone, jaxrod.Rotation()), 15.0):.6f} m")
    0.012566 m
    """
    rod, pivot, flying = _linear_support(system)
    return _steady_tip(rod, pivot, flying, checks.number("rate", rate), _order(rod, pivot, 1))


# ---- how the rod is held


def support(system: Any) -> tuple[Rod, Float[Array, ""] | None, bool]:
    """The rod, its pivot (m from the root; None: the root itself, or none in flight), and whether it is in flight."""
    rod = system.rod
    if isinstance(rod, Lumped):
        raise ValueError("rod=Lumped(...) has no length of material to vibrate; give a Rod(length, section, ...).")
    pivot = getattr(system.motion, "pivot", None)
    if pivot is not None and checks.fails(lambda s: s != 0, pivot):
        pivot = None
    return rod, pivot, not hasattr(system.motion, "pivot")


def _linear_support(system: Any) -> tuple[Rod, Float[Array, ""] | None, bool]:
    rod, pivot, free = support(system)
    if not rod.linear:
        raise ValueError(f"law={rod.law_name}: the exact steady spin is of Hooke's law; leave out law=.")
    return rod, pivot, free


# ---- frequencies and shapes


def _order(rod: Rod, pivot: Any, n: int) -> int:
    """Nodes for each panel that resolve the first n modes, and the section.

    A wave needs about pi nodes for its length.  Where the rod is not known yet, one panel may hold all the waves.
    """
    if isinstance(n, bool) or not isinstance(n, int | np.integer) or n < 0:
        raise ValueError(f"n={n!r} must be a whole number of frequencies, 0 or more.")
    ends = panel_ends(rod, [] if pivot is None else [pivot])
    share = 1.0
    if checks.known(ends):
        s, ds = rod.quadrature()
        time = ds * jnp.sqrt(rod.mass_density(s) / rod.modulus(s))
        if checks.known(time):
            by_panel, _ = np.histogram(np.asarray(s), np.asarray(ends), weights=np.asarray(time))
            share = float(by_panel.max() / by_panel.sum())
    needed = 12 + 48 / (ends.size - 1) + 1.7 * n * share
    return 4 * int(np.ceil(needed / 4))  # few different orders: each is a compilation


class Axial(NamedTuple):
    """F and its nodes; the lever x (m) of its rows, mass-weighted; the tip's displacement (m) for its columns.

    `sides` is F part by part, where a pivot holds two.
    """

    mesh: Mesh
    F: Float[Array, "M N"]
    lever: Float[Array, " M"]
    tip: Float[Array, " N"]
    sides: Float[Array, "parts M N"]


def axial(rod: Rod, pivot: Any, free: bool, order: int) -> Axial:
    """The compliance of this rod to axial forces on `order` nodes for each panel, supported as `support` says."""
    # In flight any point will do to measure from; from the centre of mass nothing large cancels.
    start = jax.lax.stop_gradient(rod.center_of_mass) if free else pivot
    grid = mesh(rod, [] if start is None else [start], order)
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
    return Axial(grid, F, weight * lever, reach[-1] * compliance, sides)


@eqx.filter_jit
def _natural(rod: Rod, pivot: Any, free: bool, n: int, order: int) -> Float[Array, " n"]:
    # The parts of a rod held inside are taken one by one: where their frequencies coincide each keeps its own derivative.
    sigma = jnp.linalg.svd(axial(rod, pivot, free, order).sides, compute_uv=False)
    return 1 / -jnp.sort(-sigma.reshape(-1))[:n]


def _steady(held: Axial, rate: Float[Array, ""]) -> Float[Array, " M"]:
    """Where the points rest in a steady spin, mass-weighted; NaN at and beyond the critical rate (Cholesky fails)."""
    F = held.F
    square = jnp.eye(F.shape[0], dtype=F.dtype) - rate**2 * (F @ F.T)
    return jax.scipy.linalg.cho_solve(jax.scipy.linalg.cho_factor(square), held.lever)


@eqx.filter_jit
def _steady_tip(rod: Rod, pivot: Any, free: bool, rate: Float[Array, ""], order: int) -> Float[Array, ""]:
    held = axial(rod, pivot, free, order)
    return rate**2 * (held.tip @ (held.F.T @ _steady(held, rate)))


@eqx.filter_jit
def _spinning(rod: Rod, pivot: Any, free: bool, rate: Float[Array, ""], n: int, order: int) -> Float[Array, " n"]:
    """K - W^2 + 4 W^2 Y Y^T / J in the forces p, u = F p: (1 - W^2 F^T F + ...) p = omega^2 F^T F p, and no inverse of F."""
    held = axial(rod, pivot, free, order)
    F, y = held.F, _steady(held, rate)
    inertia = y @ y if rod.tip_inertia is None else y @ y + rod.tip_inertia
    pull = F.T @ y
    square = jnp.eye(F.shape[1], dtype=F.dtype) - rate**2 * (F.T @ F)
    square = square + 4 * rate**2 / inertia * (pull[:, None] * pull[None, :])
    lower = jnp.linalg.cholesky(square)
    scaled = jax.scipy.linalg.solve_triangular(lower, F.T, lower=True)
    return 1 / jnp.linalg.svd(scaled, compute_uv=False)[:n]


# ---- cones in closed form


@eqx.filter_jit
def held_free(held: Float[Array, ""], free: Float[Array, ""], n: int) -> Float[Array, " n"]:
    """The first n roots kappa of kappa cot kappa = 1 - held / free: a cone with these end radii.

    One root lies in each interval ((k - 1) pi, k pi], at its end for a pointed tip, where the brackets must not end.
    """

    def equation(kappa, radii):
        held, free = radii
        return free * kappa * jnp.cos(kappa) - (free - held) * jnp.sin(kappa)

    ends = (np.arange(n) + 1) * np.pi + 0.5
    return _roots(equation, held, free, np.concatenate([[0.0], ends])[:n], ends)


@eqx.filter_jit
def free_free(first: Float[Array, ""], second: Float[Array, ""], n: int) -> Float[Array, " n"]:
    """The first n roots kappa > 0 of (kappa^2 + d) sin kappa = kappa d cos kappa, d = (R - r)^2 / (R r).

    One root lies in each interval (k pi, (k + 1) pi), at its start for the uniform rod.
    """

    def equation(kappa, radii):
        first, second = radii
        taper = (first - second) ** 2
        return (first * second * kappa**2 + taper) * jnp.sin(kappa) - taper * kappa * jnp.cos(kappa)

    starts = (np.arange(n) + 1) * np.pi - 0.5
    return _roots(equation, first, second, starts, starts + np.pi)


def release(system: Any, strain: Float[Array, ""], ts: Float[Array, " T"], n: int = 200) -> Float[Array, " T"]:
    """Displacement of the tip in m after letting go from uniform strain, the root held: the first n terms of the series.

    `strain` at t = 0, `ts` in s.  The exact motion has kinks; its series converges as 1/n.

    **Raises:** `ValueError` unless the rod is a `Uniform` or `Cone` of one material, held at its root.
    """
    rod, root, tip = _cone_held_at_root(system)
    kappa = held_free(root, tip, n)
    x, w = np.polynomial.legendre.leggauss(2 * n)
    x, w = jnp.asarray((x + 1) / 2), jnp.asarray(w / 2)
    radius = root + (tip - root) * x
    mode = jnp.sin(kappa[:, None] * x[None, :])  # radius * u
    weight = (mode @ (w * radius * x)) / (mode**2 @ w)
    omega = kappa * rod.wave_speed / rod.length
    return strain * rod.length / tip * (weight * jnp.sin(kappa)) @ jnp.cos(omega[:, None] * ts[None, :])


def _cone_held_at_root(system: Any) -> tuple[Rod, Float[Array, ""], Float[Array, ""]]:
    rod, pivot, free = support(system)
    if free or (pivot is not None and checks.fails(lambda s: s == 0, pivot)):
        raise ValueError(
            f"motion={type(system.motion).__name__}: this closed form is of a rod held at its root; take Rotation()."
        )
    if isinstance(rod.young, Profile) or isinstance(rod.density, Profile) or rod.tip_mass is not None:
        raise ValueError(
            "this closed form is of one material and no body at the tip; leave out tip_mass= and profiles."
        )
    match rod.section:
        case Uniform(radius=radius):
            return rod, radius, radius
        case Cone(root_radius=root, tip_radius=tip):
            return rod, root, tip
        case section:
            raise ValueError(
                f"this closed form needs section=Uniform(...) or Cone(...), not section={type(section).__name__}(...)."
            )


def _roots(equation, first, second, starts, ends) -> Float[Array, " n"]:
    """The root of equation(kappa, radii) in each interval (start, end)."""
    # Radii matter by their ratio alone; scaled, the equation is of order one.
    scale = jax.lax.stop_gradient(jnp.maximum(first, second))
    radii = (first / scale, second / scale)
    dtype = jnp.result_type(*radii, float)
    solver = optx.Bisection(rtol=0.0, atol=0.0)  # halve until the interval is one rounding wide
    halvings = jnp.finfo(dtype).nmant + 4

    def root(start, end):
        options = {"lower": start, "upper": end}
        guess = (start + end) / 2
        return optx.root_find(equation, solver, guess, radii, options, max_steps=halvings, throw=False).value

    return jax.vmap(root)(jnp.asarray(starts, dtype), jnp.asarray(ends, dtype))
