"""The equations of motion cut into flows that are known exactly.

A split has a *drift*, the motion without loads, and a *kick*, the loads at a frozen position, which is minus a gradient
that automatic differentiation takes from the energies.  Symmetric compositions of the two (`symplectic.py`) are methods
of high order that keep the energy without a trend.

Everything is per unit of the moment of inertia at rest, and number by number (`lanes.py`): a phase is a pytree of scalars,
which become vectors of lanes under `vmap`.
"""

import abc
import functools
import math
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from . import energy
from .chart import Embedded, Strains
from .equations import Moving, Scene
from .lanes import Numbers, by_number, gathered, scattered
from .motion import Flight, Placement, Rotation, State
from .projection import Projection
from .spectrum import eigh

_SERIES = 7  # terms of cos and sin: exact to rounding for turnings up to half a radian


class Split(NamedTuple):
    """What moves: q and its momentum p; where q is the director alone the strain and its momentum; `Numbers` all.

    `turning`: int 1/J dt by which the director is behind.
    """

    q: Any
    p: Any
    strain: Any = None
    strain_momentum: Any = None
    turning: Any = None


class AbstractSplit(eqx.Module):
    """A scene as drift and kick."""

    @abc.abstractmethod
    def encode(self, state: State) -> Split:
        """The numbers of a state."""

    @abc.abstractmethod
    def decode(self, t, y: Split, turns) -> State:
        """The state at time t."""

    @abc.abstractmethod
    def table(self, scheme, h) -> Any:
        """What steps of size h by the coefficients of `scheme` need, once for all of them."""

    @abc.abstractmethod
    def step(self, scheme, table, t, h, y: Split) -> Split:
        """One step from time t: kick, drift, ..., kick, drift, where the last drift is that of two steps in a row."""

    @abc.abstractmethod
    def opened(self, scheme, table, h, y: Split) -> Split:
        """y after the first drift of a step, which steps begin with."""

    @abc.abstractmethod
    def closed(self, scheme, table, h, y: Split) -> Split:
        """y without the drift that the last step was ahead."""

    def whole_step(self, scheme, table, t, h, y: Split) -> Split:
        """A step from y to y."""
        return self.closed(scheme, table, h, self.step(scheme, table, t, h, self.opened(scheme, table, h, y)))

    def heading(self, y: Split) -> Any:
        """Coordinates along the director, whose turns are to be counted; None if there are none."""
        return y.q

    @abc.abstractmethod
    def lowest_strain(self, y: Split) -> Float[Array, ""]:
        """The least strain along the rod."""


class Center(eqx.Module):
    """The centre of mass in flight: it falls on a parabola, whatever the rod does."""

    time: Float[Array, ""]
    position: Float[Array, " D"]
    velocity: Float[Array, " D"]
    gravity: Float[Array, " D"]

    def __call__(self, t) -> tuple[Float[Array, " D"], Float[Array, " D"]]:
        passed = t - self.time
        return (
            self.position + self.velocity * passed + self.gravity * (passed**2 / 2),
            self.velocity + self.gravity * passed,
        )

    @staticmethod
    def of(scene: Scene, t0, start: State) -> "Center | None":
        """That of a flight, else None."""
        if not isinstance(scene.motion, Flight):
            return None
        assert start.center is not None and start.center_velocity is not None
        down = jnp.zeros_like(start.center)
        if scene.gravity is not None:
            down = down.at[-1].set(-scene.gravity) if scene.gravity.ndim == 0 else scene.gravity
        return Center(t0, start.center, start.center_velocity, down)


class Flat(AbstractSplit):
    """Uniform strain in q = (1 + eps) d: a mass on a spring.  Drift: straight on.  Kick: the gradient of all of V."""

    scene: Scene
    numbers: Any  # (the scene per inertia, the scene if it has forces), number by number
    center: Center | None

    def __init__(self, scene: Scene, t0, start: State):
        self.center = Center.of(scene, t0, start)
        body = _per_inertia(scene.body)
        rigidity = jnp.sum(body.rigidity, keepdims=True)
        lean = eqx.tree_at(lambda b: (b.strains, b.rigidity), body, (jnp.ones_like(rigidity)[None], rigidity))
        self.scene = _held(scene, scene.body)
        loads = self.scene if scene.forces else None
        self.numbers = scattered((Scene(self.scene.motion, lean, self.scene.gravity, ()), loads))

    def encode(self, state):
        q, v = Embedded().encode(self.scene.motion, _without_center(state))
        return Split(scattered(q), scattered(v))

    def decode(self, t, y, turns):
        q, v = gathered((y.q, y.p))
        return _with_center(Embedded().decode(self.scene.motion, t, q, v, turns), self.center, t)

    def table(self, scheme, h):
        return None

    def step(self, scheme, table, t, h, y):
        del table
        q, v = y.q, y.p
        for kick, passed, drift in scheme.stages:
            v = v.moved(kick * h, self.force(t + passed * h, q))
            q = q.moved(drift * h, v)
        return Split(q, v)

    def opened(self, scheme, table, h, y):
        del table
        return Split(y.q.moved(scheme.drifts[0] * h, y.p), y.p)

    def closed(self, scheme, table, h, y):
        return self.opened(scheme, table, -h, y)

    def force(self, t, q: Numbers) -> Numbers:
        """All loads on q, per inertia: minus the gradient of V, and those without a potential."""

        def force(scene, loads, t, q):
            push = -jax.grad(_embedded_potential, argnums=1)(scene, q)
            if loads is None:
                return push
            return push + Moving(loads, Embedded()).force(t, q, jnp.zeros_like(q)) / loads.body.mass_matrix[0, 0]

        return by_number(force)(*self.numbers, t, q)

    def lowest_strain(self, y):
        return jnp.sqrt(sum(x * x for x in y.q)) - 1


def _embedded_potential(scene: Scene, q):
    strain = energy.elastic_embedded(scene.body, q)
    return strain if scene.gravity is None else strain + energy.gravity_embedded(scene.body, scene.gravity, q)


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
        body = _per_inertia(body)
        n = body.stiffness_matrix.shape[0]
        mixed = body.mass_matrix[1:, 0]
        if n == 0:
            squares, self.shapes = jnp.zeros_like(mixed), body.stiffness_matrix
        else:
            squares, self.shapes = eigh(body.stiffness_matrix, body.strain_mass)
        self.rates = jnp.sqrt(squares)
        self.periods = 1 / self.rates
        self.inverse = self.shapes.T @ body.strain_mass
        self.arms = self.shapes.T @ mixed
        self.rest = 1 - self.arms @ self.arms
        self.moments = jnp.concatenate([body.first_moments[:1], self.shapes.T @ body.first_moments[1:]])

    def inertia(self, eta):
        """Moment of inertia of the stretched rod."""
        arms = self.arms + eta
        return self.rest + arms @ arms

    def moment(self, eta):
        """First moment of the stretched rod."""
        return self.moments[0] + self.moments[1:] @ eta


class AbstractOscillating(AbstractSplit):
    """A split whose drift has the oscillators of the axial modes.

    `numbers`: what flows need, number by number, the modes first; `field`: strain of each mode at the places watched.
    """

    modes: eqx.AbstractVar[AxialModes]
    numbers: eqx.AbstractVar[Any]
    field: eqx.AbstractVar[Any]

    @abc.abstractmethod
    def _drift(self, turned, y: Split) -> Split:
        """y after a drift, given what `_turned` says of it."""

    def _turned(self, t):
        """How far the oscillators turn in a time t, and the time."""
        angles = [rate * t for rate in self.numbers[0].rates]
        return [jnp.cos(x) for x in angles], [jnp.sin(x) for x in angles], t

    def opened(self, scheme, table, h, y):
        return self._drift(table[1], y)

    def lowest_strain(self, y):
        return lowest(y.strain, self.field) if len(y.strain) else jnp.zeros_like(y.q[0])


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
        self.scene, self.modes = _held(scene, scene.body), AxialModes(scene.body)
        loads = self.scene if self.scene.forces else None
        self.numbers = scattered((self.modes, self.scene.gravity, loads))
        self.field = scattered(self.modes.shapes.T @ watched(scene.body.strains))

    def encode(self, state):
        eta = self.modes.inverse @ state.amplitudes
        inertia = self.modes.inertia(eta)
        momentum = inertia * state.rate if state.planar else inertia * jnp.cross(state.direction, state.direction_rate)
        deta = self.modes.inverse @ state.amplitude_rates / self.modes.rates
        d, momentum = scattered((state.direction, jnp.atleast_1d(momentum)))
        return Split(d, momentum, scattered(eta), scattered(deta), jnp.zeros_like(inertia))

    def decode(self, t, y, turns):
        d, momentum, eta, deta, _ = gathered(y)
        spin = momentum / self.modes.inertia(eta)
        rate = spin * jnp.stack([-d[1], d[0]]) if d.size == 2 else jnp.cross(spin, d)
        strain, strain_rate = self.modes.shapes @ eta, self.modes.shapes @ (deta * self.modes.rates)
        return _with_center(State(d, rate, strain, strain_rate, turns), self.center, t)

    def table(self, scheme, h):
        rows = [
            (passed * h, before * h, after * h, self._turned(drift * h))
            for (_, passed, drift), (before, after) in zip(scheme.stages, scheme.halves, strict=True)
        ]
        return jax.tree.map(lambda *x: jnp.stack(x), *rows), self._turned(scheme.drifts[0] * h)

    def step(self, scheme, table, t, h, y):
        del scheme, h

        def stage(y, row):
            passed, before, after, drift = row
            y = self._rotate(self._straighten(before, y))
            y = self._straighten(after, self._load(t + passed, before + after, y))
            return self._drift(drift, y), None

        return jax.lax.scan(stage, y, table[0])[0]

    def closed(self, scheme, table, h, y):
        return self._rotate(self._drift(_back(table[1]), y))

    def _rotate(self, y: Split):
        return y._replace(q=_turned(y.q, y.p, y.turning), turning=jnp.zeros_like(y.turning))

    def _drift(self, turned, y: Split):
        """The oscillators under a constant pull for a time `drift`; the director is to turn by l int 1/J dt."""
        (cos, sin, drift), modes, square = turned, self.numbers[0], sum(x * x for x in y.p)
        strain, momentum, swept, pulled = [], [], 0.0, 0.0
        for c, s, period, arm, eta, p in zip(
            cos, sin, modes.periods, modes.arms, y.strain, y.strain_momentum, strict=True
        ):
            drawn = arm * period * period
            off = eta - square * drawn
            strain.append(square * drawn + (c * off + s * p))
            momentum.append(c * p - s * off)
            swept = swept + arm * period * (s * off + (1 - c) * p)
            pulled = pulled + arm * drawn
        turning = y.turning + (drift - 2 * (swept + square * pulled * drift))
        return y._replace(strain=y.strain.like(strain), strain_momentum=y.strain.like(momentum), turning=turning)

    def _straighten(self, h, y: Split):
        """The kick of what is left of the turning."""
        modes, square = self.numbers[0], sum(x * x for x in y.p)
        if not len(modes.rates):
            return y

        def rest(modes, eta, square):
            return energy.kinetic_momentum(modes, eta, square) - square * (1 - 2 * (modes.arms @ eta)) / 2

        push, turning = by_number(jax.grad(rest, argnums=(1, 2)))(modes, y.strain, square)
        pushed = [p - h * f * period for p, f, period in zip(y.strain_momentum, push, modes.periods, strict=True)]
        return y._replace(strain_momentum=y.strain.like(pushed), turning=y.turning + 2 * h * turning)

    def _load(self, t, h, y: Split) -> Split:
        """The kick of gravity and of forces."""
        modes, gravity, loads = self.numbers
        if gravity is None and loads is None:
            return y
        moment, push = by_number(self._loads)(modes, gravity, loads, t, y.q, y.strain)
        pushed = [p + h * f * period for p, f, period in zip(y.strain_momentum, push, modes.periods, strict=True)]
        return y._replace(p=y.p.moved(h, moment), strain_momentum=y.strain.like(pushed))

    def _loads(self, modes: AxialModes, gravity, loads: Scene | None, t, d, eta):
        """Moment on the rod and force on each mode, per inertia."""
        pull, push = jnp.zeros_like(d), jnp.zeros_like(eta)
        if gravity is not None:
            pull, push = jax.grad(lambda d, eta: -energy.gravity_pivoted(modes, gravity, eta, d), argnums=(0, 1))(
                d, eta
            )
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
        eta = self.modes.inverse @ state.amplitudes
        deta = self.modes.inverse @ state.amplitude_rates / self.modes.rates
        return Split(None, None, scattered(eta), scattered(deta))

    def decode(self, t, y, turns):
        eta, deta = gathered((y.strain, y.strain_momentum))
        amplitudes, rates = self.modes.shapes @ eta, self.modes.shapes @ (deta * self.modes.rates)
        return Strains().decode(self.scene.motion, t, amplitudes, rates, turns)

    def table(self, scheme, h):
        rows = [(passed * h, kick * h, self._turned(drift * h)) for kick, passed, drift in scheme.stages]
        return jax.tree.map(lambda *x: jnp.stack(x), *rows), self._turned(scheme.drifts[0] * h)

    def step(self, scheme, table, t, h, y):
        del scheme, h
        modes, scene = self.numbers

        def stage(y, row):
            passed, kick, drift = row
            push = by_number(self._push)(modes, scene, t + passed, y.strain)
            kicked = [
                p + kick * f * period for p, f, period in zip(y.strain_momentum, push, modes.periods, strict=True)
            ]
            return self._drift(drift, y._replace(strain_momentum=y.strain.like(kicked))), None

        return jax.lax.scan(stage, y, table[0])[0]

    def closed(self, scheme, table, h, y):
        return self._drift(_back(table[1]), y)

    def _drift(self, turned, y: Split):
        cos, sin, _ = turned
        pairs = list(zip(cos, sin, y.strain, y.strain_momentum, strict=True))
        return y._replace(
            strain=y.strain.like([c * x + s * p for c, s, x, p in pairs]),
            strain_momentum=y.strain.like([c * p - s * x for c, s, x, p in pairs]),
        )

    def _push(self, modes: AxialModes, scene: Scene, t, eta):
        equations = Moving(scene, Strains())
        amplitudes = modes.shapes @ eta
        still = jnp.zeros_like(amplitudes)
        push = jax.grad(equations.function, argnums=1)(t, amplitudes, still)
        if scene.forces:
            push = push + equations.force(t, amplitudes, still)
        return modes.shapes.T @ push / scene.body.mass_matrix[0, 0]


def _back(turned):
    """The same drift backwards in time."""
    cos, sin, t = turned
    return cos, [-x for x in sin], -t


def watched(field: Float[Array, "n points"]) -> Float[Array, "n places"]:
    """A field along the rod at 2 n + 3 of its points: each step looks there whether the rod collapses."""
    n, points = field.shape
    return field[:, np.unique(np.linspace(0, points - 1, 2 * n + 3).round().astype(int))]


def lowest(amplitudes: Numbers, field: Numbers) -> Any:
    """The least strain at the points where `field` is known."""
    return functools.reduce(jnp.minimum, by_number(lambda a, field: a @ field)(amplitudes, field))


def _turned(d: Numbers, momentum: Numbers, turning) -> Numbers:
    """The director turned about `momentum` by |momentum| turning."""
    square = sum(x * x for x in momentum) * (turning * turning)
    cos, sin = 0.0, 0.0
    for k in reversed(range(_SERIES)):
        cos = cos * square + (-1) ** k / math.factorial(2 * k)
        sin = sin * square + (-1) ** k / math.factorial(2 * k + 1)
    sin = sin * turning
    if len(d) == 2:
        x, y = d
        sin = sin * momentum[0]
        return d.like([cos * x - sin * y, cos * y + sin * x])
    (x, y, z), (a, b, c) = d, momentum
    across = (b * z - c * y, c * x - a * z, a * y - b * x)
    return d.like([cos * u + sin * w for u, w in zip(d, across, strict=True)])


def _per_inertia(body: Projection) -> Projection:
    inertia = body.mass_matrix[0, 0]
    return eqx.tree_at(
        lambda b: (b.mass_matrix, b.stiffness_matrix, b.first_moments, b.rigidity),
        body,
        (
            body.mass_matrix / inertia,
            body.stiffness_matrix / inertia,
            body.first_moments / inertia,
            body.rigidity / inertia,
        ),
    )


def _held(scene: Scene, body: Projection) -> Scene:
    """The scene of the turning alone: in flight about the centre of mass, where nothing weighs."""
    if isinstance(scene.motion, Flight):
        return Scene(Rotation(), body, None, scene.forces)
    return Scene(scene.motion, body, scene.gravity, scene.forces)


def _without_center(state: State) -> State:
    return State(state.direction, state.direction_rate, state.amplitudes, state.amplitude_rates, state.turns)


def _with_center(state: State, center: Center | None, t) -> State:
    if center is None:
        return state
    position, velocity = center(t)
    return State(
        state.direction, state.direction_rate, state.amplitudes, state.amplitude_rates, state.turns, position, velocity
    )
