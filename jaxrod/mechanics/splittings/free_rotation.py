"""Axial modes of a rod that is free to turn."""

import math
from typing import Any

import jax
import jax.numpy as jnp

from ...core.scalarize import Numbers, by_number, gathered, scattered
from ...integrators.splitting import Split
from ...motions.state import Placement, State
from .. import energy
from ..equations import DiscreteSystem
from .common import Center, held, watched, with_center
from .normal_modes import AbstractOscillating, AxialModes, back

_SERIES = 7  # terms of versine and sine: exact to rounding for turnings up to half a radian


class Axial(AbstractOscillating):
    """Axial normal modes and a director: exact oscillators that turn, whatever their number and stiffness.

    The energy T + V with the angular momentum l and J the moment of inertia of the stretched rod is cut in three:

    - drift, 1/2 |p|^2 + 1/2 omega^2 eta^2 + 1/2 l^2 (1 - 2 arms . eta): oscillators under a constant pull, whose
      integral turns the director;
    - kick, 1/2 l^2 (1/J - 1 + 2 arms . eta): what is left of the turning, of second order in the strain;
    - kick, gravity and other loads on l and p.

    Nothing is singular at rest, a step may be longer than an axial period, and what is left to the kicks is small.
    Coordinates: q = director, p = angular momentum (one number in the plane, three in space), strain = eta, and its
    momentum over the rate.
    """

    scene: DiscreteSystem
    modes: AxialModes
    numbers: Any
    field: Any
    center: Center | None

    def __init__(self, scene: DiscreteSystem, t0, start: State):
        self.center = Center.of(scene, t0, start)
        self.scene, self.modes = held(scene, scene.body), AxialModes(scene.body)
        loads = self.scene if self.scene.forces else None
        self.numbers = scattered((self.modes, self.scene.gravity, loads))
        self.field = scattered(self.modes.shapes.T @ watched(scene.body.strains))

    def encode(self, state):
        eta, deta = self.modes.encode(state)
        inertia = self.modes.inertia(eta)
        momentum = inertia * state.rate if state.planar else inertia * jnp.cross(state.direction, state.direction_rate)
        d, momentum = scattered((state.direction, jnp.atleast_1d(momentum)))
        return Split(d, momentum, scattered(eta), scattered(deta), jnp.zeros_like(inertia))

    def decode(self, t, y, turns):
        d, momentum, eta, deta, _ = gathered(y)
        spin = momentum / self.modes.inertia(eta)
        rate = spin * jnp.stack([-d[1], d[0]]) if d.size == 2 else jnp.cross(spin, d)
        return with_center(State(d, rate, *self.modes.decode(eta, deta), turns), self.center, t)

    def stage(self, stage, known, t, h, y):
        y = self.settled(self._straighten(stage.before * h, y))
        y = self._load(t + stage.passed * h, stage.kick * h, y)
        return self._drift(known, stage.drift * h, self._straighten(stage.after * h, y))

    def undone(self, stage, known, t, h, y):
        y = self.settled(self._straighten(-stage.after * h, self._drift(back(known), -stage.drift * h, y)))
        y = self._load(t + stage.passed * h, -stage.kick * h, y)
        return self.settled(self._straighten(-stage.before * h, y))

    def settled(self, y):
        return y._replace(q=_rotated(y.q, y.p, y.turning), turning=jnp.zeros_like(y.turning))

    def _drift(self, circle, t, y: Split) -> Split:
        """The oscillators under a constant pull for a time t; the director is to turn by l int 1/J dt."""
        modes, square = self.numbers[0], sum(x * x for x in y.p)
        strain, momentum, swept, pulled = [], [], 0.0, 0.0
        for (v, s), period, arm, eta, p in zip(
            self._turned(circle, t), modes.periods, modes.arms, y.strain, y.strain_momentum, strict=True
        ):
            drawn = arm * period * period
            off = eta - square * drawn
            # Written so, and with `swept` in full: XLA makes slower code of what is shorter here.
            strain.append(square * drawn + (off + (s * p - v * off)))
            momentum.append(p - (s * off + v * p))
            swept = swept + arm * period * (s * off + v * p)
            pulled = pulled + arm * drawn
        turning = y.turning + (t - 2 * (swept + square * pulled * t))
        return y._replace(strain=y.strain.like(strain), strain_momentum=y.strain.like(momentum), turning=turning)

    def _straighten(self, h, y: Split) -> Split:
        """The kick of what is left of the turning."""
        modes, square = self.numbers[0], sum(x * x for x in y.p)
        if not len(modes.rates):
            return y
        push, turning = by_number(_rest)(modes, y.strain, square)
        return self._kicked(-h, push, y)._replace(turning=y.turning + 2 * h * turning)

    def _load(self, t, h, y: Split) -> Split:
        """The kick of gravity and of forces."""
        modes, gravity, loads = self.numbers
        if gravity is None and loads is None:
            return y
        moment, push = by_number(_loads)(modes, gravity, loads, t, y.q, y.strain)
        return self._kicked(h, push, y)._replace(p=y.p.moved(h, moment))


def _rest(modes: AxialModes, eta, square):
    """Slopes, by the amplitudes and by the momentum squared, of what is left of the turning."""

    def energy_left(eta, square):
        return energy.kinetic_momentum(modes, eta, square) - square * (1 - 2 * (modes.arms @ eta)) / 2

    return jax.grad(energy_left, argnums=(0, 1))(eta, square)


def _loads(modes: AxialModes, gravity, loads: DiscreteSystem | None, t, d, eta):
    """Moment on the rod and force on each mode, per inertia."""
    pull, push = jnp.zeros_like(d), jnp.zeros_like(eta)
    if gravity is not None:
        pull, push = jax.grad(lambda d, eta: -energy.gravity_pivoted(modes, gravity, eta, d), argnums=(0, 1))(d, eta)
    if loads is not None:
        amplitudes, still = modes.shapes @ eta, jnp.zeros_like(eta)
        state = State(d, jnp.zeros_like(d), amplitudes, still, jnp.zeros_like(d[0]))

        def power(virtual_d, virtual_eta):
            virtual = Placement(virtual_d, modes.shapes @ virtual_eta, None)
            return loads.power(t, state, virtual) / loads.body.mass_matrix[0, 0]

        more = jax.grad(power, argnums=(0, 1))(jnp.zeros_like(d), still)
        pull, push = pull + more[0], push + more[1]
    moment = (d[0] * pull[1] - d[1] * pull[0])[None] if d.size == 2 else jnp.cross(d, pull)
    return moment, push


def _rotated(d: Numbers, momentum: Numbers, turning) -> Numbers:
    """The director turned about `momentum` by |momentum| turning."""
    square = sum(x * x for x in momentum) * (turning * turning)
    versine, sin = 0.0, 0.0
    for k in reversed(range(_SERIES)):
        versine = versine * square + (-1) ** k / math.factorial(2 * k + 2)
        sin = sin * square + (-1) ** k / math.factorial(2 * k + 1)
    versine, sin = versine * square, sin * turning
    if len(d) == 2:
        x, y = d
        sin = sin * momentum[0]
        return d.like([x - (versine * x + sin * y), y + (sin * x - versine * y)])
    (x, y, z), (a, b, c) = d, momentum
    across = (b * z - c * y, c * x - a * z, a * y - b * x)
    return d.like([u + (sin * w - versine * u) for u, w in zip(d, across, strict=True)])
