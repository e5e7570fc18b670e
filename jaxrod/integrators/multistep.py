"""Symmetric multistep methods: one evaluation of the forces a step, for uniform strain.

    sum_j alpha_j q_{n+j} = h^2 sum_j beta_j q''_{n+j}

Where the acceleration is a function of the position alone, as of uniform strain in q = (1 + eps) d, the past of a motion
holds what splitting methods evaluate ten times a step for.  The alphas are Quinlan and Tremaine's; the betas follow from them
by the conditions of order.  Symmetric ones keep the energy of an oscillator without a trend, as symplectic methods do.

The past is kept in differences of positions, whose rounding is that of the increments.
"""

import functools
from fractions import Fraction
from typing import ClassVar

import equinox as eqx
import numpy as np

from .symplectic import BlanesMoan6

STARTER, SUBSTEPS = BlanesMoan6(), 2  # of each step back, by which a past is made


class AbstractMultistep(eqx.Module):
    """A symmetric linear multistep method for q'' = f(t, q); explicit, as its first and last beta are zero.

    By equal steps alone: give `simulate` its `n_steps`; save times that are equally spaced cost little, others a new past
    each.  Of a run that stops early nothing is kept but its code.  Reverse derivatives are those of `BlanesMoan6` with as many
    steps, which runs again and is undone; forward ones take `adjoint=diffrax.ForwardMode()`.
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
        return self.past * SUBSTEPS * len(STARTER.kicks)

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
