"""Oscillators for the axial modes, whatever their number and stiffness: free to turn, or turned as prescribed."""

import abc
import math
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from . import checks, energy
from .chart import Strains
from .equations import Moving, Scene
from .lanes import Numbers, by_number, gathered, scattered
from .motion import Placement, State
from .projection import Projection
from .spectrum import eigh
from .splitting import (
    LONGEST_TURN,
    AbstractSplit,
    Center,
    Split,
    Stage,
    held,
    least,
    lowest,
    per_inertia,
    watched,
    with_center,
)

_SERIES = 7  # terms of versine and sine: exact to rounding for turnings up to half a radian


class AxialModes(eqx.Module):
    """The rod in its axial normal modes, per inertia: amplitudes eta with a = shapes @ eta, of mass 1.

    `rates` (n,), natural angular frequencies in rad/s, `periods` (n,) one over them; `arms` (n,) and `rest`: the moment of
    inertia is rest + |arms + eta|^2, which is 1 at rest; `moments` (n+1,) the first moments; `shapes` (n, n), `inverse` its
    inverse.
    """

    rates: Float[Array, " n"]
    periods: Float[Array, " n"]
    arms: Float[Array, " n"]
    rest: Float[Array, ""]
    moments: Float[Array, " n+1"]
    shapes: Float[Array, "n n"]
    inverse: Float[Array, "n n"]

    def __init__(self, body: Projection):
        dtype = body.mass_matrix.dtype
        # In the widest type there is: of the fastest modes float32 would lose (omega_k / omega_1)^2 times its rounding.
        body = per_inertia(checks.in_type(jnp.result_type(float), body))
        n = body.stiffness_matrix.shape[0]
        mixed = body.mass_matrix[1:, 0]
        if n == 0:
            squares, shapes = jnp.zeros_like(mixed), body.stiffness_matrix
        else:
            # By compliances, 1 / omega^2: rounding is small beside the largest, which are those of the slowest modes.
            compliances, shapes = eigh(body.strain_mass, body.stiffness_matrix)
            squares, shapes = 1 / compliances[::-1], (shapes / jnp.sqrt(compliances)[None, :])[:, ::-1]
        rates, inverse, arms = jnp.sqrt(squares), shapes.T @ body.strain_mass, shapes.T @ mixed
        moments = jnp.concatenate([body.first_moments[:1], shapes.T @ body.first_moments[1:]])
        found = (rates, 1 / rates, arms, 1 - arms @ arms, moments, shapes, inverse)
        self.rates, self.periods, self.arms, self.rest, self.moments, self.shapes, self.inverse = checks.in_type(
            dtype, found
        )

    def inertia(self, eta):
        """Moment of inertia of the stretched rod."""
        arms = self.arms + eta
        return self.rest + arms @ arms

    def moment(self, eta):
        """First moment of the stretched rod."""
        return self.moments[0] + self.moments[1:] @ eta

    def encode(self, state: State) -> tuple[Float[Array, " n"], Float[Array, " n"]]:
        """eta of a state, and its rates over the natural ones."""
        return self.inverse @ state.amplitudes, self.inverse @ state.amplitude_rates / self.rates

    def decode(self, eta, deta) -> tuple[Float[Array, " n"], Float[Array, " n"]]:
        """The amplitudes of the strain, and their rates."""
        return self.shapes @ eta, self.shapes @ (deta * self.rates)


class AbstractOscillating(AbstractSplit):
    """A split whose drift has the oscillators of the axial modes.

    `numbers`: what flows need, number by number, the modes first; `field`: strain of each mode at the places watched.
    """

    modes: eqx.AbstractVar[AxialModes]
    numbers: eqx.AbstractVar[Any]
    field: eqx.AbstractVar[Any]

    def table(self, scheme, h):
        """Versine and sine of each oscillator's angle in the drift of each stage, and in the first drift."""
        drifts = jnp.asarray([stage.drift for stage in scheme.stages], self.modes.rest.dtype)
        circle = jax.lax.stop_gradient(jax.vmap(self._circle)(drifts * h))
        return circle, jax.lax.stop_gradient(self._circle(scheme.drifts[0] * h))

    def _circle(self, t):
        angles = [rate * t for rate in self.numbers[0].rates]
        # By 1 - cos: the rounding of a cosine near one would swell or shrink the oscillation, alike in every step.
        return [2 * jnp.sin(x / 2) ** 2 for x in angles], [jnp.sin(x) for x in angles]

    def _turned(self, circle, t):
        """A known circle of time t, as the function of the rates and of t that it is."""
        angles = [rate * t for rate in self.numbers[0].rates]
        return [_on_circle(v, s, angle) for v, s, angle in zip(*circle, angles, strict=True)]

    def through(self, scheme, table, visit, carry, backwards=False):
        # In a scan: XLA takes several times as long to compile stages written out, which are no faster.
        stages = Stage(*(jnp.asarray(x, self.modes.rest.dtype) for x in zip(*scheme.stages, strict=True)))
        rows = (stages, table[0])
        return jax.lax.scan(lambda carry, row: (visit(carry, *row), None), carry, rows, reverse=backwards)[0]

    @abc.abstractmethod
    def _drift(self, circle, t, y: Split) -> Split:
        """y after a drift for a time t, in which the oscillators turn as `circle` knows."""

    def opened(self, scheme, table, t, h, y):
        del t
        return self._drift(table[1], scheme.drifts[0] * h, y)

    def closed(self, scheme, table, t, h, y):
        del t
        return self.settled(self._drift(_back(table[1]), -scheme.drifts[0] * h, y))

    def _kicked(self, h, push: Numbers, y: Split) -> Split:
        """y after a force on each mode for a time h."""
        periods = self.numbers[0].periods
        kicked = [p + h * f * period for p, f, period in zip(y.strain_momentum, push, periods, strict=True)]
        return y._replace(strain_momentum=y.strain.like(kicked))

    def lowest_strain(self, phases):
        return least(lowest(y.strain, self.field) if len(y.strain) else jnp.zeros_like(y.q[0]) for y in phases)


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

    scene: Scene
    modes: AxialModes
    numbers: Any
    field: Any
    center: Center | None

    def __init__(self, scene: Scene, t0, start: State):
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
        y = self.settled(self._straighten(-stage.after * h, self._drift(_back(known), -stage.drift * h, y)))
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


class Prescribed(AbstractOscillating):
    """A `Driven` rotation: exact oscillators, kicked by the centrifugal pull and by gravity of the moment."""

    scene: Scene  # without its stiffness, which the oscillators have
    modes: AxialModes
    numbers: Any
    field: Any

    def __init__(self, scene: Scene, t0, start: State):
        del t0, start
        self.modes = AxialModes(scene.body)
        slack = eqx.tree_at(lambda s: s.body.stiffness_matrix, scene, jnp.zeros_like(scene.body.stiffness_matrix))
        self.scene = slack
        self.numbers = scattered((self.modes, slack))
        self.field = scattered(self.modes.shapes.T @ watched(scene.body.strains))

    def encode(self, state):
        eta, deta = self.modes.encode(state)
        return Split(None, None, scattered(eta), scattered(deta))

    def decode(self, t, y, turns):
        eta, deta = gathered((y.strain, y.strain_momentum))
        return Strains().decode(self.scene.motion, t, *self.modes.decode(eta, deta), turns)

    def stage(self, stage, known, t, h, y):
        return self._drift(known, stage.drift * h, self._kick(t + stage.passed * h, stage.kick * h, y))

    def undone(self, stage, known, t, h, y):
        return self._kick(t + stage.passed * h, -stage.kick * h, self._drift(_back(known), -stage.drift * h, y))

    def longest_step(self, scheme, ts):
        # Exact oscillators are always stable, but gravity and a drive that turn further in a step are not seen.
        del scheme
        motion: Any = self.scene.motion
        fastest = jnp.max(jnp.abs(jax.vmap(lambda t: motion.turning(t)[1])(ts)))
        return jnp.minimum(math.pi / self.modes.rates[0], LONGEST_TURN / jnp.maximum(fastest, 1e-30))

    def _drift(self, circle, t, y: Split):
        pairs = list(zip(self._turned(circle, t), y.strain, y.strain_momentum, strict=True))
        return y._replace(
            strain=y.strain.like([x + (s * p - v * x) for (v, s), x, p in pairs]),
            strain_momentum=y.strain.like([p - (s * x + v * p) for (v, s), x, p in pairs]),
        )

    def _kick(self, t, h, y: Split):
        modes, scene = self.numbers
        return self._kicked(h, by_number(_push)(modes, scene, t, y.strain), y)


def _rest(modes: AxialModes, eta, square):
    """Slopes, by the amplitudes and by the momentum squared, of what is left of the turning."""

    def energy_left(eta, square):
        return energy.kinetic_momentum(modes, eta, square) - square * (1 - 2 * (modes.arms @ eta)) / 2

    return jax.grad(energy_left, argnums=(0, 1))(eta, square)


def _loads(modes: AxialModes, gravity, loads: Scene | None, t, d, eta):
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


def _push(modes: AxialModes, scene: Scene, t, eta):
    equations = Moving(scene, Strains())
    amplitudes = modes.shapes @ eta
    still = jnp.zeros_like(amplitudes)
    push = jax.grad(equations.function, argnums=1)(t, amplitudes, still)
    if scene.forces:
        push = push + equations.force(t, amplitudes, still)
    return modes.shapes.T @ push / scene.body.mass_matrix[0, 0]


def _back(circle):
    """The same angles backwards."""
    versine, sin = circle
    return versine, [-x for x in sin]


@jax.custom_jvp
def _on_circle(versine, sin, angle):
    """1 - cos(angle) and sin(angle), which are known."""
    del angle
    return versine, sin


@_on_circle.defjvp
def _along_circle(known, rates):
    versine, sin = _on_circle(*known)
    return (versine, sin), (sin * rates[2], (1 - versine) * rates[2])


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
