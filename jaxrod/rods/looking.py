"""Functions of s looked at before they are integrated: known ones once, where the rod is made; traced ones in the program."""

import dataclasses
import warnings
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ..core import precision, tracing, validation
from ..core.tracing import traced
from .quadrature import gauss
from .resolution import ORDER, Resolution, moments, resolve

_BLOCK = 4096  # points that a function is asked for together: always as many, so that it is compiled once
_STANDS = 1e-6  # relative error that fixed panels may have
_SAMPLES = 64  # panels that they are compared with
_STEEP = 1e-3  # of the largest value: what the slope over a panel may be off
_POINT = 1e-8  # of the largest area: no more than a point


def look_along(rod: Any, given: Any) -> Resolution:
    """The panels that resolve the rod's bare functions, as far as they are known; `given`: its length as it was given.

    Of a number that is differentiated the value is known, though it is traced.

    **Warns** where no panels do.
    """
    if not rod.bare:
        return Resolution()
    with jax.ensure_compile_time_eval():
        # Under jit a plain number is traced as soon as it is an array.
        length = given if isinstance(given, int | float | np.number) else jax.lax.stop_gradient(rod.length)
        if not tracing.known(length):
            return Resolution(fixed=True)
        length = float(length)
        known = [_values(part, length, np.zeros(_BLOCK)) is not None for part in rod.parts]
        fixed = any(getattr(part, "bare", False) and not ok for part, ok in zip(rod.parts, known, strict=True))
        if not any(known):
            return Resolution(fixed=fixed)

        def look(s: np.ndarray) -> np.ndarray:
            blocks, ones = np.resize(s, (-(-s.size // _BLOCK), _BLOCK)), np.ones(_BLOCK)
            parts = zip(rod.parts, known, strict=True)
            profiles = [[np.asarray(_values(part, length, s)) if ok else ones for s in blocks] for part, ok in parts]
            area, modulus, density = (np.concatenate(values)[: s.size] for values in profiles)
            check_positive(s, area, modulus, density, length)
            return np.stack(_integrands(s / length, area, modulus, density, pointed))

        pointed = np.zeros(2, bool)
        if known[0]:
            whole = np.resize(np.linspace(0.0, length, 17), _BLOCK)
            area = np.asarray(_values(rod.section, length, whole))[:17]
            pointed = area[[0, -1]] <= _POINT * np.max(area)
        knots = jax.lax.stop_gradient(rod.section.knots(jnp.asarray(length)))
        knots = np.asarray(knots, float) if tracing.known(knots) else np.zeros(0)
        inner = np.concatenate([rod.breaks, knots])
        ends = np.unique(np.concatenate([[0.0, length], inner[(inner > 0) & (inner < length)]]))
        eps = float(jnp.finfo(precision.float_type(rod)).eps)
        found = dataclasses.replace(resolve(look, ends, eps), fixed=fixed)
        panels = np.unique(np.concatenate([ends, found.knots, found.jumps]))
        steep = [_steepest(part, length, panels) for part in rod.parts if getattr(part, "bare", False) and traced(part)]
    for begin, end in filter(None, steep):
        raise ValueError(
            f"section, young or density is so steep between s={begin:.6g} and {end:.6g} m that its derivative by a traced number "
            "would come out wrong; make it less steep, or a jump at a known place: PiecewiseConstant(breaks, "
            "values), or Profile(function, breaks=[...])."
        )
    if found.jumps and rod.deciding:
        raise ValueError(
            f"section, young or density jumps at s={found.jumps[0]:.6g} m, which a traced number decides: its derivative by that "
            "place would come out as zero; give the place as a known number (PiecewiseConstant(breaks, values), or "
            "Profile(function, breaks=[...])) and differentiate by the values."
        )
    if found.error > 1e-10:
        warnings.warn(
            f"section, young or density is not resolved near s={found.place:.4g} m: integrals along the rod may be off by "
            f"{found.error:.1g} of themselves; name the places where they jump or have kinks by Profile(function, "
            "breaks=[...]).",
            stacklevel=5,
        )
    return found


def check_positive(s: Any, area: Any, modulus: Any, density: Any, length: Any) -> None:
    """Refuse, by `ValueError`, what is not positive and finite at one of the points s (m)."""
    for name, values, unit in (
        ("section has area", area, "m^2"),
        ("young is", modulus, "Pa"),
        ("density is", density, "kg/m^3"),
    ):
        if validation.fails(lambda x: (x > 0) & np.isfinite(x), values):
            first = int(np.argmin((np.asarray(values) > 0) & np.isfinite(values)))
            raise ValueError(
                f"{name} {float(values[first]):.3g} {unit} at s={float(s[first]):.4g} m; it must be positive all "
                f"along the rod (0 < s < length={float(length):.4g} m)."
            )


def _values(part: Any, length: float, s: np.ndarray) -> np.ndarray | None:
    """What a part of the rod is at s, or None where it is a number or traced."""
    if not callable(getattr(part, "area", None)):
        return None
    values = jax.lax.stop_gradient(_area(part, jnp.asarray(length), s))
    return np.asarray(values, float) if tracing.known(values) else None


def _steepest(part: Any, length: float, ends: np.ndarray) -> tuple[float, float] | None:
    """Between which ends (m) of panels the slope of a part of the rod is not resolved; None if it is everywhere.

    A number that moves the part along the rod has that slope for derivative.  Its integral over a panel is a difference.
    """
    x, w = gauss(ORDER)
    skin = 1e-9 * np.diff(ends)
    begin, end = ends[:-1] + skin, ends[1:] - skin
    inner = (begin + end)[:, None] / 2 + (end - begin)[:, None] / 2 * x
    points = np.concatenate([begin, end, inner.reshape(-1)])
    values, slopes = (np.asarray(y, float) for y in jax.lax.stop_gradient(_slope(part, jnp.asarray(length), points)))
    risen = values[begin.size : 2 * begin.size] - values[: begin.size]
    off = np.abs(risen - (end - begin) / 2 * (slopes[2 * begin.size :].reshape(inner.shape) @ w))
    worst = int(np.argmax(off))
    return (begin[worst], end[worst]) if off[worst] > _STEEP * np.max(np.abs(values)) else None


@tracing.run_seldom
def _slope(part: Any, length, s):
    return jax.jvp(lambda s: part.area(s, length), (s,), (jnp.ones_like(s),))


@tracing.run_seldom
def _area(part: Any, length, s):
    return part.area(s, length)


def _integrands(x: Any, area: Any, modulus: Any, density: Any, pointed: Any) -> list:
    """What mass, stiffness, compliance and travel time integrate; x = s / length.

    At a pointed end no force acts, and tension falls as the cube of the distance from it, as at the tip of a cone.
    """
    xp = np if isinstance(x, np.ndarray) else jnp
    weight = xp.where(pointed[0], x**6, 1.0) * xp.where(pointed[1], (1 - x) ** 6, 1.0)
    return [density * area, modulus * area, weight / (modulus * area), xp.sqrt(density / modulus)]


@tracing.at_once
def stands(rod: Any, ends: Float[Array, " ends"]) -> Bool[Array, ""]:
    """Whether the integrals on the panels between these ends stand still when each panel is divided."""
    start, half = ends[:-1, None], jnp.diff(ends)[:, None] / 2
    at_ends, dtype = rod.area(jnp.stack([ends[0], ends[-1]])), ends.dtype
    sums, parts = [], max(2, -(-_SAMPLES // (ends.size - 1)))
    for x, weights in (moments(2, ORDER), moments(2, ORDER, parts)):
        s = (start + half * jnp.asarray(1 + x, dtype)[None, :]).reshape(-1)
        area = rod.area(s)
        pointed = at_ends <= _POINT * jnp.max(area)
        values = jnp.stack(_integrands(s / rod.length, area, rod.modulus(s), rod.mass_density(s), pointed))
        values = values.reshape(len(values), -1, x.size) @ jnp.asarray(weights, dtype)
        sums.append(half[None] * values)
    error = jnp.sum(jnp.abs(sums[0] - sums[1]), axis=1) / jnp.sum(sums[1][..., :1], axis=1)
    tolerance = max(_STANDS, 64 * float(jnp.finfo(dtype).eps), 10 * rod.resolution.error)
    return jnp.all(jax.lax.stop_gradient(error) <= tolerance)
