"""Rest and steady turning: equilibria, where nothing accelerates in a frame that turns with the rod."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jaxtyping import Array, Float

from ..core import precision, progress, tracing, validation
from ..core.linear_algebra import one_by_one, pinv
from ..motions.state import State
from ..shapes.projection import Projection
from .chart import AbstractChart, Local, Strains
from .equations import DiscreteSystem
from .system import System, check_system


def unbalanced_at_most(dtype) -> float:
    """Accelerations over the natural ones below which a state counts as an equilibrium: the root of rounding."""
    return float(jnp.finfo(dtype).eps) ** 0.5


def equilibrium(system: System, *, angle: Any = None, spin: Any = None, momentum: Any = None) -> State:
    """A state that rests, or turns steadily without changing its shape.

    - At rest: hanging, its strain the static sag; upright with `angle=jnp.pi / 2`.
    - `spin`: the turning rate in rad/s.  In the plane without gravity and in flight about the centre of mass; in space
      about the vertical: the conical pendulum, or what is nearest to `angle`.
    - `momentum`: instead of the rate, the angular momentum in kg m^2/s of that turning: what a free rod keeps.
    - A `Driven` motion turns as it is driven at t = 0.

    `angle` in rad above the horizontal is where the search begins; without gravity and outer forces the rod stays
    there (0 if left out).  Forces are those at t = 0.

    **Raises:** `ValueError` where there is none: a spin beyond the critical rate, gravity across a turning in the plane.
    Traced scenes that have none give NaN.  Differentiable in every number.

    >>> import jaxrod
    >>> rod = jaxrod.Rod(length=1.0, section=jaxrod.Uniform(0.025), young=1e5, density=1200.0)
    >>> print(jaxrod.equilibrium(jaxrod.System(rod, jaxrod.Rotation(), gravity=9.81)).strain.round(5))
    0.05886
    >>> cone = jaxrod.equilibrium(jaxrod.System(rod, jaxrod.Spherical(), gravity=9.81), spin=6.0)
    >>> print(f"{cone.angle:.4f} rad, {cone.strain:.4f}")
    -0.3575 rad, 0.1682
    """
    check_system(system)
    if spin is not None and momentum is not None:
        raise ValueError(
            f"spin={validation.brief(spin)} and momentum={validation.brief(momentum)} are both given; leave one out."
        )
    if system.motion.prescribed and not (angle is None and spin is None and momentum is None):
        raise ValueError("motion=Driven() turns as it is driven; leave out angle=, spin= and momentum=.")
    if system.motion.prescribed:
        _, rate, acceleration = system.motion.turning(0.0)
        if validation.fails(
            lambda rate, acceleration: np.abs(acceleration) <= 1e-9 * (1 + rate**2), rate, acceleration
        ):
            raise ValueError(
                f"motion=Driven() turns faster and faster, by {acceleration:.4g} rad/s^2: nothing is steady."
            )
        if system.gravity is not None and validation.fails(
            lambda rate, g: (rate == 0) | np.all(g == 0), rate, system.gravity
        ):
            raise ValueError(
                f"motion=Driven() turns at {rate:.4g} rad/s under gravity, which then goes round the rod: no rest."
            )
    given = {"angle": angle, "spin": spin, "momentum": momentum}
    in_si = {"angle": "rad", "spin": "rad/s", "momentum": "kg m^2/s"}
    given = {name: validation.number(name, x, unit=in_si[name]) for name, x in given.items() if x is not None}
    # Searched in JAX's default type, in which Optimistix keeps its own numbers.
    dtype, wide = precision.float_type(system, given), jnp.result_type(float)
    scene, given = precision.in_type(wide, (system, given))
    with progress.line("equilibrium"):
        state, error, lowest = _search(scene, given.get("angle"), given.get("spin"), given.get("momentum"))
    sound = (error < unbalanced_at_most(error.dtype)) & (lowest > -1)
    if validation.fails(lambda sound: sound, sound):
        raise ValueError(_none_found(system, given, error, lowest))
    return jax.tree.map(lambda x: jnp.where(sound, x, jnp.nan).astype(dtype), state)


def _none_found(system: System, given: dict[str, Any], error, lowest) -> str:
    """What to say where there is no equilibrium, with its likely causes."""
    what = ", ".join(f"{name}={validation.shown(value)}" for name, value in given.items())
    driven, linear = system.motion.prescribed, getattr(system.rod, "linear", True)
    if _weighs(system) and ("spin" in given or "momentum" in given):
        causes = ["gravity acts, and a rod spinning in a vertical plane is never steady"]
    else:
        causes, balanced = [], float(error) < unbalanced_at_most(error.dtype)
        if linear and ("spin" in given or driven):
            causes.append("the rate of spin exceeds critical_rate(system)")
        if balanced:
            causes.append(f"the loads would compress it to a strain of {float(lowest):.4g}, beyond -1: raise young=")
        if not balanced and not driven:
            causes.append("the search started too far away: pass another angle=")
    listed = "; ".join(f"({letter}) {cause}" for letter, cause in zip("abc", causes, strict=False))
    found = f"no equilibrium found for {type(system.motion).__name__}(){' with ' * bool(what)}{what}."
    return f"{found} Possible causes: {listed or 'the loads have no balance'}."


@tracing.run_seldom
def _search(system, angle, spin, momentum):
    dtype = precision.float_type(system, angle, spin, momentum)
    scene = system.discrete
    base = _guess(system, scene.body, angle, spin).astype(dtype)
    slopes = 0 if system.motion.prescribed else base.size - 1
    n = 0 if scene.condensed else scene.n
    rate = natural_rate(scene)

    def residual(x):
        spin_, q = (jnp.asarray(0.0 if spin is None else spin, dtype), x) if momentum is None else (x[0], x[1:])
        push = scene.equations(chart_at(scene, base, spin_)).from_rest(q) / rate**2
        if momentum is None:
            return push
        state = _state(scene, base, spin_, q)
        turning = scene.angular_momentum(state)
        turning = turning if state.planar else turning[2]
        inertia = scene.body.mass_matrix[0, 0]
        return jnp.concatenate([((turning - momentum) / (inertia * rate))[None], push])

    q0 = jnp.zeros(slopes + n, dtype)
    if n and spin is not None and getattr(system.rod, "linear", True) is False:
        # No law but Hooke's answers at once: begin stretched, away from the rest that is none at strain -1.
        q0 = q0.at[slopes].set(jnp.minimum((jnp.asarray(spin, dtype) / rate) ** 2 / 2, 3.0))
    if momentum is not None:  # a low rate to begin with: from above the critical one the search would not come back
        slow = jnp.asarray(momentum, dtype) / scene.body.mass_matrix[0, 0]
        q0 = jnp.concatenate([(slow / jnp.sqrt(1 + (slow / rate) ** 2))[None], q0])
    residual = eqx.filter_closure_convert(residual, q0)
    x = _root(residual, q0)
    error = jnp.max(jnp.abs(residual(x)), initial=0.0)
    spin, q = (jnp.asarray(0.0 if spin is None else spin, dtype), x) if momentum is None else (x[0], x[1:])
    state = _state(scene, base, spin, q)
    if _weighs(system):  # balanced for a moment only, at the top and at the bottom
        across = jnp.sqrt(jnp.sum(system.pull**2)) * jnp.max(jnp.abs(scene.body.first_moments))
        turns = across > 1e-9 * scene.body.mass_matrix[0, 0] * rate**2
        error = jnp.where(turns & (spin != 0), jnp.inf, error)
    return state, error, scene.lowest_strain(state.amplitudes)


def _weighs(system: System) -> bool:
    """Whether gravity acts in the plane in which the rod turns freely about a pivot."""
    free = not (system.motion.prescribed or system.motion.flies)
    return free and system.motion.dimension == 2 and system.gravity is not None


@eqx.filter_custom_jvp
def _root(residual, guess):
    """x with residual(x) = 0, or as near to it as it gets from `guess`; `residual` is a pytree that holds its numbers."""
    numbers, rest = eqx.partition((residual, guess), eqx.is_array)

    @one_by_one
    def search(numbers):
        residual, guess = eqx.combine(numbers, rest)
        solver = optx.LevenbergMarquardt(rtol=1e-14, atol=1e-14)
        x = optx.least_squares(lambda x, _: residual(x), solver, guess, max_steps=400, throw=False).value
        slope, left = jax.jacfwd(lambda x: 2 * (residual(x),), has_aux=True)(x)
        return x - pinv(slope) @ left

    return search(numbers)


@_root.def_jvp
def _root_jvp(primals, tangents):
    """By the implicit function theorem, at a root that has derivatives itself: right to any order."""
    (residual, guess), (tangent, _) = primals, tangents
    x = _root(residual, guess)
    _, moved = eqx.filter_jvp(lambda residual: residual(x), (residual,), (tangent,))
    return x, -pinv(jax.jacfwd(residual)(x)) @ moved


def natural_rate(scene: DiscreteSystem) -> Float[Array, ""]:
    """A rate in 1/s to measure accelerations by: the slowest axial one, or that of the swing of a rigid rod."""
    body = jax.lax.stop_gradient(scene.body)
    if scene.n:
        return jnp.sqrt(body.stiffness_matrix[0, 0] / body.mass_matrix[1, 1])
    weight = 1.0 if scene.gravity is None else jnp.sqrt(jnp.sum(scene.gravity**2))
    return jax.lax.stop_gradient(jnp.sqrt(weight / scene.length))


def chart_at(scene: DiscreteSystem, base, spin) -> AbstractChart:
    """Coordinates that turn steadily about a director."""
    return Strains() if scene.motion.prescribed else Local(base, spin)


def _state(scene: DiscreteSystem, base, spin, q) -> State:
    state = scene.equations(chart_at(scene, base, spin)).decode(0.0, q, jnp.zeros_like(q))
    if not scene.motion.flies:
        return state
    zero = jnp.zeros_like(state.direction)
    return eqx.tree_at(lambda s: (s.center, s.center_velocity), state, (zero, zero), is_leaf=lambda x: x is None)


def _guess(system: System, body: Projection, angle, spin) -> Float[Array, " D"]:
    """The director to begin with."""
    dimension = system.motion.dimension
    if system.motion.prescribed:
        return jnp.zeros(dimension)
    down = jnp.zeros(dimension).at[-1].set(-1.0)
    if angle is not None:
        return jnp.zeros(dimension).at[0].set(jnp.cos(angle)).at[-1].set(jnp.sin(angle))
    if system.pull is None or system.motion.flies:
        return jnp.zeros(dimension).at[0].set(1.0)
    pull = system.pull
    strength = jnp.sqrt(pull @ pull)
    down = jnp.where(strength > 0, pull / jnp.where(strength > 0, strength, 1.0), down)
    down = down * jnp.where(body.first_moments[0] < 0, -1.0, 1.0)
    vertical = system.gravity is not None and system.gravity.ndim == 0
    if spin is None or dimension == 2 or not vertical:
        return down
    # The cone of a rigid rod, sin(angle) = -gamma / spin^2, where the spin is fast enough to raise it.
    sine = (
        pull[-1]
        * body.first_moments[0]
        / body.mass_matrix[0, 0]
        / jnp.maximum(spin**2, jnp.finfo(body.mass_matrix.dtype).tiny)
    )
    raised = jnp.abs(sine) < 1
    sine = jnp.where(raised, sine, 0.0)
    cone = jnp.zeros(3).at[0].set(jnp.sqrt(1 - sine**2)).at[2].set(sine)
    return jnp.where(raised, cone, down)
