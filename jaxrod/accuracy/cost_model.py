"""What a run costs: its stages, and what a scene takes besides, as measured (`benchmarks/calibration.py` writes the table)."""

import functools
import importlib.resources
import json
from typing import Any

import jax.numpy as jnp
import numpy as np

from ..core import precision
from ..integrators.multistep import AbstractMultistep
from ..integrators.symplectic import AbstractSymplectic
from ..mechanics.system import System
from ..shapes.basis import QuasiStatic


@functools.cache
def _table() -> dict[str, Any]:
    return json.loads(importlib.resources.files("jaxrod.accuracy").joinpath("stage_costs.json").read_text())


def seconds(system: System, solver: Any, steps: float) -> float:
    """Computing time of one scene among many, on one core of the machine that the table was measured on."""
    dtype, n = precision.float_type(system), system.basis.n
    spent = steps * stages(solver) * stage(way_of(system, solver), dtype, n)
    if isinstance(solver, AbstractMultistep):
        spent += solver.starting_stages * stage("flat", dtype, n)
    return 1e-9 * (spent + _table()["scene"][jnp.dtype(dtype).name])


def stage(way: str, dtype: Any, n: int) -> float:
    """Nanoseconds of a stage for each scene, with n strain shapes; between the measured n, in proportion."""
    types = _table()["ns"][way]
    # By Hooke's law float32 has other steps than "flat" ones, so these were measured in float64, of which they take no more.
    counts, ns = zip(*types.get(jnp.dtype(dtype).name, types["float64"]), strict=True)
    beyond = max(n / counts[-1], 1.0)
    return float(np.interp(n, counts, ns)) * beyond**2


def stages(solver: Any) -> int:
    """Evaluations of the forces in a step."""
    if isinstance(solver, AbstractMultistep):
        return 1
    return len(solver.kicks) if isinstance(solver, AbstractSymplectic) else solver.tableau.num_stages


def way_of(system: System, solver: Any) -> str:
    """The kind of step, as the table has it."""
    if isinstance(solver, AbstractMultistep):
        return "multistep"
    if not isinstance(solver, AbstractSymplectic):
        return "condensed" if isinstance(system.basis, QuasiStatic) else "adaptive"
    if system.motion.prescribed:
        return "prescribed"
    return "flat" if system.splits_flat and not solver.small_kicks else "axial"
