"""The exact rod: longitudinal waves rho A u_tt = (E A u_x)_x, solved in closed form for cones.

With w = radius * u a cone obeys the plain wave equation; omega = kappa sqrt(E / rho) / length with, for radii r at the
held end and R at the free one (uniform rod: r = R),

    held - free:    kappa cot kappa = 1 - r / R
    free - free:    (kappa^2 + d) sin kappa = kappa d cos kappa,   d = (R - r)^2 / (R r)

Shares no code with the strain bases; of this library it reads the rod and how it is held.
"""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jaxtyping import Array, Float

from . import checks
from .rod import Rod
from .section import Cone, Uniform


def natural_frequencies(system: Any, n: int) -> Float[Array, " n"]:
    """The first n axial natural frequencies of the exact rod in Hz, ascending, held as the system's motion holds it.

    A pivot inside the rod holds both its parts: the frequencies are those of the two together.  Differentiable in
    every number of the rod, forward and reverse.

    **Raises:** `ValueError` for sections other than `Uniform` and `Cone`.

    >>> import jaxrod
    >>> cone = jaxrod.Rod(length=1.0, section=jaxrod.Cone(0.02, 0.03), young=1e7, density=1200.0)
    >>> print(jaxrod.continuum.natural_frequencies(jaxrod.System(cone, jaxrod.Rotation()), 2).round(3))
    [19.239 67.424]
    """
    rod = system.rod
    root, tip = _radii(rod)
    pivot = getattr(system.motion, "pivot", None)
    if pivot is None:
        kappa = free_free(root, tip, n) / rod.length
    else:
        held = root + (tip - root) * pivot / rod.length
        # A piece of no length would have infinite frequencies: give it a harmless length, then leave it out.
        pieces = [
            jnp.where(reach > 0, held_free(held, end, n) / jnp.where(reach > 0, reach, 1.0), jnp.inf)
            for reach, end in ((rod.length - pivot, tip), (pivot, root))
        ]
        kappa = jnp.sort(jnp.concatenate(pieces))[:n]
    return kappa * rod.wave_speed / (2 * jnp.pi)


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
    """
    rod = _held_at_root(system)
    root, tip = _radii(rod)
    kappa = held_free(root, tip, n)
    x, w = np.polynomial.legendre.leggauss(2 * n)
    x, w = jnp.asarray((x + 1) / 2), jnp.asarray(w / 2)
    radius = root + (tip - root) * x
    mode = jnp.sin(kappa[:, None] * x[None, :])  # radius * u
    weight = (mode @ (w * radius * x)) / (mode**2 @ w)
    omega = kappa * rod.wave_speed / rod.length
    return strain * rod.length / tip * (weight * jnp.sin(kappa)) @ jnp.cos(omega[:, None] * ts[None, :])


def steady_spin(system: Any, rate: Float[Array, ""]) -> Float[Array, ""]:
    """Displacement of the tip in m at a steady, prescribed spin `rate` (rad/s) about the root, without gravity.

    Grows without bound as the rate nears the first natural frequency.  Uniform rod: (tan K / K - 1) length, with
    K = rate length / sqrt(E / rho).
    """
    rod = _held_at_root(system)
    root, tip = _radii(rod)
    slope, k = tip - root, rate * rod.length / rod.wave_speed
    # w = radius u solves w'' + K^2 w = -K^2 s radius;  w(0) = 0,  radius w' = slope w at the tip.
    part = -tip + 2 * slope / k**2 * (1 - jnp.cos(k))
    part_slope = -root - 2 * slope + 2 * slope / k * jnp.sin(k)
    sine = (slope * part - tip * part_slope) / (tip * k * jnp.cos(k) - slope * jnp.sin(k))
    return rod.length * (part + sine * jnp.sin(k)) / tip


def _held_at_root(system: Any) -> Rod:
    pivot = getattr(system.motion, "pivot", None)
    if pivot is None or checks.fails(lambda s: s == 0, pivot):
        raise ValueError(
            f"motion={type(system.motion).__name__}: this closed form is of a rod held at its root; take Rotation()."
        )
    return system.rod


def _radii(rod: Rod) -> tuple[Float[Array, ""], Float[Array, ""]]:
    match getattr(rod, "section", None):
        case Uniform(radius=radius):
            return radius, radius
        case Cone(root_radius=root, tip_radius=tip):
            return root, tip
        case section:
            kind = type(rod if section is None else section).__name__
            raise ValueError(f"exact frequencies need section=Uniform(...) or Cone(...), not {kind}.")


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
