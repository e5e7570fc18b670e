"""Axial modes of a rod that is free to turn."""

import math

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ...core.each_lane import lanewise
from ...core.lanes import summed
from ...integrators.splitting import PhasePoint
from ...motions.state import Placement, State
from .. import energy
from ..equations import DiscreteSystem
from .common import Center, held, watched, with_center
from .normal_modes import AbstractModalSplitting, AxialModes, back

_SERIES = 7  # terms of versine and sine: exact to rounding for turnings up to half a radian


class FreeRotationSplitting(AbstractModalSplitting):
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
    loads: DiscreteSystem | None  # the scene, if it has forces
    field: Float[Array, "n places"]
    center: Center | None

    def __init__(self, scene: DiscreteSystem, t0, start: State):
        self.center = Center.of(scene, t0, start)
        self.scene, self.modes = held(scene, scene.body), AxialModes(scene.body)
        self.loads = self.scene if self.scene.forces else None
        self.field = self.modes.shapes.T @ watched(scene.body.strains)

    def encode(self, state):
        eta, deta = self.modes.encode(state)
        inertia = self.modes.inertia(eta)
        momentum = inertia * state.rate if state.planar else inertia * jnp.cross(state.direction, state.direction_rate)
        return PhasePoint(state.direction, jnp.atleast_1d(momentum), eta, deta, jnp.zeros_like(inertia))

    def decode(self, t, y, turns):
        d, momentum, eta, deta, _ = y
        spin = momentum / self.modes.inertia(eta)
        rate = spin * jnp.stack([-d[1], d[0]]) if d.size == 2 else jnp.cross(spin, d)
        return with_center(State(d, rate, *self.modes.decode(eta, deta), turns), self.center, t)

    def stage(self, stage, known, t, h, y):
        y = self.normalized(self._straighten(stage.before * h, y))
        y = self._load(t + stage.passed * h, stage.kick * h, y)
        return self._drift(known, stage.drift * h, self._straighten(stage.after * h, y))

    def inverse_stage(self, stage, known, t, h, y):
        y = self.normalized(self._straighten(-stage.after * h, self._drift(back(known), -stage.drift * h, y)))
        y = self._load(t + stage.passed * h, -stage.kick * h, y)
        return self.normalized(self._straighten(-stage.before * h, y))

    def normalized(self, y):
        return y._replace(q=_rotated(y.q, y.p, y.turning), turning=jnp.zeros_like(y.turning))

    def _drift(self, circle, t, y: PhasePoint) -> PhasePoint:
        """The oscillators under a constant pull for a time t; the director is to turn by l int 1/J dt."""
        modes, square = self.modes, summed(y.p * y.p)
        (versine, sin), eta, p = self._turned(circle, t), y.strain, y.strain_momentum
        drawn = modes.arms * modes.periods**2
        off = eta - square * drawn
        swept = summed(modes.arms * modes.periods * (sin * off + versine * p))
        pulled = summed(modes.arms * drawn)
        return y._replace(
            strain=square * drawn + (off + (sin * p - versine * off)),
            strain_momentum=p - (sin * off + versine * p),
            turning=y.turning + (t - 2 * (swept + square * pulled * t)),
        )

    def _straighten(self, h, y: PhasePoint) -> PhasePoint:
        """The kick of what is left of the turning."""
        if not y.strain.shape[0]:
            return y
        push, turning = lanewise(_rest)(self.modes, y.strain, summed(y.p * y.p))
        return self._kicked(-h, push, y)._replace(turning=y.turning + 2 * h * turning)

    def _load(self, t, h, y: PhasePoint) -> PhasePoint:
        """The kick of gravity and of forces."""
        gravity = self.scene.gravity
        if gravity is None and self.loads is None:
            return y
        moment, push = lanewise(_loads)(self.modes, gravity, self.loads, t, y.q, y.strain)
        return self._kicked(h, push, y)._replace(p=y.p + h * moment)


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


def _rotated(d: Float[Array, "D lanes"], momentum: Float[Array, "M lanes"], turning) -> Float[Array, "D lanes"]:
    """The director turned about `momentum` by |momentum| turning."""
    square = summed(momentum * momentum) * (turning * turning)
    versine, sin = 0.0, 0.0
    for k in reversed(range(_SERIES)):
        versine = versine * square + (-1) ** k / math.factorial(2 * k + 2)
        sin = sin * square + (-1) ** k / math.factorial(2 * k + 1)
    versine, sin = versine * square, sin * turning
    if d.shape[0] == 2:
        x, y = d
        across = momentum * jnp.stack([-y, x])
    else:
        (x, y, z), (a, b, c) = d, momentum
        across = jnp.stack([b * z - c * y, c * x - a * z, a * y - b * x])
    return d + (sin * across - versine * d)
