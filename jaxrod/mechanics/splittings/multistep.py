"""Symmetric multistep methods: one evaluation of the forces a step, for uniform strain.

    sum_j alpha_j q_{n+j} = h^2 sum_j beta_j q''_{n+j}

Where the acceleration is a function of the position alone, as of uniform strain in q = (1 + eps) d, the past of a motion
holds what splitting methods evaluate ten times a step for.  The alphas are Quinlan and Tremaine's; the betas follow from them
by the conditions of order.  Symmetric ones keep the energy of an oscillator without a trend, as symplectic methods do.

The past is kept in differences of positions, whose rounding is that of the increments.
"""

import functools
import itertools
from fractions import Fraction
from typing import ClassVar, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from ...core.scalarize import Numbers
from ...integrators.symplectic import BlanesMoan6
from .common import AbstractStepped, Split
from .uniform_strain import Flat

_STARTER, _SUBSTEPS = BlanesMoan6(), 2  # in a step back


class AbstractMultistep(eqx.Module):
    """A symmetric linear multistep method for q'' = f(t, q); explicit, as its first and last beta are zero.

    By equal steps alone: give `simulate` its `n_steps`; save times that are equally spaced cost little, others a new past
    each.  Of a run that stops early nothing is kept but its code.  Forward derivatives take `adjoint=diffrax.ForwardMode()`;
    for reverse ones take `BlanesMoan6()`.
    """

    accuracy: ClassVar[int]  # its order
    alphas: ClassVar[tuple[int, ...]]

    @property
    def past(self) -> int:
        """How many differences of positions, and accelerations, it looks back on."""
        return len(self.alphas) - 2

    @property
    def starting_stages(self) -> int:
        """Evaluations of the forces by which a past is made."""
        return self.past * _SUBSTEPS * len(_STARTER.kicks)

    @property
    def weights(self) -> tuple[float, ...]:
        """Of the accelerations, the newest first: beta_1 .. beta_{K-1}, the same backwards."""
        return _weights(self.alphas)

    @property
    def differences(self) -> tuple[int, ...]:
        """Of the differences, the newest first, for the next one: alpha(z) / (z - 1), the same backwards."""
        return tuple(-int(x) for x in np.cumsum(self.alphas)[1:-1])

    @property
    def velocity(self) -> tuple[float, ...]:
        """h c_j of the accelerations, the newest first: with the newest difference over h they make the velocity."""
        return _velocity(self.past)

    @property
    def stable_phase(self) -> float:
        """The longest step, as the angle of an oscillator, at which nothing grows."""
        return _stable_phase(self.alphas)


class QuinlanTremaine10(AbstractMultistep):
    """Order 10.  Quinlan, Tremaine (1990), Astron. J. 100, 1694.  For errors down to about 1e-9.

    >>> import jaxrod
    >>> rod = jaxrod.Rod(length=1.0, section=jaxrod.Uniform(0.025), young=1e7, density=1200.0)
    >>> system = jaxrod.System(rod, jaxrod.Rotation(), gravity=9.81)
    >>> sol = jaxrod.simulate(system, system.state(rate=15.0), t1=1.0, solver=jaxrod.QuinlanTremaine10(), n_steps=600)
    >>> print(sol.angle.round(4))
    [14.601]
    """

    accuracy: ClassVar = 10
    alphas: ClassVar = (1, -1, 1, -1, 1, -2, 1, -1, 1, -1, 1)


class QuinlanTremaine12(AbstractMultistep):
    """Order 12.  Quinlan, Tremaine (1990), Astron. J. 100, 1694.  For errors down to rounding.

    >>> import jaxrod
    >>> rod = jaxrod.Rod(length=1.0, section=jaxrod.Uniform(0.025), young=1e7, density=1200.0)
    >>> system = jaxrod.System(rod, jaxrod.Rotation(), gravity=9.81)
    >>> sol = jaxrod.simulate(system, system.state(rate=15.0), t1=1.0, solver=jaxrod.QuinlanTremaine12(), n_steps=1000)
    >>> print(sol.angle.round(4))
    [14.601]
    """

    accuracy: ClassVar = 12
    alphas: ClassVar = (1, -2, 2, -1, 0, 0, 0, 0, 0, -1, 2, -2, 1)


class Past(NamedTuple):
    """The newest position; differences of positions and accelerations, the newest first."""

    q: Numbers
    differences: tuple[Numbers, ...]
    accelerations: tuple[Numbers, ...]


class Remembered(AbstractStepped):
    """Uniform strain with its past."""

    has_past: ClassVar = True
    flat: Flat

    def steps_at_once(self, scheme):
        return scheme.past  # after so many each part of the past is at its old place, and nothing was copied

    def encode(self, state):
        return self.flat.encode(state)

    def decode(self, t, y, turns):
        return self.flat.decode(t, y, turns)

    def table(self, scheme, h):
        del scheme, h

    def opened(self, scheme: AbstractMultistep, table, t, h, y):
        """Runs back for a past, by short steps of another method."""
        back = -h / _SUBSTEPS
        positions, accelerations = [y.q], [self.flat.force(t, y.q)]
        for k in range(scheme.past):
            for j in range(_SUBSTEPS):
                y = self.flat.whole_step(_STARTER, None, t + (k * _SUBSTEPS + j) * back, back, y)
            positions.append(y.q)
            accelerations.append(self.flat.force(t - (k + 1) * h, y.q))
        differences = tuple(here.moved(-1.0, before) for here, before in itertools.pairwise(positions))
        return Past(positions[0], differences, tuple(accelerations[:-1]))

    def closed(self, scheme: AbstractMultistep, table, t, h, y):
        """Position and velocity now."""
        velocity = y.differences[0].like([d / h for d in y.differences[0]])
        for weight, acceleration in zip(scheme.velocity, y.accelerations, strict=True):
            velocity = velocity.moved(weight * h, acceleration)
        return Split(y.q, velocity)

    def step(self, scheme: AbstractMultistep, table, t, h, y):
        weights, half, past = scheme.weights, scheme.past // 2, y.accelerations
        push = past[half].like([weights[half] * a for a in past[half]])
        for weight, newer, older in zip(weights[:half], past, reversed(past), strict=False):
            push = push.moved(weight, newer.moved(1.0, older))
        ahead = push.like([h * h * a for a in push])
        for weight, difference in zip(scheme.differences, y.differences, strict=True):
            ahead = ahead.moved(float(weight), difference) if weight else ahead
        q = y.q.moved(1.0, ahead)
        return Past(q, (ahead, *y.differences[:-1]), (self.flat.force(t + h, q), *y.accelerations[:-1]))

    def longest_step(self, scheme: AbstractMultistep, ts):
        del ts
        return scheme.stable_phase / jnp.sqrt(self.flat.numbers[0].body.stiffness_matrix[0, 0])

    def lowest_strain(self, phases):
        return self.flat.lowest_strain(phases)


@functools.cache
def _weights(alphas: tuple[int, ...]) -> tuple[float, ...]:
    """Exact for q = t^p up to p = K + 1, about the middle: odd powers come by symmetry."""
    steps = len(alphas) - 1
    middle = Fraction(steps, 2)
    half = range(1, steps // 2 + 1)
    powers = range(0, 2 * len(half), 2)
    rows = [[(j - middle) ** p * (1 if 2 * j == steps else 2) for j in half] for p in powers]
    moments = [sum((a * (j - middle) ** (p + 2) for j, a in enumerate(alphas)), Fraction(0)) for p in powers]
    sums = [moment / ((p + 1) * (p + 2)) for moment, p in zip(moments, powers, strict=True)]
    first = [float(x) for x in _solved(rows, sums)]
    return (*first, *first[-2::-1])


@functools.cache
def _velocity(past: int) -> tuple[float, ...]:
    """Exact for q = t^(p + 2): 0 = q'(0) = q(0) - q(-1) + sum_j c_j q''(-j)."""
    rows = [[Fraction(-j) ** p for j in range(past)] for p in range(past)]
    sums = [Fraction((-1) ** p, (p + 1) * (p + 2)) for p in range(past)]
    return tuple(float(x) for x in _solved(rows, sums))


def _solved(rows: list[list[Fraction]], sums: list[Fraction]) -> list[Fraction]:
    """Gauss and Jordan, in fractions."""
    table = [[*row, total] for row, total in zip(rows, sums, strict=True)]
    for i in range(len(table)):
        pivot = next(k for k in range(i, len(table)) if table[k][i])
        table[i], table[pivot] = table[pivot], table[i]
        table[i] = [x / table[i][i] for x in table[i]]
        for k in range(len(table)):
            if k != i:
                table[k] = [x - table[k][i] * y for x, y in zip(table[k], table[i], strict=True)]
    return [row[-1] for row in table]


@functools.cache
def _stable_phase(alphas: tuple[int, ...]) -> float:
    """Where a root of alpha(z) + phase^2 beta(z) first leaves the unit circle."""
    betas = np.array([0.0, *_weights(alphas), 0.0])
    for phase in np.arange(1e-2, 3.0, 1e-3):
        if np.max(np.abs(np.roots(np.array(alphas) + phase**2 * betas))) > 1 + 1e-6:
            return float(phase - 1e-3)
    return 3.0
