"""Natural frequencies of a scene, how far they are from the exact rod's, and its modes about any equilibrium."""

import dataclasses
import warnings

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float

from .. import continuum
from ..core import linear_algebra, precision, progress, tracing, validation
from ..motions.state import State
from ..motions.stiffening import warn_of_forces
from ..rods.rod import Rod
from ..shapes.projection import Projection
from . import equilibria
from .chart import Local
from .system import System, check_state, check_system

_THICK = 0.01  # relative error of the first frequency that is worth a warning


def natural_frequencies(system: System) -> Float[Array, " n"]:
    """Axial natural frequencies in Hz, ascending, at rest and without gravity: one for each strain shape.

    For uniform strain sqrt(c l0^2 / I) / 2 pi; a rigid rod has none.  Shapes on a piece of no length, where the pivot
    lies on an end, have inf.  Differentiable in every number of the rod and in the pivot; by a pivot on an end, on a break
    where rigidity or mass per length jump, and for shapes that belong to pieces on any break, the derivative is NaN.
    Forces are left out: for a scene with a spring take `jaxrod.modes(system)`.

    **Warns** for a rod so thick that lateral inertia, which the model leaves out, matters: by 1 % or more.  Warns of
    forces that change the axial stiffness, but not under `jit`, `vmap` or `grad`.

    >>> import jaxrod
    >>> cone = jaxrod.Rod(length=1.0, section=jaxrod.Cone(0.02, 0.03), young=1e7, density=1200.0)
    >>> print(jaxrod.natural_frequencies(jaxrod.System(cone, jaxrod.Rotation())).round(3))
    [22.972]
    >>> print(jaxrod.natural_frequencies(jaxrod.System(cone, jaxrod.Rotation(), jaxrod.Ritz(3))).round(3))
    [ 19.239  68.213 158.859]
    """
    check_system(system)
    precision.warn_if_lowered(precision.float_type(system), system, ())
    warn_of_forces("natural_frequencies", system)
    return _looked_at(system)


def _looked_at(system: System) -> Float[Array, " n"]:
    with progress.line("natural_frequencies"):
        frequencies, lowered = _natural_frequencies(system)
    if lowered is not None and validation.fails(lambda lowered: lowered < _THICK, lowered):
        warnings.warn(
            f"lateral inertia, which the model leaves out, may lower the first frequency of so thick a rod by "
            f"{100 * float(lowered):.2g} %; see jaxrod.model_limits(system).",
            stacklevel=3,
        )
    return frequencies


@tracing.run_seldom
def _natural_frequencies(system):
    """The frequencies, and by which part lateral inertia may lower the first: nu^2 k^2 r^2 / 4, Poisson's ratio nu = 1/2."""
    frequencies = _frequencies_of(system.body, system.basis.n)
    if not isinstance(system.rod, Rod) or system.basis.n == 0:
        return frequencies, None
    square = system.rod.volume / system.rod.length / np.pi
    return frequencies, (np.pi * frequencies[0] / system.rod.wave_speed) ** 2 * square / 4


def _frequencies_of(body: Projection, n: int) -> Float[Array, " n"]:
    if n < 2:
        return jnp.sqrt(jnp.diagonal(body.stiffness_matrix) / jnp.diagonal(body.strain_mass)) / (2 * jnp.pi)
    # M v = K v / omega^2: the lowest frequencies, the largest 1 / omega^2, come out best.
    compliance, _ = linear_algebra.eigh(body.strain_mass, body.stiffness_matrix)
    rigid = compliance <= jnp.finfo(compliance.dtype).eps * compliance[-1] / 8
    return jnp.where(rigid, jnp.inf, 1 / jnp.sqrt(jnp.where(rigid, 1.0, compliance)))[::-1] / (2 * jnp.pi)


def frequency_error(system: System) -> Float[Array, " n"]:
    """Error of `natural_frequencies` against the exact rod, in percent, both without forces (which it warns of likewise).

    >>> import jaxrod
    >>> uniform = jaxrod.Rod(length=1.0, section=jaxrod.Uniform(0.025), young=1e7, density=1200.0)
    >>> print(jaxrod.frequency_error(jaxrod.System(uniform, jaxrod.Rotation())).round(2))
    [10.27]
    """
    check_system(system)
    warn_of_forces("frequency_error", system)
    bare = dataclasses.replace(system, forces=())
    frequencies = _looked_at(bare)
    if frequencies.size == 0:
        return frequencies
    return _percent_above(frequencies, continuum.natural_frequencies(bare, frequencies.shape[0]))


@tracing.at_once
def _percent_above(found, exact):
    return 100 * (found / exact - 1)


def critical_rate(system: System) -> Float[Array, ""]:
    """The prescribed turning rate in rad/s beyond which this scene's strain finds no rest: its lowest axial frequency.

    The exact rod gives way earlier: `continuum.critical_rate`.  Turning freely, with its angular momentum conserved, a
    rod has no critical rate.  Forces are left out, and warned of as by `natural_frequencies`.

    **Raises:** `ValueError` for a rigid rod, and for another strain law than Hooke's.

    >>> import jaxrod
    >>> rod = jaxrod.Rod(length=1.0, section=jaxrod.Uniform(0.025), young=1e7, density=1200.0)
    >>> print(jaxrod.critical_rate(jaxrod.System(rod, jaxrod.Rotation())).round(2))
    158.11
    """
    check_system(system)
    if system.basis.n == 0:
        raise ValueError("basis=Ritz(0) is rigid and holds at any rate; take Ritz(1) or more.")
    if isinstance(system.rod, Rod) and not system.rod.linear:
        raise ValueError(
            f"law={system.rod.law_name} stiffens or softens with strain, and no one rate is critical; leave out law=, or ask "
            "jaxrod.modes about the equilibrium at each spin."
        )
    warn_of_forces("critical_rate", system)
    return 2 * jnp.pi * _looked_at(system)[0]


class Modes(eqx.Module):
    """Small motions about an equilibrium, each of the form Re(shape exp((growth + 2 pi i frequency) t)).

    `frequency` (N,) in Hz, ascending; `growth` (N,) in 1/s: positive where the equilibrium is unstable, negative where
    the motion dies out; of a motion without oscillation the faster growing of its two.  Shapes, scaled so that the
    largest number is 1, and complex where parts do not move in step (spin, friction): `direction` (N, D), the change of
    the director in the frame that turns with the rod, and `amplitudes` (N, n) of the strain.
    """

    frequency: Float[Array, " N"]
    growth: Float[Array, " N"]
    direction: Complex[Array, "N D"]
    amplitudes: Complex[Array, "N n"]

    @property
    def stable(self) -> Array:
        """Whether nothing grows."""
        return jnp.all(self.growth <= 0)

    def __repr__(self):
        shape = jnp.shape(self.frequency)
        known = len(shape) == 1 and tracing.known(self.frequency)
        return f"Modes in {self.frequency.dtype}\n{self}" if known else f"Modes of shape {shape}"

    def __str__(self):
        lines = ["frequency, Hz   growth, 1/s   swing   strain"]
        for f, growth, d, a in zip(self.frequency, self.growth, self.direction, self.amplitudes, strict=True):
            swing, strain = (float(jnp.max(jnp.abs(x), initial=0.0)) for x in (d, a))
            lines.append(f"{f:13.6g} {growth:13.4g} {swing:7.3f} {strain:8.3f}")
        return "\n".join(lines)


def modes(system: System, about: State | None = None) -> Modes:
    """All small motions about an equilibrium: swing, strain, and where the rod turns or rubs, what couples them.

    **Arguments:** `about`, a state of rest or steady turning such as `equilibrium(system, ...)` finds, which is also the
    default.  In space the turning is about the vertical.  The centre of mass of a rod in flight is left out.

    **Raises:** `ValueError` for a state that is none.

    >>> import jax.numpy as jnp, jaxrod
    >>> rod = jaxrod.Rod(length=1.0, section=jaxrod.Uniform(0.025), young=1e7, density=1200.0)
    >>> print(jaxrod.modes(jaxrod.System(rod, jaxrod.Rotation(), gravity=9.81)))
    frequency, Hz   growth, 1/s   swing   strain
         0.610341             0   1.000    0.000
          25.1646             0   0.000    1.000
    """
    check_system(system)
    about = equilibria.equilibrium(system) if about is None else about
    check_state(system, about, "about")
    with progress.line("modes"):
        frequency, growth, direction, amplitudes, unbalanced = _modes(system, about)
    if validation.fails(lambda x: x < 100 * equilibria.unbalanced_at_most(x.dtype), unbalanced):
        raise ValueError(
            f"about= is no equilibrium, accelerations are {float(unbalanced):.1e} of the natural ones; take one from "
            "jaxrod.equilibrium(system, ...)."
        )
    return Modes(frequency, growth, direction, amplitudes)


@tracing.run_seldom
def _modes(system, about):
    spin = about.rate if about.planar else about.azimuth_rate
    scene = system.discrete
    chart = equilibria.chart_at(scene, about.direction, spin)
    equations = scene.equations(chart)
    phase = equations.encode(0.0, about)
    q, rate = phase.q, equilibria.natural_rate(scene)

    def push(q, v):
        return equations.acceleration(0.0, q, v)

    zero = jnp.zeros_like(q)
    unbalanced = jnp.max(jnp.abs(jnp.concatenate([push(q, zero), rate * phase.v])), initial=0.0) / rate**2
    by_q, by_v = jax.jacfwd(push, argnums=(0, 1))(q, zero)
    n = q.size
    matrix = jnp.block([[jnp.zeros((n, n), q.dtype), jnp.eye(n, dtype=q.dtype)], [by_q / rate**2, by_v / rate]])
    if n == 0:  # a rigid rod that is driven has no motion of its own
        none = jnp.zeros((0, about.direction.size), complex)
        return zero, zero, none, none[:, :0], unbalanced
    w, v = linear_algebra.eig(matrix)
    # What is rounding: of a double zero, where the rod turns freely, its root; of growth a little of the largest.
    eps, largest = float(jnp.finfo(matrix.dtype).eps), jnp.max(jnp.abs(w), initial=0.0)
    w = jnp.where(jnp.abs(w) <= 7 * eps**0.5 * largest, 0.0, w)
    w = jnp.where(jnp.abs(w.real) <= max(1e-11, 100 * eps) * largest, 1j * w.imag, w)
    upper = jnp.lexsort((-w.real, -w.imag))[:n][::-1]  # one of each pair: the upper, of real ones the faster growing
    w, v = w[upper], v[:n, upper]
    v = v / jnp.take_along_axis(v, jnp.argmax(jnp.abs(v), axis=0)[None, :], axis=0)
    across = chart.tangents() if isinstance(chart, Local) else jnp.zeros((about.direction.size, 0))
    slopes = across.shape[1]
    return rate * w.imag / (2 * jnp.pi), rate * w.real, (across @ v[:slopes]).T, v[slopes:].T, unbalanced
