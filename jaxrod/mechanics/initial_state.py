"""States of a scene, from angles, strains and places."""

import warnings
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..core import precision, tracing, validation
from ..motions.state import State, heading

_MANY_RADIANS = 30.0, 1080.0  # between which a multiple of 15 is taken for degrees


def started(
    system: Any, angle, rate, strain, strain_rate, amplitudes, amplitude_rates, azimuth, azimuth_rate, center, center_velocity
) -> State:  # fmt: skip
    """What `System.state` returns."""
    space, flight = system.motion.dimension == 3, system.motion.flies
    for name, value, needed in (
        ("azimuth", azimuth, "Spherical()" if not space else ""),
        ("azimuth_rate", azimuth_rate, "Spherical()" if not space else ""),
        ("center", center, "Flight()" if not flight else ""),
        ("center_velocity", center_velocity, "Flight()" if not flight else ""),
    ):
        if value is not None and needed:
            kind = type(system.motion).__name__
            raise ValueError(
                f"{name}={validation.given(value)} has no meaning for {kind}(); leave it out or take motion={needed}."
            )
    if system.motion.prescribed:
        held = [validation.number("angle", angle, unit="rad"), validation.number("rate", rate, unit="rad/s")]
        if any(validation.fails(lambda x: x == 0, x) for x in held):
            raise ValueError(
                f"angle={validation.brief(angle)}, rate={validation.brief(rate)}: Driven() prescribes the rotation; "
                "leave them out."
            )
        angle, rate, _ = system.motion.turning(0.0)
    numbers = {"angle": angle, "rate": rate}
    if space:
        numbers |= {"azimuth": _or_zero(azimuth), "azimuth_rate": _or_zero(azimuth_rate)}
    given = {name: validation.number(name, x, unit="rad/s" if "rate" in name else "rad") for name, x in numbers.items()}
    _check_degrees({name: given[name] for name in ("angle", "azimuth") if name in given})
    strains = {
        "amplitudes": _amplitudes(system, "strain", strain, "amplitudes", amplitudes, ""),
        "amplitude_rates": _amplitudes(system, "strain_rate", strain_rate, "amplitude_rates", amplitude_rates, "1/s"),
    }
    _check_strain(system, strains["amplitudes"])
    place = {"center": (center, "m"), "center_velocity": (center_velocity, "m/s")} if flight else {}
    place = {name: validation.number(name, _or_zero(x, (0.0, 0.0)), (2,), unit) for name, (x, unit) in place.items()}

    dtype = precision.float_type(system, given, strains, place)
    given, strains, place = jax.tree.map(lambda x: x.astype(dtype), (given, strains, place))
    direction, direction_rate, turns = (_spatial if space else _planar)(given)
    return State(direction, direction_rate, **strains, turns=turns, **place)


def _amplitudes(system: Any, name, uniform, all_name, amplitudes, unit) -> Float[Array, " n"]:
    n, uniform = system.basis.n, validation.number(name, uniform, unit=unit)
    if amplitudes is None:
        if n == 0 and validation.fails(lambda x: x == 0, uniform):
            raise ValueError(f"{name}={validation.shown(uniform)}: Ritz(0) is rigid; take Ritz(1) or leave it out.")
        return _first_alone(uniform, n)
    if validation.fails(lambda x: x == 0, uniform):
        raise ValueError(f"{name}={validation.shown(uniform)} and {all_name}= are both given; leave one out.")
    return validation.number(all_name, amplitudes, (n,), unit)


def _check_degrees(angles: dict[str, Array]) -> None:
    """Warn of an angle that looks like degrees: nobody starts after several turns by a round number of radians."""
    for name, angle in angles.items():
        if validation.fails(
            lambda x: (np.abs(x) < _MANY_RADIANS[0]) | (np.abs(x) > _MANY_RADIANS[1]) | (x % 15 != 0), angle
        ):
            warnings.warn(
                f"{name}={validation.shown(angle)} rad is {float(angle) / (2 * np.pi):.3g} turns; "
                f"if degrees are meant, give {name}=jnp.deg2rad({validation.shown(angle)}).",
                stacklevel=5,
            )


def _check_strain(system: Any, amplitudes):
    if validation.fails(lambda a: a == 0, amplitudes):
        lowest = system.discrete.lowest_strain(amplitudes)
        if validation.fails(lambda strain: strain > -1, lowest):
            raise ValueError(f"strain={float(lowest):.6g} turns the rod inside out; it must be above -1.")


def _or_zero(value, zero: Any = 0.0):
    return zero if value is None else value


@tracing.at_once
def _first_alone(uniform, n: int):
    return jnp.stack([uniform, *[jnp.zeros_like(uniform)] * (n - 1)])[:n]  # keeps a weak type


@tracing.at_once
def _planar(given):
    angle, rate = given["angle"], given["rate"]
    direction = jnp.stack([jnp.cos(angle), jnp.sin(angle)])
    return direction, rate * jnp.stack([-direction[1], direction[0]]), _turns(angle, direction)


@tracing.at_once
def _spatial(given):
    angle, rate, azimuth, azimuth_rate = (given[name] for name in ("angle", "rate", "azimuth", "azimuth_rate"))
    outward = jnp.stack([jnp.cos(azimuth), jnp.sin(azimuth), jnp.zeros_like(azimuth)])
    sideways = jnp.stack([-outward[1], outward[0], outward[2]])
    up = jnp.zeros_like(outward).at[2].set(1.0)
    direction = jnp.cos(angle) * outward + jnp.sin(angle) * up
    elevating = jnp.cos(angle) * up - jnp.sin(angle) * outward
    direction_rate = rate * elevating + azimuth_rate * jnp.cos(angle) * sideways
    return direction, direction_rate, _turns(azimuth, direction)


def _turns(angle, direction):
    """Full turns that an angle has made."""
    return jax.lax.stop_gradient(jnp.round((angle - heading(direction)) / (2 * jnp.pi)))
