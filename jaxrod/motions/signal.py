"""Functions of time that are measured or short, and that tell the stepper where they change: `Record` and `Impulse`.

Wherever a scene takes a function of time it takes one of these: the strength of a force, the position or acceleration of
a base, the angle of a drive.  A step ends at each of their `knots`, between which they are polynomials or nearly so.
They are found in the fields of a scene, in modules of its user, and in what its functions close over.
"""

import abc
import functools
import math
import types
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ..core import tracing, units, validation
from ..core.units import Number, Row

_STENCIL = 5  # samples of which the slope and the curvature at one of them are taken
_ROUGH = 20.0  # times as rough as another, a stencil is left for it: it lies across a jump
_TORN = 0.5  # fourth difference over the first ones beside, above which no stencil is smooth
_KINKED = 0.5  # of the largest way from a straight one: as far off seems a sine of 1,170 periods
_PULSE = 64  # steps in an `Impulse`, at least
_NO_USERS = {"jax", "jaxlib", "numpy", "equinox", "diffrax", "interpax", "optimistix", "lineax", "jaxrod", "builtins"}


class AbstractSignal(eqx.Module):
    """A function of time t (s), which knows when it changes."""

    @property
    @abc.abstractmethod
    def knots(self) -> Float[Array, " K"]:
        """Times in s at which a step is to end, ascending."""

    @abc.abstractmethod
    def zero_outside(self) -> tuple[Bool[Array, ""], Bool[Array, ""]]:
        """Whether it is zero before its first knot, and after its last; if not, it is not known there."""

    @abc.abstractmethod
    def fits(self, name: str, unit: str) -> None:
        """Refuse, by `ValueError`, to be what `name` needs, in `unit`, if it was given in a unit of something else."""

    @abc.abstractmethod
    def __call__(self, t: Float[Array, ""], state: Any = None) -> Array:
        """Its value at time t; the state does not matter."""


class Record(AbstractSignal):
    """A measured function of time: samples of a force, a moment, a position, an acceleration or an angle.

    Between two samples it is a polynomial of degree five that has at both the values, slopes and curvatures of the
    samples around (five to a stencil, never across a jump): twice differentiable, of fourth order where the samples
    are smooth, without waves where they jump.

    **Arguments:** `times` in s, increasing (K,), K at least 2; `samples` at these times (K,), or (K, D) of a vector, in the
    unit of what they stand for.  Differentiable in the samples.

    A run may begin before a record of a force, or end after it, if the record begins or ends with zero, as it is then
    zero beyond.  Else, and for positions and angles, the run must lie within the record.

    **Raises:** `ValueError` for times that do not increase, and samples that do not fit them.

    >>> import jax.numpy as jnp, jaxrod
    >>> rod = jaxrod.Rod(length=1.0, section=jaxrod.Uniform(0.025), young=1e7, density=1200.0)
    >>> times = jnp.linspace(0.0, 2.0, 2001)
    >>> samples = jnp.stack([0.05 * jnp.sin(2 * jnp.pi * times), 0.0 * times], axis=1)  # of the pivot, in m
    >>> scene = jaxrod.System(
    ...     rod, jaxrod.Rotation(), jaxrod.Ritz(0), gravity=9.81, forces=[jaxrod.ShakenBase(jaxrod.Record(times, samples))]
    ... )
    >>> print(jaxrod.simulate(scene, scene.state(angle=-jnp.pi / 2), t1=1.5).angle.round(6))
    [-1.680894]
    """

    times: Float[Array, " K"]
    samples: Float[Array, "K *D"]
    slopes: Float[Array, "K *D"]
    curvatures: Float[Array, "K *D"]
    given_in: Any = eqx.field(static=True)  # unit, None of plain numbers

    def __init__(self, times: Row, samples: Row):
        self.given_in = units.of(samples)
        times = validation.numbers("Record(times=)", times, "times in s", "s")
        if times.size < 2:
            raise ValueError(f"Record(times={validation.shown(times)}) holds one time; give two or more.")
        if validation.fails(lambda t: np.diff(t) > 0, times):
            first = int(np.argmin(np.diff(times) > 0))
            raise ValueError(
                f"Record(times=) must increase, but times[{first}]={times[first]:.9g} is followed by {times[first + 1]:.9g}."
            )
        samples = validation.reals("Record(samples=)", samples, None)
        shape = samples.shape
        if len(shape) not in (1, 2) or shape[0] != times.size:
            raise ValueError(
                f"Record(samples=) has shape {shape} for {times.size} times; give one number, or one row, for each."
            )
        samples = validation.number("Record(samples=)", samples, shape)
        self.times, self.samples = times, samples
        self.slopes, self.curvatures = _derivatives(times, samples)

    @property
    def knots(self):
        return self.times

    def zero_outside(self):
        return jnp.all(self.samples[0] == 0), jnp.all(self.samples[-1] == 0)

    def fits(self, name: str, unit: str):
        units.fits(name, "a Record", self.given_in, unit)

    def __call__(self, t: Any, state: Any = None):
        t = jnp.asarray(t, self.times.dtype)
        # Compared with all of them: a search, unrolled into every stage of a step, takes XLA far longer to compile.  And
        # no table of coefficients, which XLA computes anew wherever it is looked up.
        piece = jnp.clip(jnp.sum(self.times <= t) - 1, 0, self.times.size - 2)
        h = self.times[piece + 1] - self.times[piece]
        x = (t - self.times[piece]) / h
        here, rise = self.samples[piece], self.samples[piece + 1] - self.samples[piece]
        v, w = h * self.slopes[piece], h * self.slopes[piece + 1]
        a, b = h**2 * self.curvatures[piece] / 2, h**2 * self.curvatures[piece + 1] / 2
        cubic, quartic = 10 * rise - 6 * v - 4 * w - 3 * a + b, -15 * rise + 8 * v + 7 * w + 3 * a - 2 * b
        quintic = 6 * rise - 3 * v - 3 * w - a + b
        value = here + x * (v + x * (a + x * (cubic + x * (quartic + x * quintic))))
        return jnp.where((t >= self.times[0]) & (t <= self.times[-1]), value, 0.0)

    def __repr__(self):
        return f"Record({validation.listed(self.times)} s, samples of shape {np.shape(self.samples)})"


class Impulse(AbstractSignal):
    """A blow: a smooth pulse (1 - cos) of known total, however short.

    **Arguments:** `total`, its integral over time: N s of a force, N m s of a moment; one number, or (D,) of a vector;
    `start` in s, when it begins; `width` in s, how long it lasts, positive.

    >>> import jaxrod
    >>> rod = jaxrod.Rod(length=1.0, section=jaxrod.Uniform(0.025), young=1e7, density=1200.0)
    >>> blow = jaxrod.Torque(jaxrod.Impulse(total=1.0, start=5.0, width=1e-5))
    >>> scene = jaxrod.System(rod, jaxrod.Rotation(), jaxrod.Ritz(0), forces=[blow])
    >>> print(jaxrod.simulate(scene, scene.state(), t1=10.0).rate.round(6), (1 / rod.moment_of_inertia()).round(6))
    [1.27324] 1.27324
    """

    total: Float[Array, "*D"]
    start: Float[Array, ""]
    width: Float[Array, ""]
    given_in: Any = eqx.field(static=True)  # unit, None of plain numbers

    def __repr__(self):
        return validation.written(self, total="", start="s", width="s")

    def __init__(self, total: Number | Row, start: Number, width: Number):
        self.given_in = units.of(total)
        self.total = validation.number(
            "Impulse(total=)", total, validation.reals("Impulse(total=)", total, None).shape[:1], None
        )
        self.start = validation.number("Impulse(start=)", start, unit="s")
        self.width = validation.positive("Impulse(width=)", width, "s", "seconds")

    @property
    def knots(self):
        return self.start + self.width * jnp.linspace(0.0, 1.0, _PULSE + 1, dtype=self.width.dtype)

    def zero_outside(self):
        return jnp.asarray(True), jnp.asarray(True)

    def fits(self, name: str, unit: str):
        units.fits(name, "an Impulse", self.given_in, f"{unit} s")

    def __call__(self, t: Any, state: Any = None):
        x = (jnp.asarray(t, self.width.dtype) - self.start) / self.width
        pulse = jnp.where((x > 0) & (x < 1), 1 - jnp.cos(2 * jnp.pi * x), 0.0)
        return self.total / self.width * pulse


def _derivatives(times, samples) -> tuple[Float[Array, "K *D"], Float[Array, "K *D"]]:
    """Slope and curvature at each sample, of the polynomial through the stencil around it.

    Of the stencils that hold a sample the one in its middle; another where that is much less rough, as on one side of a
    jump (essentially non-oscillatory: Harten, Engquist, Osher, Chakravarthy 1987); where all are rough, a straight line
    to the nearer of the samples beside.
    """
    count = times.size
    size = min(_STENCIL, count)
    first, at = jnp.arange(count - size + 1), jnp.arange(count)
    newton, differences = [samples[first]], samples  # coefficients in Newton's form: divided differences
    for k in range(1, size):
        differences = jnp.diff(differences, axis=0) / _beside(times[k:] - times[:-k], differences[1:])
        newton.append(differences[: first.size])
    span = _beside(times[first + size - 1] - times[first], samples)
    even = math.factorial(size - 1) / (size - 1) ** (size - 1)  # makes it the plain difference of even samples
    rough = _sizes(newton[-1] * span ** (size - 1)) * even

    middle = jnp.clip(at - size // 2, 0, count - size)
    tried = middle[:, None] + np.array([0, -1, 1, -2, 2])[None, :]
    tried = jnp.clip(tried, jnp.maximum(at - size + 1, 0)[:, None], jnp.minimum(at, count - size)[:, None])
    weighted = rough[tried] * jnp.where(tried == middle[:, None], 1.0, _ROUGH)
    best = jnp.argmin(weighted, axis=1)
    picked = jnp.take_along_axis(tried, best[:, None], axis=1)[:, 0]

    value, slope, half = (jnp.zeros_like(samples) for _ in range(3))  # Horner's scheme with its derivatives
    for k in reversed(range(size)):
        x = _beside(times - times[picked + k], samples)
        half = half * x + slope
        slope = slope * x + value
        value = value * x + newton[k][picked]

    rises = jnp.diff(samples, axis=0)
    before, after = jnp.maximum(at - 1, 0), jnp.minimum(at, count - 2)
    sizes = _sizes(rises)
    nearer = jnp.where(sizes[before] <= sizes[after], before, after)
    straight = rises[nearer] / _beside(jnp.diff(times)[nearer], samples)
    torn = _beside(rough[picked] > _TORN * jnp.maximum(sizes[before], sizes[after]), samples)
    return jnp.where(torn, straight, slope), jnp.where(torn, 0.0, 2 * half)


def _sizes(rows: Float[Array, "K *D"]) -> Float[Array, " K"]:
    return jnp.sum(jnp.abs(rows.reshape(len(rows), -1)), axis=1)


def _beside(values, array):
    """A row of numbers with as many axes as the array."""
    return values.reshape(-1, *(1,) * (array.ndim - 1))


def twice(function: Any, t: Float[Array, ""]) -> tuple[Array, Array, Array]:
    """A function of time, its rate and the rate of that."""

    def rate(t):
        return jax.jvp(lambda t: jnp.asarray(function(t), t.dtype), (t,), (jnp.ones_like(t),))

    (value, speed), (_, acceleration) = jax.jvp(rate, (t,), (jnp.ones_like(t),))
    return value, speed, acceleration


def at_each(function: Any, times: Float[Array, " T"]) -> Any:
    """`function` at each of these times; one after the other where JAX cannot take them together, as of a callback."""
    try:
        return jax.vmap(function)(times)
    except (ValueError, NotImplementedError):
        return jax.lax.map(function, times)


def kinked(
    place: Float[Array, "T *D"], acceleration: Float[Array, "T *D"], times: Float[Array, " T"]
) -> Bool[Array, ""]:
    """Whether something moves otherwise than its acceleration at these evenly spaced times has it, start and end apart.

    So does a position that is interpolated by straight lines, and one that jumps: no derivative knows of it.
    """
    step = times[1] - times[0]

    def integrated(rate):
        parts = step * (rate[1:] + rate[:-1]) / 2
        return jnp.concatenate([jnp.zeros_like(parts[:1]), jnp.cumsum(parts, axis=0)])

    def bent(x):
        part = jnp.linspace(0.0, 1.0, len(x), dtype=x.dtype).reshape(-1, *(1,) * (x.ndim - 1))
        return x - x[:1] - (x[-1:] - x[:1]) * part

    uneven = bent(place)
    off = jnp.max(jnp.abs(uneven - bent(integrated(integrated(acceleration)))))
    rounding = max(1e-9, 64 * float(jnp.finfo(place.dtype).eps))
    return off > jnp.maximum(rounding * jnp.max(jnp.abs(place)), _KINKED * jnp.max(jnp.abs(uneven)))


def on_clock(function: Any, t0: Float[Array, ""], t: Float[Array, ""]) -> Array:
    """`function` at t0 + t, and by its slope at what rounding takes from that sum: stamps far from zero have few digits."""
    time = t0 + t
    value, rest = jax.jvp(function, (time,), (t - (time - t0),))
    return value + rest


def beyond(found: list[AbstractSignal], t0, t1, may_end: bool) -> Bool[Array, ""]:
    """Whether a run from t0 to t1 leaves the knots of one of these; it may where that is zero beyond, if `may_end`."""
    beyond, rounding = jnp.asarray(False), 1e-9 * (t1 - t0)
    for signal in found:
        before, after = (known & may_end for known in signal.zero_outside())
        rounding = rounding + 4 * jnp.finfo(signal.knots.dtype).eps * jnp.abs(signal.knots[-1])
        beyond = beyond | ((t0 < signal.knots[0] - rounding) & ~before) | ((t1 > signal.knots[-1] + rounding) & ~after)
    return beyond


def signals(value: Any) -> list[AbstractSignal]:
    """Every signal in the fields of `value`, in its functions and in what these close over."""
    found: dict[int, AbstractSignal] = {}
    _collect(value, found, set(), depth=8)
    return list(found.values())


def _collect(value: Any, found: dict[int, AbstractSignal], seen: set[int], depth: int) -> None:
    if id(value) in seen or depth == 0:
        return
    seen.add(id(value))
    if isinstance(value, AbstractSignal):
        found[id(value)] = value
        return
    for inner in _within(value):
        _collect(inner, found, seen, depth - 1)


def _within(value: Any) -> tuple[Any, ...]:
    """What a value holds or, being a function of its user, works with."""
    if isinstance(value, list | tuple | set):
        return tuple(value)
    if isinstance(value, dict):
        return tuple(value.values())
    if isinstance(value, functools.partial):
        return (value.func, value.args, value.keywords)
    if isinstance(value, types.MethodType):
        return (value.__func__, value.__self__)
    if hasattr(value, "__wrapped__"):  # as of `jax.jit`
        return (value.__wrapped__,)
    if isinstance(value, types.FunctionType):
        if not _of_users(value):
            return ()
        names = value.__code__.co_names
        cells = (tracing.content(cell) for cell in value.__closure__ or ())
        used = (value.__globals__[name] for name in names if name in value.__globals__)
        return (*cells, *used, value.__defaults__, value.__kwdefaults__)
    if hasattr(value, "__dict__") and not isinstance(value, type | types.ModuleType | jax.Array):
        methods = vars(type(value)).values() if _of_users(type(value)) else ()
        return (*vars(value).values(), *methods)
    return ()


def _of_users(value: Any) -> bool:
    return (value.__module__ or "").split(".")[0] not in _NO_USERS
