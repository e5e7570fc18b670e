"""The ladder of strain approximations: a basis turns a rod into a few small arrays.

Deformed position along the director: x(s, t) = phi_0(s) + sum_k a_k(t) phi_k(s), phi_0 = s - s_p, measured from the
pivot s_p (in flight from the centre of mass, and then every phi_k has no mass-weighted mean).  With z = (1, a):

    M_kl = int rho A phi_k phi_l ds     K_kl = int E A phi_k' phi_l' ds     p_k = int rho A phi_k ds

and the body at the tip in M and p.  The mean of phi_1' is 1 and that of the others 0, so a_1 is elongation over length.
"""

import abc
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..core import tracing, validation
from ..rods.lumped import Lumped
from ..rods.quadrature import Panels, legendre, local
from ..rods.rod import Rod
from .projection import Projection, inverse_mass_root, lumped


class AbstractBasis(eqx.Module):
    """n strain shapes; the rigid rod has none."""

    n: eqx.AbstractVar[int]

    @property
    @abc.abstractmethod
    def uniform(self) -> bool:
        """Whether the strain is the same everywhere, phi_1 = phi_0."""

    def misfit(self, rod: Rod | Lumped) -> str:
        """Why these shapes do not fit this rod; empty if they do, or where that is not known yet."""
        del rod
        return ""

    @property
    def by_piece(self) -> bool:
        """Whether shapes belong to pieces of the rod, and vanish with the piece between the pivot and a break."""
        return False

    @abc.abstractmethod
    def strains(
        self, rod: Rod, s: Float[Array, " points"], pivot: Float[Array, ""] | None = None, free: bool = False
    ) -> Float[Array, "n points"]:
        """phi_1' .. phi_n' at the material coordinates s (m); `pivot` (m) if there is one inside the rod."""

    def nodal(self, rod: Rod, panels: Panels, pivot: Float[Array, ""] | None, free: bool) -> Float[Array, "n nodes"]:
        """The same at the points of its own panels."""
        return self.strains(rod, panels.s, pivot, free)

    def shapes(
        self, rod: Rod | Lumped, s: Float[Array, " points"], pivot: Float[Array, ""] | None = None, free: bool = False
    ) -> Float[Array, "all points"]:
        """phi_0 .. phi_n in m at the material coordinates s (m), zero at `pivot` (None: the root), or those of flight."""
        if isinstance(rod, Lumped):
            return jnp.stack([s] * (self.n + 1))
        pivot = self._held(rod, pivot)
        panels = self._panels(rod, pivot)
        phi, strains = self._rise(s, pivot), self.nodal(rod, panels, pivot, free)
        if not self._smooth:
            excess = _excess(strains)
            phi = phi.at[1:].add(panels.antiderivative(excess, s) - until(panels, excess, pivot)[:, None])
        return phi - _mean(rod, panels, self._at_points(rod, panels, pivot, strains))[:, None] if free else phi

    def project(self, rod: Rod | Lumped, pivot: Float[Array, ""] | None = None, free: bool = False) -> Projection:
        """The rod held at `pivot` (m from the root; None: the root itself), or free."""
        if isinstance(rod, Lumped):
            return lumped(rod, self.n)
        pivot = self._held(rod, pivot)
        panels = self._panels(rod, pivot)
        s, ds = panels.s, panels.ds
        strains = self.nodal(rod, panels, pivot, free)
        phi = self._at_points(rod, panels, pivot, strains)
        phi = phi - _mean(rod, panels, phi)[:, None] if free else phi
        rigidity = rod.modulus(s) * rod.area(s) * ds
        mass = lumped_mass(rod, panels)
        masses = (phi * mass[None, :]) @ phi.T
        stiffness = (strains * rigidity[None, :]) @ strains.T
        if rod.tip_inertia is not None:
            masses = masses.at[0, 0].add(rod.tip_inertia)
        if self.n > 1:  # a piece of no length (the pivot on an end) leaves its shapes empty: they stay at rest
            empty = jnp.diagonal(stiffness) == 0
            stiffness = stiffness + jnp.diag(jnp.where(empty, stiffness[0, 0], 0.0))
        law = None if rod.linear else rod.law
        root = inverse_mass_root(masses[1:, 1:]) if self.n > 1 else None
        return Projection(masses, stiffness, phi @ mass, jnp.sum(mass), phi[:, -1], strains, rigidity, law, root)

    def _held(self, rod: Rod, pivot):
        """The pivot, on a break or end if it is that by all but rounding: a piece of 1e-9 of the rod would be a spring of 1e9."""
        if pivot is None:
            return None
        for end in (0.0, *rod.breaks, rod.length):
            near = jnp.abs(pivot - end) < 1e-9 * rod.length
            pivot = pivot + jax.lax.stop_gradient(jnp.where(near, end - pivot, 0.0))
        return pivot if self._smooth else rod.held_at(pivot, ends=True, breaks=self.by_piece)

    @property
    def _smooth(self) -> bool:
        """Whether the pivot's place is a polynomial's variable only: no shape, and no integral, ends there."""
        return self.n == 0 or self.uniform

    def _panels(self, rod: Rod, pivot) -> Panels:
        return rod.panels(16 + self.n, () if pivot is None or self._smooth else (pivot,))

    def _rise(self, s, pivot) -> Float[Array, "all points"]:
        """phi_0 and phi_1 of uniform strain, and nothing yet of the rest."""
        arm = s if pivot is None else s - pivot
        return jnp.stack([arm, arm, *[jnp.zeros_like(arm)] * (self.n - 1)][: self.n + 1])

    def _at_points(self, rod: Rod, panels: Panels, pivot, strains) -> Float[Array, "all points_tip"]:
        """phi_0 .. phi_n, zero at the pivot, at the points of the panels and last at the tip; `strains` at the points."""
        phi = self._rise(jnp.concatenate([panels.s, rod.length[None]]), pivot)
        if self._smooth:
            return phi
        excess = _excess(strains)
        gained = jnp.concatenate([panels.running(excess), (excess @ panels.ds)[:, None]], axis=1)
        return phi.at[1:].add(gained - until(panels, excess, pivot)[:, None])


class AbstractShapes(AbstractBasis):
    """A basis of n strain shapes of its own."""

    n: int = eqx.field(static=True, converter=lambda n: int(n) if isinstance(n, np.integer) else n)

    def __check_init__(self):
        if type(self.n) is not int or self.n < 0:
            name = type(self).__name__
            raise ValueError(
                f"{name}(n={validation.given(self.n)}) is not available; give a whole number of strain shapes, 0 for rigid."
            )


class AbstractNodalShapes(AbstractShapes):
    """Shapes that are made at the points of panels, and known elsewhere with these."""

    @property
    def uniform(self):
        return False

    def strains(self, rod: Any, s: Float[Array, " points"], pivot: Float[Array, ""] | None = None, free: bool = False):
        panels = self._panels(rod, pivot)
        return self._strains(rod, panels, pivot, free, s)[:, panels.s.size :]

    def nodal(self, rod: Any, panels: Panels, pivot: Float[Array, ""] | None, free: bool):
        return self._strains(rod, panels, pivot, free, panels.s[:0])

    @abc.abstractmethod
    def _strains(self, rod: Rod, panels: Panels, pivot, free: bool, s) -> Float[Array, "n nodes_points"]:
        """At the points of the panels, then at s."""


class AbstractShapesOf(AbstractBasis):
    """The shapes of another `basis`, with something of one's own about them."""

    basis: eqx.AbstractVar[AbstractBasis]

    @property
    def n(self):
        return self.basis.n

    @property
    def uniform(self):
        return self.basis.uniform

    @property
    def by_piece(self):
        return self.basis.by_piece

    def misfit(self, rod: Any):
        return self.basis.misfit(rod)

    def strains(self, rod: Any, s: Float[Array, " points"], pivot: Float[Array, ""] | None = None, free: bool = False):
        return self.basis.strains(rod, s, pivot, free)

    def nodal(self, rod: Any, panels: Panels, pivot: Float[Array, ""] | None, free: bool):
        return self.basis.nodal(rod, panels, pivot, free)


class Ritz(AbstractShapes):
    """Strain by n shapes, Legendre polynomials on each piece of the rod between its breaks and the pivot.

    `Ritz(0)` is the rigid rod, `Ritz(1)` the paper's uniform strain (2).  Next come the constants of the pieces, then
    their degrees one by one; `Ritz(n)` contains `Ritz(n - 1)`.

    **Arguments:** `n`, a whole number >= 0.

    **Raises:** `ValueError` for another n.

    >>> import jaxrod
    >>> cone = jaxrod.Rod(length=1.0, section=jaxrod.Cone(0.02, 0.03), young=1e7, density=1200.0)
    >>> print(jaxrod.Ritz(3).project(cone).stiffness_matrix.shape)
    (3, 3)
    """

    @property
    def uniform(self):
        return self.n == 1

    @property
    def by_piece(self):
        return self.n > 1

    def strains(self, rod: Any, s: Float[Array, " points"], pivot: Float[Array, ""] | None = None, free: bool = False):
        ends, pieces = _pieces(rod, pivot)
        # Constants first: each piece against all before it, with zero mean.
        shapes = [jnp.ones_like(s)]
        for k in range(1, pieces):
            start, end = ends[k], ends[k + 1]
            level = jnp.where(s < start, end - start, jnp.where(s < end, -start, 0.0))
            shapes.append(jnp.where(end > start, level, 0.0) / end)
        return _by_degree(self.n, ends, pieces, s, shapes, lambda t, count: legendre(count, t)[1:])


class ForceRitz(AbstractNodalShapes):
    """Axial force by n polynomial shapes, the strain is force over E A: right for strong taper and for steps.

    `ForceRitz(1)` is a constant force: the stiffness (12), (14) of the paper, with the inertia that belongs to it.  The
    force jumps at the pivot alone; at a break it has a kink.

    **Arguments:** `n`, a whole number >= 0.

    **Raises:** `ValueError`, in a `System`, for a rod with a pointed end (an area below 1e-8 of the largest), where no
    force can act; under transformations its shapes are NaN there.

    >>> import jaxrod
    >>> taper = jaxrod.Rod(length=1.0, section=jaxrod.Cone(2e-4, 0.2), young=1e7, density=1200.0)
    >>> for basis in (jaxrod.Ritz(4), jaxrod.ForceRitz(4)):
    ...     print(jaxrod.frequency_error(jaxrod.System(taper, jaxrod.Rotation(), basis))[:1].round(3))
    [559.716]
    [0.]
    """

    def misfit(self, rod: Any):
        if not self.n or isinstance(rod, Lumped) or not validation.fails(np.logical_not, _pointed(rod)):
            return ""
        return (
            f"basis={self!r} has an axial force everywhere, but section={rod.section!r} comes to a point, where a force would "
            "stretch the rod without bound; take LoadRitz(n) or Ritz(n)."
        )

    @property
    def by_piece(self):
        return self.n > 2

    def _strains(self, rod: Rod, panels: Panels, pivot, free: bool, s):
        del free
        points = jnp.concatenate([panels.s, s])
        if self.n == 0:
            return jnp.zeros((0, points.size), points.dtype)
        compliance = 1 / (rod.modulus(points) * rod.area(points))
        ends, pieces = _pieces(rod, pivot)

        shapes = [jnp.ones_like(points)]
        if pivot is not None:
            inside = (pivot > 0) & (pivot < rod.length)
            shapes.append(jnp.where(inside, jnp.where(points < pivot, -1.0, 1.0), 0.0))
        for k in range(pieces):  # the force goes up along one piece
            t = jnp.clip(local(points, ends[k], ends[k + 1]), -1.0, 1.0)
            shapes.append(jnp.where(ends[k + 1] > ends[k], t, 0.0))

        def bubbles(t, count):
            p = legendre(count + 1, t)
            return p[2:] - p[:-2]

        forces = _by_degree(self.n, ends, pieces, points, shapes, bubbles)
        # By elastic energy, so that K is diagonal: orthogonal to the first is of zero mean.
        nodes = panels.s.size
        shapes = _orthogonal(forces * compliance[None, :], panels.ds / compliance[:nodes])
        mean = shapes[:1, :nodes] @ panels.ds / rod.length
        return jnp.where(_pointed(rod), jnp.nan, shapes / mean[:, None])


class QuasiStatic(AbstractShapesOf):
    """Static condensation: the strain of another basis follows the motion at once, without inertia of its own.

    The right model where the strain has settled: slow motion, stiff rods, long runs.  No axial vibration is left, and
    steps are as long as the swing allows.  A run starts with the angular momentum of the state it is given, whose strain
    it forgets.  It ends with `past_critical` where the turning exceeds the rate that any static strain can hold.

    The strain has no rate: `KelvinVoigt` does nothing, and `power` leaves out what forces do on the strain.

    **Arguments:** `basis`, another one with n >= 1.  Hooke's law only.

    >>> import jaxrod
    >>> rod = jaxrod.Rod(length=1.0, section=jaxrod.Uniform(0.025), young=2e11, density=7800.0)
    >>> system = jaxrod.System(rod, jaxrod.Rotation(), jaxrod.QuasiStatic(jaxrod.Ritz(3)), gravity=9.81)
    >>> sol = jaxrod.simulate(system, system.state(rate=15.0), t1=10.0)
    >>> print(sol.angle.round(3), int(sol.stats["num_steps"]) < 1000)
    [149.464] True
    """

    basis: AbstractBasis

    def __init__(self, basis: AbstractBasis):
        if not isinstance(basis, AbstractBasis) or isinstance(basis, QuasiStatic) or basis.n < 1:
            raise ValueError(
                f"QuasiStatic(basis={validation.given(basis)}) has no strain to condense; give a basis such as Ritz(3)."
            )
        self.basis = basis


@tracing.at_once
def _pointed(rod: Rod):
    return rod.section.pointed(rod.length)


def _orthogonal(strains: Float[Array, "n points"], rigidity: Float[Array, " nodes"]) -> Float[Array, "n points"]:
    """Gram and Schmidt's orthonormal shapes, by the energy of the strain at the first points, the nodes."""

    def add(found, here):
        k, strain = here
        return found.at[k].set(orthonormal(strain, found, rigidity)), None

    return jax.lax.scan(add, jnp.zeros_like(strains), (jnp.arange(len(strains)), strains))[0]


def orthonormal(
    strain: Float[Array, " points"], found: Float[Array, "n points"], rigidity: Float[Array, " nodes"], least=0.0
) -> Float[Array, " points"]:
    """A shape of energy 1 apart from those found (rows of zeros: not yet), by the energy at the first points, the nodes.

    Zero where no more than `least` of its energy is new.
    """
    nodes = rigidity.size
    before = rigidity @ strain[:nodes] ** 2
    for _ in range(2):  # once more for what rounding left
        strain = strain - (found[:, :nodes] @ (rigidity * strain[:nodes])) @ found
    square = rigidity @ strain[:nodes] ** 2
    new = square > least * before
    return jnp.where(new, strain / jnp.sqrt(jnp.where(new, square, 1.0)), 0.0)


def _by_degree(n: int, ends, pieces: int, s, shapes: list, polynomials) -> Float[Array, "n points"]:
    """`shapes`, then the polynomials (t, count) of the next degree on each piece in turn, until there are n."""
    count = max(0, -((len(shapes) - n) // pieces))
    by_piece = []
    for k in range(pieces):
        start, end = ends[k], ends[k + 1]
        inside = (s >= start) & ((s < end) if k + 1 < pieces else (s <= end)) & (end > start)
        by_piece.append(jnp.where(inside[None, :], polynomials(local(s, start, end), count), 0.0) if count else None)
    found = jnp.stack(shapes)
    if count:
        found = jnp.concatenate([found, jnp.stack(by_piece, axis=1).reshape(-1, s.size)])
    return found[:n]


def _excess(strains: Float[Array, "n points"]) -> Float[Array, "n points"]:
    """What the strains have beyond the uniform one; only that is integrated, so that uniform is exact."""
    return strains.at[0].add(-1.0)


def until(panels: Panels, values: Float[Array, "k points"], pivot: Float[Array, ""] | None) -> Float[Array, " k"]:
    """int from the root to the pivot, which ends a panel."""
    if pivot is None:
        return jnp.zeros(len(values), values.dtype)
    return values @ jnp.where(panels.s < pivot, panels.ds, 0.0)


def _pieces(rod: Rod, pivot) -> tuple[Float[Array, " ends"], int]:
    """Ends of the pieces in m, and how many there are."""
    dtype = rod.length.dtype
    inner = [jnp.asarray(b, dtype) for b in rod.breaks] + ([] if pivot is None else [pivot.astype(dtype)])
    ends = jnp.stack([jnp.zeros((), dtype), *inner, rod.length])
    return (jnp.sort(ends) if len(inner) > 1 else ends), len(inner) + 1


def lumped_mass(rod: Rod, panels: Panels) -> Float[Array, " points_tip"]:
    """rho A ds in kg, and last the mass at the tip."""
    s = panels.s
    mass = rod.mass_density(s) * rod.area(s) * panels.ds
    tip = jnp.zeros_like(rod.length) if rod.tip_mass is None else rod.tip_mass
    return jnp.concatenate([mass, tip[None].astype(mass.dtype)])


def _mean(rod: Rod, panels: Panels, phi) -> Float[Array, " all"]:
    mass = lumped_mass(rod, panels)
    return phi[:, : mass.size] @ mass / jnp.sum(mass)
