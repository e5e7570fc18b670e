"""From one rung of strain shapes to another: the same rod, motion and start."""

import dataclasses
from typing import Any

import jax.numpy as jnp

from .. import continuum
from ..core import tracing, validation
from ..mechanics.chart import Director, Strains
from ..mechanics.equations import Condensed
from ..mechanics.lagrangian import solve_positive
from ..mechanics.system import System, check_state, check_system
from ..motions.force import KelvinVoigt, PivotFriction, ShakenBase, Torque
from ..motions.state import State
from ..rods.lumped import Lumped
from ..rods.rod import Rod
from ..shapes.basis import AbstractBasis, ForceRitz, QuasiStatic
from ..shapes.load_basis import LoadRitz
from ..shapes.padding import FirstShapes
from ..shapes.projected import Projected

_ORDER = 24  # nodes for each panel
_SIZES = (6, 12, 24)  # of arrays that several rungs share


def richer(system: System) -> type[AbstractBasis]:
    """The family of shapes that converges fastest: load-dependent ones, but where a force may act at the tip those that hold
    a force there, as load-dependent ones have no tension at a free tip."""
    check_system(system)
    along = all(isinstance(force, Torque | PivotFriction | KelvinVoigt | ShakenBase) for force in system.forces)
    return LoadRitz if along or ForceRitz(1).misfit(system.rod) else ForceRitz


def padded(basis: AbstractBasis) -> AbstractBasis:
    """The same rung of a family of many shapes in arrays of one of a few sizes; others as they are."""
    if not isinstance(basis, LoadRitz | ForceRitz) or not 1 < basis.n <= _SIZES[-1]:
        return basis
    return first_shapes(basis, next(size for size in _SIZES if size >= basis.n))


def first_shapes(basis: AbstractBasis, size: int) -> AbstractBasis:
    """The same rung in arrays of `size` shapes."""
    return FirstShapes(type(basis)(size), basis.n)


def condensable(system: System) -> bool:
    """Whether a `QuasiStatic` rung takes the scene: Hooke's law, and a motion that is not prescribed."""
    check_system(system)
    return isinstance(system.rod, Rod) and system.rod.linear and not system.motion.prescribed


def on_rung(system: System, start: State, basis: AbstractBasis) -> tuple[System, State]:
    """The scene with another basis, and the start whose strain is nearest in strain energy.

    **Raises:** `ValueError` for a `Lumped` body, whose strain is uniform and which has no rod to take other shapes of.
    """
    check_system(system)
    check_state(system, start, "start")
    if isinstance(system.rod, Lumped):
        raise ValueError("a Lumped body has no shapes of strain but its own; give a Rod to compare rungs.")
    if not isinstance(basis, AbstractBasis):
        raise ValueError(f"basis={validation.given(basis)} is not a basis; give an instance such as Ritz(3).")
    if basis.n == 0 or system.basis.n == 0:
        amplitudes = rates = jnp.zeros(basis.n, start.direction.dtype)
    else:
        amplitudes, rates = _projected(system, basis, (start.amplitudes, start.amplitude_rates))
    start = dataclasses.replace(start, amplitudes=amplitudes, amplitude_rates=rates)
    return rung(system, basis), start


def rung(system: System, basis: AbstractBasis) -> System:
    """The scene with another basis; without the `KelvinVoigt` viscosity where the strain has no rate."""
    still = basis.n == 0 or isinstance(basis, QuasiStatic)
    forces = tuple(force for force in system.forces if not (still and isinstance(force, KelvinVoigt)))
    return dataclasses.replace(system, basis=basis, forces=forces)


@tracing.run_seldom
def brought(system: System, start: State, basis: AbstractBasis, static: bool, t0: Any) -> tuple[System, State]:
    """The scene on another rung, of which a `Lumped` body has one; `static`: with the strain that rests there at t0."""
    if not isinstance(system.rod, Lumped):
        system, start = on_rung(system, start, basis)
    return system, at_rest(system, start, t0) if static else start


@tracing.run_seldom
def projected(system: System) -> System:
    """The scene for several programs, which do not project the rod again."""
    if isinstance(system.rod, Lumped) or isinstance(system.basis, QuasiStatic):
        return system
    return dataclasses.replace(system, basis=Projected(system.basis, system.body))


def unprojected(system: Any) -> Any:
    """The scene that was `projected`."""
    return dataclasses.replace(system, basis=system.basis.basis) if isinstance(system.basis, Projected) else system


def _projected(system: System, basis: AbstractBasis, amplitudes: Any) -> list:
    rod, pivot, free = continuum.support(system)
    panels = rod.panels(_ORDER, () if pivot is None else (pivot,))
    rigidity = rod.modulus(panels.s) * rod.area(panels.s) * panels.ds
    here, there = (x.strains(rod, panels.s, pivot, free) for x in (system.basis, basis))
    weighted = there * rigidity[None, :]
    stiffness = weighted @ there.T
    empty = jnp.diag(jnp.where(jnp.diagonal(stiffness) == 0, 1.0, 0.0).astype(stiffness.dtype))
    return [solve_positive(stiffness + empty, weighted @ (a @ here)) for a in amplitudes]


def at_rest(system: System, start: State, t0: Any = 0.0) -> State:
    """The start with the strain that its spin, gravity and forces would hold still at time `t0` in s.

    **Raises:** `ValueError` for another strain law than Hooke's.
    """
    check_system(system)
    check_state(system, start, "start")
    if system.basis.n == 0:
        return start
    if isinstance(system.rod, Rod) and not system.rod.linear:
        raise ValueError(
            f"a static strain is of Hooke's law; give start its strain, or leave out law={system.rod.law_name}."
        )
    none = jnp.zeros(0, start.direction.dtype)
    chart = Strains() if system.motion.prescribed else Director()
    q, v = chart.encode(system.motion, dataclasses.replace(start, amplitudes=none, amplitude_rates=none))
    amplitudes = Condensed(system.equations(chart).scene, chart).strain(t0, q, v)
    return dataclasses.replace(start, amplitudes=amplitudes, amplitude_rates=jnp.zeros_like(amplitudes))
