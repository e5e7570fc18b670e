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
from jaxtyping import Array, Float

from .quadrature import Panels, legendre, local
from .rod import Lumped, Rod


class Projection(eqx.Module):
    """The rod as its basis sees it: M (n+1, n+1) in kg m^2, K (n, n) in N m, p (n+1,) in kg m.

    `mass` in kg; `tip` (n+1,) holds phi_k(length) in m; `strains` (n, points) phi_k' along the rod and `rigidity`
    (points,) E A ds in N m, for `law`, the strain law, None for Hooke's.  `root` (n, n): W with W W^T the inverse of
    M_aa, None where one division does.
    """

    mass_matrix: Float[Array, "n+1 n+1"]
    stiffness_matrix: Float[Array, "n n"]
    first_moments: Float[Array, " n+1"]
    mass: Float[Array, ""] | None
    tip: Float[Array, " n+1"]
    strains: Float[Array, "n points"]
    rigidity: Float[Array, " points"]
    law: Any
    root: Float[Array, "n n"] | None

    @property
    def strain_mass(self) -> Float[Array, "n n"]:
        """M_aa: the part of the mass matrix that belongs to the strain amplitudes."""
        return self.mass_matrix[1:, 1:]

    def inertia(self, amplitudes: Float[Array, "*batch n"]) -> Float[Array, "*batch"]:
        """Moment of inertia of the stretched rod, z^T M z, in kg m^2."""
        z = _with_one(amplitudes)
        return jnp.einsum("...k,kl,...l->...", z, self.mass_matrix, z)

    def moment(self, amplitudes: Float[Array, "*batch n"]) -> Float[Array, "*batch"]:
        """First moment of the stretched rod, p^T z, in kg m."""
        return _with_one(amplitudes) @ self.first_moments

    def reach(self, amplitudes: Float[Array, "*batch n"]) -> Float[Array, "*batch"]:
        """Where the tip is along the director, x(length), in m."""
        return _with_one(amplitudes) @ self.tip

    def solve_strain(self, right: Float[Array, " n"]) -> Float[Array, " n"]:
        """M_aa^-1 right."""
        return right / self.mass_matrix[1:, 1] if self.root is None else self.root @ (self.root.T @ right)

    def field(self, amplitudes: Float[Array, "*batch n"]) -> Float[Array, "*batch points"]:
        """Strain along the rod."""
        return amplitudes @ self.strains


class AbstractBasis(eqx.Module):
    """n strain shapes; the rigid rod has none."""

    n: eqx.AbstractVar[int]

    @property
    @abc.abstractmethod
    def uniform(self) -> bool:
        """Whether the strain is the same everywhere, phi_1 = phi_0."""

    @abc.abstractmethod
    def strains(self, rod: Rod, s: Float[Array, " points"], pivot: Float[Array, ""] | None) -> Float[Array, "n points"]:
        """phi_1' .. phi_n' at the material coordinates s (m); `pivot` (m) if there is one inside the rod."""

    def shapes(
        self, rod: Rod | Lumped, s: Float[Array, " points"], pivot: Float[Array, ""] | None = None, free: bool = False
    ) -> Float[Array, "n+1 points"]:
        """phi_0 .. phi_n in m at the material coordinates s (m), zero at `pivot` (None: the root), or those of flight."""
        if isinstance(rod, Lumped):
            return jnp.stack([s] * (self.n + 1))
        panels = self._panels(rod, pivot)
        phi = self._held(rod, panels, jnp.concatenate([panels.s, rod.length[None], s]), pivot)
        return (phi - _mean(rod, panels, phi)[:, None] if free else phi)[:, panels.s.size + 1 :]

    def project(self, rod: Rod | Lumped, pivot: Float[Array, ""] | None = None, free: bool = False) -> Projection:
        """The rod held at `pivot` (m from the root; None: the root itself), or free."""
        if isinstance(rod, Lumped):
            return _lumped(rod, self.n)
        panels = self._panels(rod, pivot)
        s, ds = panels.s, panels.ds
        phi = self._held(rod, panels, jnp.concatenate([s, rod.length[None]]), pivot)
        phi = phi - _mean(rod, panels, phi)[:, None] if free else phi
        strains, rigidity, mass = self.strains(rod, s, pivot), rod.modulus(s) * rod.area(s) * ds, _mass(rod, panels)
        masses = (phi[:, None] * phi[None, :]) @ mass
        stiffness = (strains[:, None] * strains[None, :]) @ rigidity
        if rod.tip_inertia is not None:
            masses = masses.at[0, 0].add(rod.tip_inertia)
        if self.n > 1:  # a piece of no length (the pivot on an end) leaves its shapes empty: they stay at rest
            empty = jnp.diagonal(stiffness) == 0
            stiffness = stiffness + jnp.diag(jnp.where(empty, stiffness[0, 0], 0.0))
        law = None if rod.linear else rod.law
        root = _inverse_root(masses[1:, 1:]) if self.n > 1 else None
        return Projection(masses, stiffness, phi @ mass, jnp.sum(mass), phi[:, -1], strains, rigidity, law, root)

    def _panels(self, rod: Rod, pivot) -> Panels:
        return rod.panels(16 + self.n, () if pivot is None else (pivot,))

    def _held(self, rod: Rod, panels: Panels, s, pivot) -> Float[Array, "n+1 points"]:
        """phi_0 .. phi_n, zero at the pivot.  What phi_1 has beyond phi_0 is integrated, so that uniform is exact."""
        arm = s if pivot is None else s - pivot
        if self.n == 0 or self.uniform:
            return jnp.stack([arm] * (self.n + 1))
        excess = self.strains(rod, panels.s, pivot).at[0].add(-1.0)
        phi = panels.antiderivative(excess, s)
        if pivot is not None:
            phi = phi - panels.antiderivative(excess, pivot[None])
        return jnp.concatenate([arm[None], phi.at[0].add(arm)])


class Ritz(AbstractBasis):
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

    n: int = eqx.field(static=True)

    def __check_init__(self):
        _check(self)

    @property
    def uniform(self):
        return self.n == 1

    def strains(self, rod, s, pivot):
        ends, pieces = _pieces(rod, pivot)
        # Constants first: each piece against all before it, with zero mean.
        shapes = [jnp.ones_like(s)]
        for k in range(1, pieces):
            start, end = ends[k], ends[k + 1]
            level = jnp.where(s < start, end - start, jnp.where(s < end, -start, 0.0))
            shapes.append(jnp.where(end > start, level, 0.0) / end)
        return _by_degree(self.n, ends, pieces, s, shapes, lambda t, d: legendre(d + 1, t)[d + 1])


class ForceRitz(AbstractBasis):
    """Axial force by n polynomial shapes, the strain is force over E A: right for strong taper and for steps.

    `ForceRitz(1)` is a constant force: the stiffness (12), (14) of the paper, with the inertia that belongs to it.  The
    force jumps at the pivot alone; at a break it has a kink.

    **Arguments:** `n`, a whole number >= 0.

    >>> import jaxrod
    >>> taper = jaxrod.Rod(length=1.0, section=jaxrod.Cone(2e-4, 0.2), young=1e7, density=1200.0)
    >>> for basis in (jaxrod.Ritz(4), jaxrod.ForceRitz(4)):
    ...     print(jaxrod.frequency_error(jaxrod.System(taper, jaxrod.Rotation(), basis))[:1].round(3))
    [231.868]
    [0.]
    """

    n: int = eqx.field(static=True)

    def __check_init__(self):
        _check(self)

    @property
    def uniform(self):
        return False

    def strains(self, rod, s, pivot):
        panels = self._panels(rod, pivot)
        points = jnp.concatenate([panels.s, s])
        compliance = 1 / (rod.modulus(points) * rod.area(points))
        ends, pieces = _pieces(rod, pivot)

        shapes = [jnp.ones_like(points)]
        if pivot is not None:
            inside = (pivot > 0) & (pivot < rod.length)
            shapes.append(jnp.where(inside, jnp.where(points < pivot, -1.0, 1.0), 0.0))
        for k in range(pieces):  # the force goes up along one piece
            t = jnp.clip(local(points, ends[k], ends[k + 1]), -1.0, 1.0)
            shapes.append(jnp.where(ends[k + 1] > ends[k], t, 0.0))

        def bubble(t, d):
            p = legendre(d + 2, t)
            return p[d + 2] - p[d]

        forces = _by_degree(self.n, ends, pieces, points, shapes, bubble)
        # By elastic energy, so that K is diagonal: orthogonal to the first is of zero mean.
        nodes = panels.s.size
        shapes = _orthogonal(forces * compliance[None, :], panels.ds / compliance[:nodes])
        mean = shapes[:1, :nodes] @ panels.ds / rod.length  # (1,), or none for n = 0
        return (shapes / mean[:1, None])[:, nodes:] if self.n else shapes[:, nodes:]


class QuasiStatic(AbstractBasis):
    """Static condensation: the strain of another basis follows the motion at once, without inertia of its own.

    The right model where the strain has settled: slow motion, stiff rods, long runs.  No axial vibration is left, and
    steps are as long as the swing allows.  A run starts with the angular momentum of the state it is given, whose strain
    it forgets.  It ends with `past_critical` where the turning exceeds the rate that any static strain can hold.

    **Arguments:** `basis`, a `Ritz` or `ForceRitz` with n >= 1.  Hooke's law only.

    >>> import jaxrod
    >>> rod = jaxrod.Rod(length=1.0, section=jaxrod.Uniform(0.025), young=2e11, density=7800.0)
    >>> system = jaxrod.System(rod, jaxrod.Rotation(), jaxrod.QuasiStatic(jaxrod.Ritz(3)), gravity=9.81)
    >>> sol = jaxrod.simulate(system, system.state(rate=15.0), t1=10.0)
    >>> print(sol.angle.round(3), int(sol.stats["num_steps"]) < 500)
    [149.527] True
    """

    basis: AbstractBasis

    def __check_init__(self):
        if not isinstance(self.basis, Ritz | ForceRitz) or self.basis.n < 1:
            raise ValueError(f"QuasiStatic(basis={self.basis!r}) has no strain to condense; give Ritz(n) or ForceRitz(n).")

    @property
    def n(self):
        return self.basis.n

    @property
    def uniform(self):
        return self.basis.uniform

    def strains(self, rod, s, pivot):
        return self.basis.strains(rod, s, pivot)


def _orthogonal(strains: Float[Array, "n points"], rigidity: Float[Array, " nodes"]) -> Float[Array, "n points"]:
    """Gram and Schmidt's orthonormal shapes, by the energy of the strain at the first points, the nodes."""
    nodes, found = rigidity.size, []
    for strain in strains:
        for _ in range(2):  # once more for what rounding left
            for other in found:
                strain = strain - (other[:nodes] * rigidity) @ strain[:nodes] * other
        square = rigidity @ strain[:nodes] ** 2
        found.append(jnp.where(square > 0, strain / jnp.sqrt(jnp.where(square > 0, square, 1.0)), 0.0))
    return jnp.stack(found) if found else strains


def _by_degree(n: int, ends, pieces: int, s, shapes: list, polynomial) -> Float[Array, "n points"]:
    """`shapes`, then the polynomials of degree index 0, 1, ... on each piece in turn, until there are n."""
    degree = 0
    while len(shapes) < n:
        for k in range(pieces):
            start, end = ends[k], ends[k + 1]
            inside = (s >= start) & ((s < end) if k + 1 < pieces else (s <= end)) & (end > start)
            shapes.append(jnp.where(inside, polynomial(local(s, start, end), degree), 0.0))
        degree += 1
    return jnp.stack(shapes[:n]) if n else jnp.zeros((0, *s.shape), s.dtype)


def _pieces(rod: Rod, pivot) -> tuple[Float[Array, " pieces+1"], int]:
    """Ends of the pieces in m, and how many there are."""
    dtype = rod.length.dtype
    inner = [jnp.asarray(b, dtype) for b in rod.breaks] + ([] if pivot is None else [pivot.astype(dtype)])
    ends = jnp.stack([jnp.zeros((), dtype), *inner, rod.length])
    return (jnp.sort(ends) if len(inner) > 1 else ends), len(inner) + 1


def _mass(rod: Rod, panels: Panels) -> Float[Array, " points+1"]:
    """rho A ds in kg, and last the mass at the tip."""
    s = panels.s
    mass = rod.mass_density(s) * rod.area(s) * panels.ds
    tip = jnp.zeros_like(rod.length) if rod.tip_mass is None else rod.tip_mass
    return jnp.concatenate([mass, tip[None].astype(mass.dtype)])


def _mean(rod: Rod, panels: Panels, phi) -> Float[Array, " n+1"]:
    mass = _mass(rod, panels)
    return phi[:, : mass.size] @ mass / jnp.sum(mass)


def _lumped(rod: Lumped, n: int) -> Projection:
    ones = jnp.ones(n + 1, dtype=rod.inertia.dtype)
    return Projection(
        rod.inertia * jnp.outer(ones, ones),
        rod.stiffness * jnp.outer(ones, ones)[1:, 1:],
        rod.first_moment * ones,
        mass=None,
        tip=rod.length * ones,
        strains=ones[1:, None],
        rigidity=rod.stiffness[None],
        law=None,
        root=None,
    )


def _inverse_root(mass: Float[Array, "n n"]) -> Float[Array, "n n"]:
    """W with W W^T the inverse; shapes without mass are left at rest."""
    mass = mass + jnp.diag(jnp.where(jnp.diagonal(mass) == 0, mass[0, 0], 0.0))
    lower = jnp.linalg.cholesky(mass)
    return jax.scipy.linalg.solve_triangular(lower, jnp.eye(mass.shape[0], dtype=mass.dtype), lower=True).T


def _check(basis: AbstractBasis) -> None:
    if type(basis.n) is not int or basis.n < 0:
        name = type(basis).__name__
        raise ValueError(f"{name}(n={basis.n}) is not available; give a whole number of strain shapes, 0 for rigid.")


def _with_one(amplitudes: Float[Array, "*batch n"]) -> Float[Array, "*batch n+1"]:
    return jnp.concatenate([jnp.ones_like(amplitudes, shape=(*amplitudes.shape[:-1], 1)), amplitudes], axis=-1)
