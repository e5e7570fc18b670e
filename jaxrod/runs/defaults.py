"""What `simulate` takes where nothing is said, and what is worth a try beside it."""

from typing import Any

import diffrax
import jax.numpy as jnp

from ..core import precision
from ..integrators.multistep import AbstractMultistep, QuinlanTremaine10, QuinlanTremaine12
from ..integrators.symplectic import ABA864, AbstractSymplectic, BlanesMoan6, StormerVerlet
from ..mechanics.chart import AbstractChart, Angles, Director, Embedded, Strains
from ..mechanics.lagrangian import Lagrangian
from ..mechanics.system import System, check_system


def default_solver(system: System | Lagrangian) -> diffrax.AbstractSolver:
    """The solver that `simulate` takes when none is given; `sol.stats["why"]` says why.

    A symplectic one of fixed steps where the scene can be cut into exact flows: `BlanesMoan6` for uniform strain, rigid
    and driven rods, `ABA864` for more strain shapes.  Else, as where forces depend on rates, the adaptive `Dopri8`.

    >>> import jaxrod
    >>> rod = jaxrod.Rod(length=1.0, section=jaxrod.Uniform(0.025), young=1e7, density=1200.0)
    >>> for basis in (jaxrod.Ritz(1), jaxrod.Ritz(3), jaxrod.QuasiStatic(jaxrod.Ritz(1))):
    ...     print(type(jaxrod.default_solver(jaxrod.System(rod, jaxrod.Rotation(), basis))).__name__)
    BlanesMoan6
    ABA864
    Dopri8
    """
    return best_solver(system)[0]


def default_chart(system: Any) -> AbstractChart:
    """The coordinates that `simulate` takes when none are given.

    Where the rotation is driven the strain alone.  In the plane the angle, which has no pole and counts its turns.  In
    space the embedded q = (1 + eps) d where the strain is uniform, else the director.  In float32 always the director
    beside the strain: an angle of many turns and a strain kept as 1 + eps would lose their last digits to rounding.

    >>> import jaxrod
    >>> rod = jaxrod.Rod(length=1.0, section=jaxrod.Uniform(0.025), young=1e7, density=1200.0)
    >>> print(jaxrod.default_chart(jaxrod.System(rod, jaxrod.Spherical())))
    Embedded()
    """
    check_system(system)
    if system.motion.prescribed:
        return Strains()
    if precision.float_type(system) == jnp.float32:
        return Director()
    if system.motion.dimension == 2:
        return Angles()
    return Embedded() if system.flat else Director()


def best_solver(system: System | Lagrangian) -> tuple[diffrax.AbstractSolver, str]:
    """The solver for a scene, and why."""
    if isinstance(system, Lagrangian):
        return diffrax.Dopri8(), "adaptive, for any Lagrangian"
    check_system(system)
    if system.unsplit:
        return diffrax.Dopri8(), f"adaptive, because {system.unsplit}"
    if system.motion.prescribed:
        return BlanesMoan6(), "symplectic, the oscillators of the strain exact"
    if system.basis.n == 0:
        return BlanesMoan6(), "symplectic, the turning of the rigid rod exact"
    if system.splits_flat:
        return BlanesMoan6(), "symplectic, as uniform strain makes the kinetic energy flat"
    return ABA864(), "symplectic for small kicks, axial vibration and turning exact"


def solvers(system: System) -> list[Any]:
    """Those worth a try, the default first."""
    best = default_solver(system)
    if not by_equal_steps(best):
        return [best]
    if system.motion.prescribed or not system.splits_flat:
        return [best, StormerVerlet()]
    return [best, StormerVerlet(), ABA864(), QuinlanTremaine10(), QuinlanTremaine12()]


def by_equal_steps(solver: Any) -> bool:
    """Whether a solver takes `n_steps`, and not a tolerance."""
    return isinstance(solver, AbstractSymplectic | AbstractMultistep)
