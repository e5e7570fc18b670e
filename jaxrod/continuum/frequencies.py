"""Frequencies of axial vibration, at rest and in a steady spin, and how far the spin stretches the rod.

In a spin of rate W the points at x (from the pivot, in flight from the centre of mass) rest at y with
y = x + W^2 F F^T y in mass-weighted numbers.
"""

from typing import Any

import jax.numpy as jnp
from jaxtyping import Array, Float

from ..core import precision, progress, tracing, validation
from ..core.linear_algebra import inverse_root, singular_values
from ..core.units import Number
from ..motions.stiffening import warn_of_forces
from ..rods.rod import Rod
from .compliance import AxialCompliance, axial, linear_support, order_for, support

_MOST = 2000  # frequencies of a rod: they take half a minute, and four times as long for each doubling


def natural_frequencies(system: Any, n: int) -> Float[Array, " n"]:
    """The first n axial natural frequencies of the exact rod in Hz, ascending, held as the system's motion holds it.

    Unstressed, without spin, gravity and forces; to 1e-10 or better.  A pivot inside the rod holds both its parts: the
    frequencies are those of the two together.  In flight the rod is free at both ends.  Differentiable in every number
    of the rod and in the pivot, forward and reverse, where frequencies coincide too; by a pivot on a break where rigidity or
    mass per length jump it is NaN.

    **Raises:** `ValueError` for a `Lumped` body and for n that is not a whole number >= 1.  **Warns** of forces that change
    the axial stiffness, such as a spring at the tip, but not under `jit`, `vmap` or `grad`; `jaxrod.modes` takes them.

    >>> import jaxrod
    >>> cone = jaxrod.Rod(length=1.0, section=jaxrod.Cone(0.02, 0.03), young=1e7, density=1200.0)
    >>> print(jaxrod.continuum.natural_frequencies(jaxrod.System(cone, jaxrod.Rotation()), 2).round(3))
    [19.239 67.424]
    """
    rod, pivot, free = support(system)
    n = validation.count("n", n, 1, "frequencies", _MOST)
    precision.warn_if_lowered(precision.float_type(system), system, ())
    warn_of_forces("continuum.natural_frequencies", system)
    with progress.line("continuum.natural_frequencies"):
        return _natural(rod, pivot, free, n, order_for(rod, pivot, n)) / (2 * jnp.pi)


def critical_rate(system: Any) -> Float[Array, ""]:
    """Rate of spin in rad/s at which a rod driven steadily would stretch without bound: the first natural frequency.

    Forces are left out, and warned of as by `natural_frequencies`.
    """
    rod, pivot, free = support(system)
    warn_of_forces("continuum.critical_rate", system)
    with progress.line("continuum.critical_rate"):
        return _natural(rod, pivot, free, 1, order_for(rod, pivot, 1))[0]


def spinning_frequencies(system: Any, rate: Number, n: int, *, free: bool = False) -> Float[Array, " n"]:
    """The first n axial frequencies in Hz of small vibrations about a steady spin of `rate` (rad/s), without gravity.

    Forces are left out, and warned of as by `natural_frequencies`.

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
    rod, pivot, flying = linear_support(system)
    n = validation.count("n", n, 1, "frequencies", _MOST)
    validation.switch("free", free)
    warn_of_forces("continuum.spinning_frequencies", system)
    rate, order = validation.number("rate", rate, unit="rad/s"), order_for(rod, pivot, n)
    if free:
        return _spinning(rod, pivot, flying, rate, n, order) / (2 * jnp.pi)
    square = _natural(rod, pivot, flying, n, order) ** 2 - rate**2
    stable = square > 0
    return jnp.where(stable, jnp.sqrt(jnp.where(stable, square, 1.0)), jnp.nan) / (2 * jnp.pi)


def steady_spin(system: Any, rate: Number) -> Float[Array, ""]:
    """Displacement of the tip in m at a steady spin `rate` (rad/s) about the pivot, without gravity and forces.

    In flight: about the centre of mass and away from it.  Grows without bound as the rate nears the critical one; NaN
    beyond.  Uniform rod held at its root: (tan K / K - 1) length, with K = rate length / sqrt(E / rho).  Hooke's law.

    **Raises:** `ValueError` for a `Lumped` body, and for another strain law than Hooke's.

    >>> import jaxrod
    >>> cone = jaxrod.Rod(length=1.0, section=jaxrod.Cone(0.02, 0.03), young=1e7, density=1200.0)
    >>> print(f"{jaxrod.continuum.steady_spin(jaxrod.System(cone, jaxrod.Rotation()), 15.0):.6f} m")
    0.012566 m
    """
    rod, pivot, flying = linear_support(system)
    warn_of_forces("continuum.steady_spin", system)
    return _steady_tip(rod, pivot, flying, validation.number("rate", rate, unit="rad/s"), order_for(rod, pivot, 1))


@tracing.run_seldom
def _natural(rod: Rod, pivot: Any, free: bool, n: int, order: int) -> Float[Array, " n"]:
    # The parts of a rod held inside are taken one by one: where their frequencies coincide each keeps its own derivative.
    sigma = [singular_values(side, n) for side in axial(rod, pivot, free, order).sides]
    return 1 / -jnp.sort(-jnp.concatenate(sigma))[:n]


def at_rest_in_spin(held: AxialCompliance, rate: Float[Array, ""]) -> Float[Array, " M"]:
    """Where the points rest in a steady spin, mass-weighted; NaN at and beyond the critical rate (Cholesky fails)."""
    F = held.F
    square = jnp.eye(F.shape[0], dtype=F.dtype) - rate**2 * (F @ F.T)
    root = inverse_root(square)
    return root @ (root.T @ held.lever)


@tracing.run_seldom
def _steady_tip(rod: Rod, pivot: Any, free: bool, rate: Float[Array, ""], order: int) -> Float[Array, ""]:
    held = axial(rod, pivot, free, order)
    return rate**2 * (held.tip @ (held.F.T @ at_rest_in_spin(held, rate)))


@tracing.run_seldom
def _spinning(rod: Rod, pivot: Any, free: bool, rate: Float[Array, ""], n: int, order: int) -> Float[Array, " n"]:
    """K - W^2 + 4 W^2 Y Y^T / J in the forces p, u = F p: (1 - W^2 F^T F + ...) p = omega^2 F^T F p, and no inverse of F."""
    held = axial(rod, pivot, free, order)
    F, y = held.F, at_rest_in_spin(held, rate)
    inertia = y @ y if rod.tip_inertia is None else y @ y + rod.tip_inertia
    pull = F.T @ y
    square = jnp.eye(F.shape[1], dtype=F.dtype) - rate**2 * (F.T @ F)
    square = square + 4 * rate**2 / inertia * (pull[:, None] * pull[None, :])
    return 1 / singular_values(inverse_root(square).T @ F.T, n)
