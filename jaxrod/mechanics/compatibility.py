"""Whether the parts of a scene fit one another."""

import warnings
from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ..core import calling, tracing, validation
from ..motions.force import AbstractForce, KelvinVoigt
from ..motions.motion import AbstractMotion
from ..motions.state import Placement, State
from ..rods.lumped import Lumped
from ..rods.rod import Rod
from ..shapes.basis import AbstractBasis, QuasiStatic, Ritz
from ..shapes.projection import Projection

_EXAMPLES = {"rod": "Rod(length, section, young, density)", "motion": "Rotation()", "basis": "Ritz(1)"}


def check_parts(rod, motion, basis, forces, body: Callable[[], Projection]) -> None:
    """Refuse, by `ValueError`, what is no rod, motion, basis or force, and what has no meaning together."""
    for name, value, kind in (
        ("rod", rod, Rod | Lumped),
        ("motion", motion, AbstractMotion),
        ("basis", basis, AbstractBasis),
    ):
        if not isinstance(value, kind):
            raise ValueError(
                f"{name}={validation.given(value)} is not a {name}; give an instance such as {_EXAMPLES[name]}."
            )
    for force in forces:
        if not isinstance(force, AbstractForce):
            raise ValueError(
                f"forces holds {validation.given(force)}, which is not a force; give Torque, PivotFriction or your own."
            )
        force.check(motion)
    _check_support(rod, motion, basis)
    if forces:
        _try_forces(motion, basis, forces, body)


def _try_forces(motion, basis, forces, body) -> None:
    """Each is tried at t = 0 in a state that moves in every way."""
    with jax.ensure_compile_time_eval():
        (along, across), strain, t = jnp.eye(2, motion.dimension), jnp.full(basis.n, 0.01), jnp.zeros(())
    state = State(along, across, strain, strain, t, *((along, across) if motion.flies else ()))
    for force in forces:
        force.try_out(t, state, lambda force=force: _try_power(force, t, state, body))
        if isinstance(force, KelvinVoigt) and (basis.n == 0 or isinstance(basis, QuasiStatic)):
            warnings.warn(
                f"KelvinVoigt() does nothing with basis={validation.given(basis)}, whose strain has no rate; leave it out, or "
                "take a basis with inertia such as Ritz(1).",
                stacklevel=6,
            )


def _try_power(force: AbstractForce, t, state: State, body: Callable[[], Projection]) -> None:
    """Refuse, by `ValueError`, a power that fails, or is not linear in the virtual velocity."""
    name, wanted = f"{type(force).__name__}.power", "(t, state, virtual, body) -> one number in W, linear in virtual"
    # Any numbers will do in place of the rod's.
    numbers = jax.tree.map(lambda x: np.linspace(1.0, 2.0, x.size).reshape(x.shape), eqx.filter_eval_shape(body))
    rate = Placement(state.direction_rate, state.amplitude_rates, state.center_velocity)
    calling.tried(name, wanted, force.power, t, state, rate, numbers, shapes=[()])
    if tracing.closes_over_traced(force) or not all(map(tracing.known, jax.tree.leaves(force))):
        return
    with jax.ensure_compile_time_eval():
        off, size = _not_linear(force, t, state, rate, numbers)
    if validation.fails(lambda off, size: off <= 1e-3 * size, off, size):
        raise ValueError(f"{name} is not linear in the virtual velocity; give a function {wanted}.")


@tracing.run_seldom
def _not_linear(force, t, state, rate, body):
    """By how much the power of a sum is not the sum of the powers, and their size."""
    one, other = (jax.tree.map(lambda x, k=k: x * k + k - 2, rate) for k in (1.0, 3.0))
    both = jax.tree.map(lambda x, y: x + 2 * y, one, other)
    one, other, both = (calling.real(force.power(t, state, virtual, body)) for virtual in (one, other, both))
    return jnp.abs(both - one - 2 * other), jnp.abs(both) + jnp.abs(one) + 2 * jnp.abs(other)


def _check_support(rod, motion, basis):
    pivot = motion.pivot
    if isinstance(rod, Lumped):
        if motion.flies:
            raise ValueError("rod=Lumped(...) is a pivoted body without a mass; for Flight() give a Rod.")
        if pivot is not None:
            raise ValueError("rod=Lumped(...) is given about its pivot already; leave out pivot=.")
        if basis.n > 1 or not isinstance(basis, Ritz):
            raise ValueError(
                f"rod=Lumped(...) has one uniform strain; take Ritz(1) or Ritz(0), not {validation.given(basis)}."
            )
        return
    if misfit := basis.misfit(rod):
        raise ValueError(misfit)
    if isinstance(basis, QuasiStatic) and not rod.linear:
        raise ValueError(
            f"basis={validation.given(basis)} condenses Hooke's law only; leave out law= of the rod, or take {basis.basis!r}."
        )
    if isinstance(basis, QuasiStatic) and motion.prescribed:
        raise ValueError(
            f"basis={validation.given(basis)} leaves nothing to move where the rotation is Driven; take {basis.basis!r}, "
            "or jaxrod.equilibrium for the static strain."
        )
    if not motion.flies:
        pivot, length = jnp.zeros(()) if pivot is None else pivot, rod.length
        if validation.fails(np.less_equal, pivot, length):
            raise ValueError(
                f"pivot={validation.shown(pivot)} lies beyond the rod; it must be within length={validation.shown(length)} m."
            )
        if validation.fails(lambda area: area > 0, _area(rod, pivot)):
            raise ValueError(
                f"pivot={validation.shown(pivot)} m is where the section vanishes, and a pin at a point holds nothing; "
                "move the pivot or give the end a radius."
            )


@tracing.at_once
def _area(rod: Rod, s):
    return rod.area(s)
