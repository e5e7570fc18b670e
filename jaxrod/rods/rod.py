"""The rod: a straight elastic bar of given length, cross-section, Young's modulus and density.

Material coordinate s runs from the root (s = 0, the paper's radius r) to the tip (s = length).  Units are SI.
Every number is a leaf of a pytree: a gradient can be taken in each.
"""

import warnings
from collections.abc import Callable, Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ..core import calling, precision, tracing, validation
from ..core.tracing import deciding
from ..core.units import Number
from . import plausibility
from .law import hooke
from .looking import check_positive, look_along, stands
from .quadrature import Panels
from .resolution import FIXED, ORDER, Resolution
from .section import AbstractSection, Cone, Profile, Table, Uniform, profile


class Rod(eqx.Module):
    """A thin straight rod.

    **Arguments:**

    - `length`: unstretched length in m (the paper's l0).
    - `section`: `Uniform`, `Cone`, `Table`, `PiecewiseConstant`, or any function s -> area in m^2.
    - `young`: Young's modulus E in Pa; a number, or a function of s such as `PiecewiseConstant` or `Profile`.
    - `density`: rho in kg/m^3; likewise.
    - `tip_mass`: mass in kg of a body at the tip, or None; `tip_inertia`: its moment of inertia in kg m^2 about its own
      centre, or None for a point.
    - `law`: strain energy over E as a function of strain, such as `jaxrod.law.neo_hookean`; Hooke's law if left out.

    A bare function of s is looked at, 4096 points on each piece between its breaks, and panels of quadrature are refined
    until mass, inertia, stiffness, compliance and frequencies stand still; jumps and kinks are found.  Where the function
    or the length is traced (but for a derivative alone) nothing can be refined: eight panels are taken, and where they are
    wrong by 1e-6 or more all integrals and frequencies are NaN, and runs end `invalid`.

    **Raises:** `ValueError` for a number that is not positive and finite, for a section, modulus or density that vanishes
    inside the rod, and for a jump in a function whose place is differentiated (under `jit` that derivative is NaN).
    **Warns** where no panels resolve a function: `breaks=` of `Profile` helps; and when `young` and `density` are of no
    solid and of no consistent system of units, or the rod weighs more than 1e8 kg, naming the unit that would explain it.

    >>> import jaxrod
    >>> rod = jaxrod.Rod(length=1.0, section=jaxrod.Cone(0.02, 0.03), young=1e7, density=1200.0)
    >>> print(f"{rod.mass:.5f} kg, {rod.center_of_mass:.5f} m")
    2.38761 kg, 0.56579 m
    """

    length: Float[Array, ""]
    section: AbstractSection
    young: Float[Array, ""] | Profile
    density: Float[Array, ""] | Profile
    tip_mass: Float[Array, ""] | None
    tip_inertia: Float[Array, ""] | None
    law: Any
    resolution: Resolution = eqx.field(static=True, init=False, repr=False)

    def __init__(
        self,
        length: Number,
        section: AbstractSection | Callable[..., Any],
        young: Number | Callable[..., Any],
        density: Number | Callable[..., Any],
        tip_mass: Number | None = None,
        tip_inertia: Number | None = None,
        law: Callable[..., Any] = hooke,
    ):
        self.length = validation.positive("length", length, "m")
        self.young = profile("young", young, "Pa", "pascals (rubber about 1e7, steel 2e11)")
        self.density = profile("density", density, "kg/m^3")
        self.tip_mass = None if tip_mass is None else validation.not_negative("tip_mass", tip_mass, "kg", "kg, or None")
        if tip_inertia is not None and tip_mass is None:
            raise ValueError(
                f"tip_inertia={validation.given(tip_inertia)} belongs to a body at the tip; give tip_mass= too."
            )
        self.tip_inertia = (
            None
            if tip_inertia is None
            else validation.not_negative("tip_inertia", tip_inertia, "kg m^2", "kg m^2, or None")
        )
        if not callable(law):
            raise ValueError(
                f"law={validation.given(law)} is not a strain law; give a function of strain such as jaxrod.law.green."
            )
        self.law = tracing.carried(law)
        self.section = (
            section if isinstance(section, AbstractSection) else Profile(section, getattr(section, "breaks", ()))
        )
        self.resolution = Resolution()
        self._check_functions()
        self._check_breaks()
        self.resolution = look_along(self, length)
        self._check_profiles()
        self._check_size()
        self._check_law()

    def _check_functions(self):
        s, shapes = calling.like(3), [(3,), (1,), ()]
        for name, value, unit in (
            ("section", self.section, "m^2"),
            ("young", self.young, "Pa"),
            ("density", self.density, "kg/m^3"),
        ):
            if isinstance(value, Profile):
                calling.tried(f"{name}=", f"of an array s (m) -> {unit}", value.function, s, shapes=shapes)
            elif isinstance(value, AbstractSection) and not isinstance(value, Uniform | Cone | Table):
                calling.tried(
                    f"{name}=", "area of arrays s, length (m) -> m^2", value.area, s, self.length, shapes=shapes
                )

    def _check_breaks(self):
        outside = [s for s in self.breaks if validation.fails(lambda length, s=s: 0 < s < length, self.length)]
        if outside:
            raise ValueError(
                f"breaks hold {outside[0]:.6g} m, outside of 0 < s < length={validation.shown(self.length)} m."
            )

    def _check_profiles(self):
        s, area, modulus, density, covers = _profiles(self)
        if validation.fails(lambda covers: covers, covers):
            positions = validation.shown(getattr(self.section, "positions", ()))
            raise ValueError(
                f"Table(positions={positions}) must reach from 0 to length={validation.shown(self.length)} m."
            )
        if all(map(tracing.known, (s, area, modulus, density, self.length))):
            check_positive(s, area, modulus, density, self.length)
            s, area, modulus, density = (np.asarray(x, float) for x in (s, area, modulus, density))
            for doubt in (
                plausibility.material(modulus, density),
                plausibility.mass(float(self.length), s, area, density),
            ):
                if doubt:
                    warnings.warn(doubt, stacklevel=6)

    def _check_size(self):
        """What squares, or the numbers' type, would lose."""
        _, *profiles, _ = _profiles(self)
        if not all(map(tracing.known, (self.length, *profiles))):
            return
        length = np.float64(self.length)
        area, modulus, density = (np.max(np.asarray(x, float)) for x in profiles)
        limits = np.finfo(self.length.dtype)
        with np.errstate(all="ignore"):
            inertia, stiffness = density * area * length**3, modulus * area * length
        if not all(limits.tiny < x < limits.max for x in (inertia, stiffness)):
            raise ValueError(
                f"length={length:.3g} m with areas up to {area:.3g} m^2 has an inertia or stiffness beyond {limits.dtype}; give "
                "both in metres."
            )

    def _check_law(self):
        if self.linear:
            return

        def slope(strain):
            return jax.jvp(self.law, (strain,), (jnp.ones_like(strain),))

        rest = jnp.zeros(2)
        wanted = "of an array of strains -> one energy over Young's modulus for each"
        calling.tried(f"law={self.law_name}", wanted, self.law, rest, shapes=[rest.shape])
        (energy, stress), (_, stiffness) = jax.jvp(slope, (rest,), (jnp.ones_like(rest),))
        for name, value, wanted in (("W", energy, 0.0), ("W'", stress, 0.0), ("W''", stiffness, 1.0)):
            if validation.fails(lambda x, wanted=wanted: np.abs(x - wanted) < 1e-3, value):
                raise ValueError(
                    f"law={self.law_name} has {name}(0) = {float(value[0]):.4g} but must have {wanted:g}: it is energy "
                    "over Young's modulus, strain^2 / 2 where strain is small."
                )

    @property
    def law_name(self) -> str:
        """The strain law's name, for messages."""
        return getattr(getattr(self.law, "func", self.law), "__name__", repr(self.law))

    # ---- along the rod

    @property
    def linear(self) -> bool:
        """Whether the strain law is Hooke's."""
        return getattr(self.law, "func", None) is hooke

    @property
    def breaks(self) -> tuple[float, ...]:
        """Where section, modulus or density jump: coordinates in m, increasing."""
        given = (s for x in self.parts for s in getattr(x, "breaks", ()))
        return tuple(sorted({*given, *self.resolution.jumps}))

    @property
    def parts(self) -> tuple[AbstractSection, Any, Any]:
        """Section, modulus and density: what may be a function of s."""
        return self.section, self.young, self.density

    @property
    def bare(self) -> bool:
        """Whether one of them is a function of which nothing is known but its values."""
        return any(getattr(x, "bare", False) for x in self.parts)

    def held_at(self, s: Float[Array, ""], ends: bool = False, breaks: bool = False) -> Float[Array, ""]:
        """s (m) where a support is.  Derivatives by it are NaN at a break where rigidity or mass per length jump.

        Likewise at the `ends` of the rod, and at all `breaks`, for who has none there.
        """
        length, eps = self.length, float(jnp.finfo(self.length.dtype).eps)
        kinks = jnp.asarray(self.breaks, length.dtype)
        near = jnp.abs(kinks - s) <= max(1e-9, 8 * eps) * length
        near = near if breaks or not self.breaks else near & self._jumping()
        undefined = jnp.any(near) | ((s <= 0) | (s >= length) if ends else jnp.asarray(False))
        return tracing.no_derivative(s, undefined) if self.breaks or ends else s

    def _jumping(self) -> Bool[Array, " breaks"]:
        """Whether rigidity or mass per length jump at the breaks, or have but a kink there."""
        eps, kinks = float(jnp.finfo(self.length.dtype).eps), jnp.asarray(self.breaks, self.length.dtype)
        step = 64 * eps * self.length
        beside = jnp.stack([kinks - step, kinks + step])
        along = jnp.stack([x(beside) * self.area(beside) for x in (self.modulus, self.mass_density)])
        return jnp.any(jnp.abs(along[:, 1] / along[:, 0] - 1) > max(1e-6, 4096 * eps), axis=0)

    @property
    def deciding(self) -> list[Array]:
        """Traced numbers that decide where the rod's functions of s are divided."""
        return [x for part in self.parts if getattr(part, "bare", False) for x in deciding(part, jnp.zeros(2))]

    def area(self, s: Float[Array, "*points"]) -> Float[Array, "*points"]:
        """Cross-section area in m^2 at the material coordinates s (m)."""
        return self.section.area(validation.reals("s", s), self.length)

    def modulus(self, s: Float[Array, "*points"]) -> Float[Array, "*points"]:
        """Young's modulus in Pa at s (m)."""
        s = validation.reals("s", s)
        return self.young(s) if isinstance(self.young, Profile) else jnp.broadcast_to(self.young, jnp.shape(s))

    def mass_density(self, s: Float[Array, "*points"]) -> Float[Array, "*points"]:
        """Density in kg/m^3 at s (m)."""
        s = validation.reals("s", s)
        return self.density(s) if isinstance(self.density, Profile) else jnp.broadcast_to(self.density, jnp.shape(s))

    def panels(self, order: int = ORDER, at: Sequence[Float[Array, ""]] = ()) -> Panels:
        """Gauss-Legendre panels; they end where a profile jumps, at the knots of the section, and at `at` (m).

        They end at NaN, and so do all integrals, where they do not resolve what the rod is made of (`resolved`).  Derivatives
        by the place of a jump are NaN.
        """
        ends = self._ends(at)
        if self.bare:
            resolved = self.resolved()
            ends = jnp.where(resolved, ends, jnp.nan)
            for number in self.deciding:  # what divides a profile has no derivative where the profile jumps
                number = tracing.no_derivative(number, jnp.logical_not(resolved) | jnp.any(self._jumping()))
                ends = ends + jnp.sum(0.0 * number).astype(ends.dtype)
        return Panels(ends, order)

    def _ends(self, at: Sequence[Float[Array, ""]] = ()) -> Float[Array, " ends"]:
        """Ends of the panels in m, ascending.

        Coincident ends become one and the same number, so that a panel of no length does not grow under differentiation.
        Only `at` and the length move then: what is integrated is continuous at a knot, and breaks are constants.
        """
        dtype = precision.float_type(self, list(at))
        length = self.length.astype(dtype)
        points = [jnp.zeros((), dtype), length, *(jnp.asarray(s, dtype) for s in at)]
        inner = [jnp.asarray(self.breaks), self.section.knots(self.length)]
        if self.resolution.fixed:
            inner.append(length * np.arange(1, FIXED) / FIXED)
        if self.resolution.knots:
            inner.append(jnp.clip(jnp.asarray(self.resolution.knots, dtype), 0.0, length))
        inner = jax.lax.stop_gradient(jnp.concatenate([x.astype(dtype) for x in inner]))
        if not inner.size and not len(at):
            return jnp.stack(points)
        # A kink that was looked for is known to 1e-12 of the length.
        ends, near = jnp.concatenate([inner, jnp.stack(points)]), max(8 * float(jnp.finfo(dtype).eps), 4e-12) * length
        for point in points:
            ends = jnp.where(jnp.abs(ends - point) <= near, point, ends)
        return jnp.sort(ends)

    def resolved(self) -> Array:
        """Whether the panels resolve section, modulus and density: mass, inertia, stiffness, compliance and travel time.

        Asked of bare functions only: the integrals stand still to 1e-6 of themselves (64 roundings in float32) when
        each panel is divided into parts, 64 or more along the rod.
        """
        return stands(self, self._ends()) if self.bare else jnp.asarray(True)

    def quadrature(
        self, order: int = ORDER, at: Sequence[Float[Array, ""]] = ()
    ) -> tuple[Float[Array, " points"], Float[Array, " points"]]:
        """Points s and weights ds (m) of `panels`."""
        panels = self.panels(order, at)
        return panels.s, panels.ds

    def integrate(self, values: Float[Array, "*any points"]) -> Float[Array, "*any"]:
        """Integral over the volume, int A(s) values(s) ds, of values at the points of `quadrature()`."""
        s, ds = self.quadrature()
        return values @ (self.area(s) * ds)

    # ---- as a whole

    @property
    @tracing.at_once
    def wave_speed(self) -> Float[Array, ""]:
        """Speed of axial waves sqrt(E / rho) in m/s; of a composite rod, length over the time from end to end."""
        if not isinstance(self.young, Profile) and not isinstance(self.density, Profile):
            return jnp.sqrt(self.young / self.density)
        s, ds = self.quadrature()
        return self.length / jnp.sum(ds * jnp.sqrt(self.mass_density(s) / self.modulus(s)))

    @property
    @tracing.at_once
    def volume(self) -> Float[Array, ""]:
        """int A ds in m^3."""
        s, _ = self.quadrature()
        return self.integrate(jnp.ones_like(s))

    def _mass_moment(self, weight: Callable[[Array], Array]) -> Float[Array, ""]:
        """int rho A weight(s) ds, and the same for the body at the tip."""
        s, _ = self.quadrature()
        moment = self.integrate(self.mass_density(s) * weight(s))
        return moment if self.tip_mass is None else moment + self.tip_mass * weight(self.length)

    @property
    @tracing.at_once
    def mass(self) -> Float[Array, ""]:
        """int rho A ds in kg, and the body at the tip."""
        return self._mass_moment(jnp.ones_like)

    @property
    @tracing.at_once
    def stiffness(self) -> Float[Array, ""]:
        """Axial rigidity summed over the length, int E A ds in N m: c l0^2 of the uniform strain."""
        s, _ = self.quadrature()
        return self.integrate(self.modulus(s))

    def first_moment(self, about: Float[Array, ""] | float = 0.0) -> Float[Array, ""]:
        """int rho A (s - about) ds in kg m, with the body at the tip."""
        about = validation.number("about", about, unit="m")
        return self._mass_moment(lambda s: s - about)

    def moment_of_inertia(self, about: Float[Array, ""] | float = 0.0) -> Float[Array, ""]:
        """int rho A (s - about)^2 ds in kg m^2, with the body at the tip: (16) for the cone about its root."""
        about = validation.number("about", about, unit="m")
        inertia = self._mass_moment(lambda s: (s - about) ** 2)
        return inertia if self.tip_inertia is None else inertia + self.tip_inertia

    @property
    @tracing.at_once
    def center_of_mass(self) -> Float[Array, ""]:
        """Distance x_C of the centre of mass from the root in m, unstretched."""
        return self.first_moment() / self.mass

    def __repr__(self):
        units = {
            "length": "m",
            "section": "",
            "young": "Pa",
            "density": "kg/m^3",
            "tip_mass": "kg",
            "tip_inertia": "kg m^2",
        }
        units |= {} if self.linear else {"law": ""}
        return validation.written(self, precision.float_type(self), **units)

    def valid(self) -> Array:
        """Whether the numbers make a rod: the same questions as at construction, for traced values."""
        s, _ = self.quadrature()
        positive = jnp.concatenate([self.length[None], self.area(s), self.modulus(s), self.mass_density(s)])
        tip = jnp.stack([jnp.zeros_like(self.length), *(x for x in (self.tip_mass, self.tip_inertia) if x is not None)])
        inside = jnp.all(jnp.asarray([0.0, *self.breaks]) < self.length) & self.section.covers(self.length)
        inside = inside & self.resolved() if self.bare else inside
        return jnp.all(jnp.isfinite(positive) & (positive > 0)) & jnp.all(tip >= 0) & self.section.valid() & inside


@tracing.at_once
def _profiles(rod: Rod):
    """Points along the rod, what it is made of there, and whether its section is known all along it."""
    s = Panels(rod._ends(), ORDER).s
    return s, rod.area(s), rod.modulus(s), rod.mass_density(s), rod.section.covers(rod.length)
