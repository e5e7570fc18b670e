"""The rod: a straight elastic bar of given length, cross-section, Young's modulus and density.

Material coordinate s runs from the root (s = 0, the paper's radius r) to the tip (s = length).  Units are SI.
Every number is a leaf of a pytree: a gradient can be taken in each.
"""

import abc
import warnings
from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from . import checks

_FASTEST_SOLID = 2.0e4  # m/s: sound in diamond is about 18 km/s
_ORDER = 24  # Gauss-Legendre points per smooth piece; exact for polynomial integrands of degree 47


class AbstractSection(eqx.Module):
    """The cross-section along the rod: `area(s, length)` in m^2, and the `breaks` between its smooth pieces."""

    breaks: eqx.AbstractVar[tuple[float, ...]]

    @abc.abstractmethod
    def area(self, s: Float[Array, "*points"], length: Float[Array, ""]) -> Float[Array, "*points"]:
        """Area in m^2 at the material coordinates s (m) of a rod of this length (m)."""


class Uniform(AbstractSection):
    """A circular section of constant radius.

    **Arguments:** `radius` in m, positive.

    >>> import jaxrod
    >>> jaxrod.Uniform(radius=0.025)
    Uniform(radius=0.025)
    """

    radius: Float[Array, ""]
    breaks: ClassVar[tuple[float, ...]] = ()

    def __init__(self, radius):
        self.radius = checks.positive("Uniform(radius=)", radius, "metres")

    def area(self, s, length):
        return jnp.pi * self.radius**2 * jnp.ones_like(s)

    def __repr__(self):
        return f"Uniform(radius={_brief(self.radius)})"


class Cone(AbstractSection):
    """A circular section whose radius goes linearly from root to tip: equation (13) of the paper.

    **Arguments:** `root_radius` (the paper's r, at s = 0) and `tip_radius` (R, at s = length), in m.  One of the two
    may be zero: a pointed rod.

    >>> import jaxrod
    >>> jaxrod.Cone(root_radius=0.02, tip_radius=0.03)
    Cone(root_radius=0.02, tip_radius=0.03)
    """

    root_radius: Float[Array, ""]
    tip_radius: Float[Array, ""]
    breaks: ClassVar[tuple[float, ...]] = ()

    def __init__(self, root_radius, tip_radius):
        root = checks.not_negative("Cone(root_radius=)", root_radius, "metres")
        tip = checks.not_negative("Cone(tip_radius=)", tip_radius, "metres")
        if checks.fails(lambda root, tip: (root > 0) | (tip > 0), root, tip):
            raise ValueError("Cone(root_radius=0, tip_radius=0) has no section left; at most one end may be a point.")
        self.root_radius, self.tip_radius = root, tip

    def radius(self, s, length):
        """r(s) = r + (R - r) s / length, in m: equation (13)."""
        return self.root_radius + (self.tip_radius - self.root_radius) * s / length

    def area(self, s, length):
        return jnp.pi * self.radius(s, length) ** 2

    def __repr__(self):
        return f"Cone(root_radius={_brief(self.root_radius)}, tip_radius={_brief(self.tip_radius)})"


class Profile(AbstractSection):
    """Any area A(s), given as a function of the material coordinate s in m; `Rod` wraps a bare function in it.

    **Arguments:** `function`, s -> area in m^2 (works on arrays; numbers in an Equinox module are differentiable), and
    `breaks`, the coordinates in m where it is not smooth.

    >>> import jax.numpy as jnp, jaxrod
    >>> rod = jaxrod.Rod(length=1.0, section=lambda s: 1e-3 * jnp.exp(-s), young=1e7, density=1200.0)
    >>> print(f"{rod.mass:.6f} kg")
    0.758545 kg
    """

    function: Any
    breaks: tuple[float, ...] = eqx.field(static=True)

    def __init__(self, function, breaks=()):
        if not callable(function):
            raise ValueError(f"section={function!r} is not a section; give Uniform, Cone, or a function of s.")
        if list(breaks) != sorted(set(breaks)):
            raise ValueError(f"breaks={breaks} must increase from root to tip.")
        self.function = function if isinstance(function, eqx.Module) else jax.tree_util.Partial(function)
        self.breaks = tuple(breaks)

    def area(self, s, length):
        del length
        return jnp.broadcast_to(jnp.asarray(self.function(s)), jnp.shape(s))


class Rod(eqx.Module):
    """A thin straight rod of one material.

    **Arguments:**

    - `length`: unstretched length in m (the paper's l0).
    - `section`: `Uniform`, `Cone`, or any function s -> area in m^2.
    - `young`: Young's modulus E in Pa.
    - `density`: rho in kg/m^3.

    **Raises:** `ValueError` for a number that is not positive and finite, and for a section that vanishes inside the
    rod.  **Warns** when the wave speed sqrt(E / rho) exceeds 20 km/s: no solid is that stiff, the unit of `young` or
    `density` is likely wrong.

    >>> import jaxrod
    >>> rod = jaxrod.Rod(length=1.0, section=jaxrod.Cone(0.02, 0.03), young=1e7, density=1200.0)
    >>> print(f"{rod.mass:.5f} kg, {rod.center_of_mass:.5f} m")
    2.38761 kg, 0.56579 m
    """

    length: Float[Array, ""]
    section: AbstractSection
    young: Float[Array, ""]
    density: Float[Array, ""]

    def __init__(self, length, section, young, density):
        self.length = checks.positive("length", length, "metres")
        self.young = young = checks.positive("young", young, "pascals (rubber about 1e7, steel 2e11)")
        self.density = density = checks.positive("density", density, "kg/m^3")
        self.section = (
            section if isinstance(section, AbstractSection) else Profile(section, getattr(section, "breaks", ()))
        )
        if checks.fails(lambda young, density: young <= _FASTEST_SOLID**2 * density, young, density):
            warnings.warn(
                f"wave speed sqrt(young/density) = {np.sqrt(np.asarray(young) / np.asarray(density)):.3g} m/s is beyond "
                f"any solid (diamond 1.8e4 m/s): is young={checks.shown(young)} in Pa and density={checks.shown(density)} "
                "in kg/m^3? (The paper prints rubber's modulus as "
                "10^7 MPa where 10^7 Pa is meant.)",
                stacklevel=2,
            )
        self._check_section()

    def _check_section(self):
        s, _ = self.quadrature()
        area = self.area(s)
        if checks.fails(lambda area: (area > 0) & np.isfinite(area), area):
            first = int(np.argmin((np.asarray(area) > 0) & np.isfinite(area)))
            raise ValueError(
                f"section has area {float(area[first]):.3g} m^2 at s={float(s[first]):.4g} m; it must be positive all "
                f"along the rod (0 < s < length={float(self.length):.4g} m)."
            )

    def area(self, s: Float[Array, "*points"]) -> Float[Array, "*points"]:
        """Cross-section area in m^2 at the material coordinates s (m)."""
        return self.section.area(s, self.length)

    def quadrature(self) -> tuple[Float[Array, " points"], Float[Array, " points"]]:
        """Points s and weights ds (m) of the Gauss-Legendre rule on each smooth piece of the section."""
        dtype = checks.float_type(self)
        x, w = (jnp.asarray(column, dtype) for column in np.polynomial.legendre.leggauss(_ORDER))
        ends = jnp.stack([jnp.asarray(end, dtype) for end in (0.0, *self.section.breaks, self.length)])
        half = jnp.diff(ends)[:, None] / 2
        return (ends[:-1, None] + half * (1 + x)[None, :]).reshape(-1), (half * w[None, :]).reshape(-1)

    def integrate(self, values: Float[Array, "*any points"]) -> Float[Array, "*any"]:
        """Integral over the volume, int A(s) values(s) ds, of values at the points of `quadrature`."""
        s, ds = self.quadrature()
        return values @ (self.area(s) * ds)

    @property
    def wave_speed(self) -> Float[Array, ""]:
        """Speed of axial waves sqrt(E / rho) in m/s."""
        return jnp.sqrt(self.young / self.density)

    @property
    def volume(self) -> Float[Array, ""]:
        """int A ds in m^3."""
        s, _ = self.quadrature()
        return self.integrate(jnp.ones_like(s))

    @property
    def mass(self) -> Float[Array, ""]:
        """int rho A ds in kg."""
        return self.density * self.volume

    @property
    def stiffness(self) -> Float[Array, ""]:
        """Axial rigidity summed over the length, int E A ds in N m: c l0^2 of the uniform strain."""
        return self.young * self.volume

    def first_moment(self, about: Float[Array, ""] | float = 0.0) -> Float[Array, ""]:
        """int rho A (s - about) ds in kg m."""
        s, _ = self.quadrature()
        return self.density * self.integrate(s - about)

    def moment_of_inertia(self, about: Float[Array, ""] | float = 0.0) -> Float[Array, ""]:
        """int rho A (s - about)^2 ds in kg m^2: (16) for the cone about its root."""
        s, _ = self.quadrature()
        return self.density * self.integrate((s - about) ** 2)

    @property
    def center_of_mass(self) -> Float[Array, ""]:
        """Distance x_C of the centre of mass from the root in m, unstretched."""
        return self.first_moment() / self.mass

    def valid(self) -> Array:
        """Whether the numbers make a rod: the same questions as at construction, for traced values."""
        numbers = jnp.stack([self.length, self.young, self.density])
        s, _ = self.quadrature()
        radii = [x for x in jax.tree.leaves(self.section) if isinstance(self.section, Uniform | Cone)]
        return (
            jnp.all(jnp.isfinite(numbers) & (numbers > 0))
            & jnp.all(self.area(s) > 0)
            & jnp.all(jnp.array([jnp.asarray(True), *(radius >= 0 for radius in radii)]))
        )


class Lumped(eqx.Module):
    """A pivoted body with one uniform strain, given by three numbers: the spring pendulum with inertia.

    With one strain a pivoted rod *is* this: inertia I, first moment S = m x_C and stiffness C = int E A ds.  It carries
    formulas that no rod has (the paper's literal mixture) and the elastic-pendulum literature.

    **Arguments:** `inertia` in kg m^2, `first_moment` in kg m (zero: pivoted at the centre of mass), `stiffness` in
    N m (c l0^2 for a spring constant c), `length` in m.

    A point mass m on a spring c of unstretched length l:

    >>> import jaxrod
    >>> m, c, l = 1.0, 33.0, 0.1
    >>> jaxrod.Lumped(inertia=m * l**2, first_moment=m * l, stiffness=c * l**2, length=l)
    Lumped(inertia=0.01, first_moment=0.1, stiffness=0.33, length=0.1)
    """

    inertia: Float[Array, ""]
    first_moment: Float[Array, ""]
    stiffness: Float[Array, ""]
    length: Float[Array, ""]

    def __init__(self, inertia, first_moment, stiffness, length):
        self.inertia = checks.positive("inertia", inertia, "kg m^2")
        self.first_moment = checks.number("first_moment", first_moment)
        self.stiffness = checks.positive("stiffness", stiffness, "N m (spring constant times length squared)")
        self.length = checks.positive("length", length, "metres")

    def valid(self) -> Array:
        """Whether the numbers make a body: the same questions as at construction, for traced values."""
        numbers = jnp.stack([self.inertia, self.stiffness, self.length])
        return jnp.all(jnp.isfinite(numbers) & (numbers > 0)) & jnp.isfinite(self.first_moment)

    def __repr__(self):
        names = ("inertia", "first_moment", "stiffness", "length")
        return f"Lumped({', '.join(f'{name}={_brief(getattr(self, name))}' for name in names)})"


def _brief(value: Array) -> str:
    return f"{value:.6g}" if checks.known(value) and value.ndim == 0 else repr(value)
