"""Cones in closed form: with w = radius * u a cone obeys the plain wave equation."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jaxtyping import Array, Float

from ..core import tracing, validation
from ..rods.quadrature import Panels
from ..rods.rod import Rod
from ..rods.section import Cone, Profile, Uniform
from .compliance import support


def held_free(held: Float[Array, ""], free: Float[Array, ""], n: int) -> Float[Array, " n"]:
    """The first n roots kappa of kappa cot kappa = 1 - held / free: a cone with these end radii.

    One root lies in each interval ((k - 1) pi, k pi], at its end for a pointed tip, where the brackets must not end.

    **Raises:** `ValueError` for radii that are negative, and for n that is not a whole number >= 1.
    """
    held, free = _radii(held=held, free=free)
    return _held_free(held, free, validation.count("n", n, 1, "roots"))


@tracing.run_seldom
def _held_free(held: Float[Array, ""], free: Float[Array, ""], n: int) -> Float[Array, " n"]:
    def equation(kappa, radii):
        held, free = radii
        return free * kappa * jnp.cos(kappa) - (free - held) * jnp.sin(kappa)

    ends = (np.arange(n) + 1) * np.pi + 0.5
    return _roots(equation, held, free, np.concatenate([[0.0], ends])[:n], ends)


def free_free(first: Float[Array, ""], second: Float[Array, ""], n: int) -> Float[Array, " n"]:
    """The first n roots kappa > 0 of (kappa^2 + d) sin kappa = kappa d cos kappa, d = (R - r)^2 / (R r).

    One root lies in each interval (k pi, (k + 1) pi), at its start for the uniform rod.

    **Raises:** `ValueError` for radii that are negative, and for n that is not a whole number >= 1.
    """
    first, second = _radii(first=first, second=second)
    return _free_free(first, second, validation.count("n", n, 1, "roots"))


def _radii(**radii: Any) -> list[Array]:
    return [validation.not_negative(name, radius, "m", "metres") for name, radius in radii.items()]


@tracing.run_seldom
def _free_free(first: Float[Array, ""], second: Float[Array, ""], n: int) -> Float[Array, " n"]:
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
    strain, ts = validation.number("strain", strain), validation.numbers("ts", ts, "times in s", "s")
    return _release(rod, root, tip, strain, ts, validation.count("n", n, 1, "terms"))


@tracing.run_seldom
def _release(rod: Rod, root, tip, strain, ts: Float[Array, " T"], n: int) -> Float[Array, " T"]:
    kappa = _held_free(root, tip, n)
    waves = Panels(jnp.linspace(0.0, 1.0, n // 2 + 2), 16)  # a wave of the highest mode to a panel, or less
    x, w = waves.s, waves.ds
    radius = root + (tip - root) * x
    mode = jnp.sin(kappa[:, None] * x[None, :])  # radius * u
    weight = (mode @ (w * radius * x)) / (mode**2 @ w)
    omega = kappa * rod.wave_speed / rod.length
    return strain * rod.length / tip * (weight * jnp.sin(kappa)) @ jnp.cos(omega[:, None] * ts[None, :])


def _cone_held_at_root(system: Any) -> tuple[Rod, Float[Array, ""], Float[Array, ""]]:
    rod, pivot, free = support(system)
    if free or (pivot is not None and validation.fails(lambda s: s == 0, pivot)):
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
