"""From one rung of strain shapes to another: the same rod, motion and start."""

import dataclasses
from typing import Any

import jax.numpy as jnp

from . import continuum
from .basis import AbstractBasis
from .motion import Flight, State
from .rod import Lumped
from .system import System

_ORDER = 24  # nodes for each panel


def on_rung(system: System, start: State, basis: AbstractBasis) -> tuple[System, State]:
    """The scene with another basis, and the start whose strain is nearest in strain energy.

    **Raises:** `ValueError` for a `Lumped` body, whose strain is uniform and which has no rod to take other shapes of.
    """
    if isinstance(system.rod, Lumped):
        raise ValueError("a Lumped body has no shapes of strain but its own; give a Rod to compare rungs.")
    if basis.n == 0 or system.basis.n == 0:
        amplitudes = rates = jnp.zeros(basis.n, start.direction.dtype)
    else:
        amplitudes, rates = _projected(system, basis, (start.amplitudes, start.amplitude_rates))
    start = dataclasses.replace(start, amplitudes=amplitudes, amplitude_rates=rates)
    return dataclasses.replace(system, basis=basis), start


def _projected(system: System, basis: AbstractBasis, amplitudes: Any) -> list:
    rod, pivot, free = continuum.support(system)
    panels = rod.panels(_ORDER, () if pivot is None else (pivot,))
    rigidity = rod.modulus(panels.s) * rod.area(panels.s) * panels.ds
    here, there = (x.strains(rod, panels.s, pivot, free) for x in (system.basis, basis))
    weighted = there * rigidity[None, :]
    return [jnp.linalg.solve(weighted @ there.T, weighted @ (a @ here)) for a in amplitudes]


def at_rest(system: System, start: State) -> State:
    """The start with the strain that its spin and gravity would hold still, of Hooke's law."""
    if system.basis.n == 0:
        return start
    body, square = system.body, start.direction_rate @ start.direction_rate
    pull = square * body.mass_matrix[1:, 0]
    if system.gravity is not None and not isinstance(system.motion, Flight):
        along = -system.gravity * start.direction[-1] if system.gravity.ndim == 0 else system.gravity @ start.direction
        pull = pull + along * body.first_moments[1:]
    amplitudes = jnp.linalg.solve(body.stiffness_matrix - square * body.strain_mass, pull)
    return dataclasses.replace(start, amplitudes=amplitudes, amplitude_rates=jnp.zeros_like(amplitudes))
