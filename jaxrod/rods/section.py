"""Cross-sections, and whatever else varies along the rod.

A profile is a function of the material coordinate s (m, from the root) with `breaks`: the coordinates where it jumps.
"""

import abc
import warnings
from collections.abc import Callable
from typing import Any, ClassVar

import equinox as eqx
import interpax
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..core import calling, tracing, units, validation
from ..core.units import Number, Row

_TAPERS = 8  # quadrature panels of a cone, equal in log radius: 1 / A of a 1 : 1000 taper is smooth on each of them
_ROUND = 1e-6  # of the length: what a table may be short of the rod
_STEEPEST = 1e4  # ratio of radii beyond which a cone counts as pointed


class AbstractSection(eqx.Module):
    """The cross-section along the rod: `area(s, length)` in m^2, and the `breaks` where it jumps."""

    breaks: eqx.AbstractVar[tuple[float, ...]]
    bare: ClassVar[bool] = False  # whether nothing is known of it but its values

    @abc.abstractmethod
    def area(self, s: Float[Array, "*points"], length: Float[Array, ""]) -> Float[Array, "*points"]:
        """Area in m^2 at the material coordinates s (m) of a rod of this length (m)."""

    def knots(self, length: Float[Array, ""]) -> Float[Array, " knots"]:
        """Coordinates in m where a quadrature should pause although nothing jumps."""
        return jnp.zeros(0, length.dtype)

    def valid(self) -> Array:
        """Whether the numbers make a section, beyond a positive area."""
        return jnp.asarray(True)

    def pointed(self, length: Float[Array, ""]) -> Array:
        """Whether the area at an end is nothing beside the largest."""
        area = self.area(jnp.linspace(0.0, 1.0, 17, dtype=length.dtype) * length, length)
        return jnp.any(area[jnp.array([0, -1])] <= jnp.max(area) / _STEEPEST**2)

    def covers(self, length: Float[Array, ""]) -> Array:
        """Whether it is known all along a rod of this length."""
        del length
        return jnp.asarray(True)


class Uniform(AbstractSection):
    """A circular section of constant radius.

    **Arguments:** `radius` in m, positive.

    >>> import jaxrod
    >>> jaxrod.Uniform(radius=0.025)
    Uniform(radius=0.025 m)
    """

    radius: Float[Array, ""]
    breaks: ClassVar[tuple[float, ...]] = ()

    def __init__(self, radius: Number):
        self.radius = validation.positive("Uniform(radius=)", radius, "m")

    def area(self, s: Float[Array, "*points"], length: Float[Array, ""]):
        return jnp.pi * self.radius**2 * jnp.ones_like(s)

    def valid(self):
        return self.radius > 0

    def __repr__(self):
        return validation.written(self, radius="m")


class Cone(AbstractSection):
    """A circular section whose radius goes linearly from root to tip: equation (13) of the paper.

    **Arguments:** `root_radius` (the paper's r, at s = 0) and `tip_radius` (R, at s = length), in m.  One of the two
    may be zero: a pointed rod.

    >>> import jaxrod
    >>> jaxrod.Cone(root_radius=0.02, tip_radius=0.03)
    Cone(root_radius=0.02 m, tip_radius=0.03 m)
    """

    root_radius: Float[Array, ""]
    tip_radius: Float[Array, ""]
    breaks: ClassVar[tuple[float, ...]] = ()

    def __init__(self, root_radius: Number, tip_radius: Number):
        root = validation.not_negative("Cone(root_radius=)", root_radius, "m")
        tip = validation.not_negative("Cone(tip_radius=)", tip_radius, "m")
        if validation.fails(lambda root, tip: (root > 0) | (tip > 0), root, tip):
            raise ValueError("Cone(root_radius=0, tip_radius=0) has no section left; at most one end may be a point.")
        self.root_radius, self.tip_radius = root, tip

    def radius(self, s: Float[Array, "*points"], length: Float[Array, ""]):
        """r(s) = r + (R - r) s / length, in m: equation (13)."""
        return self.root_radius + (self.tip_radius - self.root_radius) * s / length

    def area(self, s: Float[Array, "*points"], length: Float[Array, ""]):
        return jnp.pi * self.radius(s, length) ** 2

    def knots(self, length: Float[Array, ""]):
        # Where log(radius) has gone k / 8 of its way.  For nearly equal radii the way in s itself: nothing to resolve.
        widest = jnp.maximum(self.root_radius, self.tip_radius)
        root, tip = (jnp.maximum(r, widest / _STEEPEST) for r in (self.root_radius, self.tip_radius))
        log_ratio = jnp.log(tip / root)
        part = jnp.arange(1, _TAPERS, dtype=length.dtype) / _TAPERS
        tapered = jnp.abs(log_ratio) > 0.1
        way = jnp.expm1(part * jnp.where(tapered, log_ratio, 1.0)) / jnp.expm1(jnp.where(tapered, log_ratio, 1.0))
        return jax.lax.stop_gradient(length * jnp.where(tapered, way, part))

    def valid(self):
        return (self.root_radius >= 0) & (self.tip_radius >= 0)

    def __repr__(self):
        return validation.written(self, root_radius="m", tip_radius="m")


class Table(AbstractSection):
    """A measured section: areas (or radii of circles) at some points, a monotone cubic through their logarithm.

    The area is positive and has no waves between the points: Fritsch and Carlson (1980).  Beyond the points it is NaN.

    **Arguments:** `positions` in m, increasing, from the root (<= 0) to the tip (>= length); and either `radii` in m or
    `areas` in m^2 there, positive.  Differentiable in all of them.  For a traced length let the table reach beyond the
    tip: a rod that grows longer than its table has frequencies of NaN, and `simulate` ends with `invalid`.

    **Raises:** `ValueError` for positions that do not increase, for a section that is not positive, and, in a `Rod`, for a
    table that does not cover it.

    >>> import jaxrod
    >>> section = jaxrod.Table([0.0, 0.5, 1.0], radii=[0.02, 0.026, 0.03])
    >>> rod = jaxrod.Rod(length=1.0, section=section, young=1e7, density=1200.0)
    >>> print(f"{rod.mass:.3f} kg")
    2.515 kg
    """

    positions: Float[Array, " points"]
    areas: Float[Array, " points"]
    breaks: ClassVar[tuple[float, ...]] = ()

    def __init__(self, positions: Row, radii: Row | None = None, *, areas: Row | None = None):
        if (radii is None) == (areas is None):
            given = "neither" if radii is None else "both"
            raise ValueError(f"Table: {given} of radii= and areas= given; give one of them.")
        self.positions = validation.numbers("Table(positions=)", positions, "two positions in m or more", "m")
        size = self.positions.shape
        name, measured = ("radii", radii) if areas is None else ("areas", areas)
        measured = validation.number(f"Table({name}=)", measured, size, "m" if areas is None else "m^2")
        if size[0] < 2:
            raise ValueError(f"Table(positions=) holds {size[0]} points; give at least two, root and tip.")
        if validation.fails(lambda s: np.diff(s) > 0, self.positions):
            raise ValueError(f"Table(positions={validation.shown(self.positions)}) must increase from root to tip.")
        if validation.fails(lambda x: x > 0, measured):
            first = int(np.argmin(np.asarray(measured) > 0))
            raise ValueError(
                f"Table({name}=) is {float(measured[first]):.3g} at position {float(self.positions[first]):.4g} m; it "
                "must be positive everywhere."
            )
        self.areas = jnp.pi * measured**2 if areas is None else measured

    def area(self, s: Float[Array, "*points"], length: Float[Array, ""]):
        with jax.numpy_rank_promotion("allow"):  # interpax broadcasts freely
            logs = interpax.interp1d(jnp.ravel(s), self.positions, jnp.log(self.areas), method="monotonic", extrap=True)
        known = (s >= self.positions[0] - _ROUND * length) & (s <= self.positions[-1] + _ROUND * length)
        return jnp.where(known, jnp.exp(logs).reshape(jnp.shape(s)), jnp.nan)

    def knots(self, length: Float[Array, ""]):
        return jnp.clip(self.positions, 0.0, length).astype(length.dtype)

    def valid(self):
        return jnp.all(self.areas > 0) & jnp.all(jnp.diff(self.positions) > 0)

    def covers(self, length: Float[Array, ""]):
        return (self.positions[0] <= _ROUND * length) & (self.positions[-1] >= length * (1 - _ROUND))

    def __repr__(self):
        return f"Table({validation.listed(self.positions)} m, areas={validation.listed(self.areas)} m^2)"


class PiecewiseConstant(eqx.Module):
    """A quantity that is constant between `breaks`: an area, a modulus or a density of a stepped or composite rod.

    **Arguments:** `breaks`, increasing coordinates in m where it jumps; `values`, one more than breaks, from root to
    tip.  Differentiable in the values.

    >>> import jaxrod
    >>> area, young = jaxrod.PiecewiseConstant([0.4], [2e-3, 1e-3]), jaxrod.PiecewiseConstant([0.7], [2e11, 7e10])
    >>> rod = jaxrod.Rod(length=1.0, section=area, young=young, density=7800.0)
    >>> print(f"{rod.mass:.3f} kg", rod.breaks)
    10.920 kg (0.4, 0.7)
    """

    values: Float[Array, " pieces"]
    breaks: tuple[float, ...] = eqx.field(static=True)

    def __init__(self, breaks: Row, values: Row):
        self.breaks = _increasing(breaks)
        self.values = validation.number("PiecewiseConstant(values=)", values, (len(self.breaks) + 1,))

    def __call__(self, s: Float[Array, "*points"]) -> Float[Array, "*points"]:
        return self.values[jnp.searchsorted(jnp.asarray(self.breaks, s.dtype), s)]

    def __repr__(self):
        return f"PiecewiseConstant({list(self.breaks)}, {validation.listed(self.values)})"


class Steps(PiecewiseConstant):
    """The name that `PiecewiseConstant` had; it goes with the next release."""

    def __init__(self, breaks: Row, values: Row):
        warnings.warn("jaxrod.Steps is called jaxrod.PiecewiseConstant now.", FutureWarning, stacklevel=4)
        super().__init__(breaks, values)


class Profile(AbstractSection):
    """Any area A(s), given as a function of the material coordinate s in m; `Rod` wraps a bare function in it.

    **Arguments:** `function`, s -> area in m^2 (works on arrays; numbers in an Equinox module are differentiable), and
    `breaks`, the coordinates in m where it jumps or has a kink.

    >>> import jax.numpy as jnp, jaxrod
    >>> rod = jaxrod.Rod(length=1.0, section=lambda s: 1e-3 * jnp.exp(-s), young=1e7, density=1200.0)
    >>> print(f"{rod.mass:.6f} kg")
    0.758545 kg
    """

    function: Any
    breaks: tuple[float, ...] = eqx.field(static=True)

    def __init__(self, function: Callable[..., Any], breaks: Row = ()):
        if not callable(function):
            raise ValueError(
                f"section={validation.given(function)} is not a section; give Uniform, Cone, Table or a function of s."
            )
        self.function = tracing.carried(function)
        self.breaks = _increasing(breaks)

    @property
    def bare(self) -> bool:
        return not (isinstance(self.function, PiecewiseConstant) and set(self.function.breaks) <= set(self.breaks))

    def __repr__(self):
        if isinstance(self.function, PiecewiseConstant):
            return repr(self.function)
        breaks = f", {list(self.breaks)}" if self.breaks else ""
        return f"Profile({validation.given(self.function)}{breaks})"

    def __call__(self, s: Float[Array, "*points"]) -> Float[Array, "*points"]:
        return jnp.broadcast_to(calling.real(self.function(s)), jnp.shape(s))

    def area(self, s: Float[Array, "*points"], length: Float[Array, ""]):
        del length
        return self(s)


def profile(name: str, value: Any, unit: str, what: str | None = None) -> Any:
    """A positive number, or a function of s with its breaks."""
    if isinstance(value, Profile):
        return value
    if callable(value):
        return Profile(value, getattr(value, "breaks", ()))
    return validation.positive(name, value, unit, what)


def _increasing(breaks) -> tuple[float, ...]:
    breaks = units.in_unit("breaks", breaks, "m")
    try:
        if isinstance(breaks, str | dict | set):
            raise TypeError
        breaks = tuple(float(s) for s in breaks)
    except (TypeError, ValueError):  # a tracer, too: how many pieces there are must be known
        raise ValueError(
            f"breaks={validation.given(breaks)} must be a sequence of numbers in m, known and not traced."
        ) from None
    if not np.all(np.isfinite(breaks)):
        raise ValueError(f"breaks={breaks} must be finite numbers in m.")
    if list(breaks) != sorted(set(breaks)):
        raise ValueError(f"breaks={breaks} must increase from root to tip.")
    return breaks
