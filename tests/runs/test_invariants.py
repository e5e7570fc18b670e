"""What physics keeps, computed motions must keep: energy, momentum, the past."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxrod

GRAVITY = 9.81
TIMES = np.linspace(0, 10, 41)


def rotation(cone):
    """Figure 2 of the paper."""
    system = jaxrod.System(cone, jaxrod.Rotation(), gravity=GRAVITY)
    return system, system.state(rate=15.0)


def spherical(cone):
    system = jaxrod.System(cone, jaxrod.Spherical(), gravity=GRAVITY)
    return system, system.state(angle=0.3, rate=12.0, azimuth=0.5, azimuth_rate=3.0, strain=0.01, strain_rate=0.5)


def flight(cone):
    system = jaxrod.System(cone, jaxrod.Flight(), gravity=GRAVITY)
    return system, system.state(
        angle=0.6, rate=-25.0, strain=0.03, strain_rate=2.0, center=(1.0, 2.0), center_velocity=(-1.0, 50.0)
    )


scenes = pytest.mark.parametrize("scene", [rotation, spherical, flight], ids=lambda scene: scene.__name__)
accuracies = pytest.mark.parametrize("tolerance, bound", [(None, 1e-9), (1e-12, 1e-11)], ids=["default", "tight"])


@eqx.filter_jit
def _read(sol):
    """Kinetic, elastic and gravity energy, and angular momentum."""
    system, state = sol.system, sol.states
    parts = [jax.vmap(part)(state) for part in (system.kinetic_energy, system.elastic_energy, system.gravity_energy)]
    return jnp.stack(parts), sol.energy, sol.angular_momentum


_SOLVED = {}


def solved(scene, cone, tolerance):
    key = scene, tolerance
    if key not in _SOLVED:
        sol = jaxrod.simulate(*scene(cone), ts=TIMES, tolerance=tolerance)
        _SOLVED[key] = sol, tuple(np.asarray(x) for x in _read(sol))
    return _SOLVED[key]


@accuracies
@scenes
def test_energy(scene, tolerance, bound, cone):
    _, (parts, energy, _) = solved(scene, cone, tolerance)
    size = np.max(np.sum(np.abs(parts), axis=0))
    error = np.max(np.abs(energy - energy[0])) / size
    assert error <= bound, f"energy changes by {error:.1e} of T + elastic + |gravity|"
    assert np.ptp(parts[0]) > 0.1 * size, "kinetic energy must come and go"


@pytest.mark.parametrize("tolerance, bound", [(None, 1e-10), (1e-12, 1e-11)], ids=["default", "tight"])
@pytest.mark.parametrize("scene", [spherical, flight], ids=["about the vertical", "about the centre of mass"])
def test_angular_momentum(scene, tolerance, bound, cone):
    _, (*_, momentum) = solved(scene, cone, tolerance)
    kept = momentum[:, 2] if momentum.ndim == 2 else momentum
    error = np.max(np.abs(kept - kept[0])) / np.max(np.linalg.norm(momentum.reshape(len(TIMES), -1), axis=1))
    assert error <= bound, f"angular momentum changes by {error:.1e}"


@accuracies
def test_center_of_mass_flies_on_a_parabola(tolerance, bound, cone):
    """To rounding, whatever the tolerance: the method is exact for it."""
    del bound
    sol, _ = solved(flight, cone, tolerance)
    t = TIMES[:, None]
    want = np.array([1.0, 2.0]) + np.array([-1.0, 50.0]) * t - [0.0, GRAVITY / 2] * t**2
    size = np.ptp(want, axis=0)
    np.testing.assert_allclose(np.asarray(sol.center) / size, want / size, rtol=0, atol=1e-12)
    velocity = np.array([-1.0, 50.0]) - [0.0, GRAVITY] * t
    np.testing.assert_allclose(sol.states.center_velocity, velocity, rtol=0, atol=1e-12 * np.max(np.abs(velocity)))


@scenes
def test_the_way_back(scene, cone):
    """Run, turn all velocities round, run again: back at the start, to 1e-8."""
    system, start = scene(cone)
    there, _ = solved(scene, cone, None)
    end = jax.tree.map(lambda x: x[-1], there.states)
    turned = {name: -getattr(end, name) for name in ("direction_rate", "amplitude_rates")}
    if end.center is not None:
        turned["center_velocity"] = -end.center_velocity
    back = jaxrod.simulate(system, dataclasses.replace(end, **turned), ts=TIMES)
    got = jax.tree.map(lambda x: x[-1], back.states)
    rate = 2 * np.pi * jaxrod.natural_frequencies(system)[0]
    for name, scale in {"direction": 1.0, "amplitudes": 1.0, "direction_rate": -rate, "amplitude_rates": -rate}.items():
        np.testing.assert_allclose(
            getattr(got, name) / scale, getattr(start, name) / abs(scale), rtol=0, atol=1e-8, err_msg=name
        )
    assert got.turns == start.turns
    if start.center is not None:
        np.testing.assert_allclose(got.center, start.center, rtol=0, atol=1e-8)
        np.testing.assert_allclose(got.center_velocity, -start.center_velocity, rtol=0, atol=1e-8)


@pytest.mark.parametrize("gravity", [None, 0.0])
def test_without_gravity_rotation_keeps_its_angular_momentum(gravity, cone):
    system = jaxrod.System(cone, jaxrod.Rotation(), gravity=gravity)
    sol = jaxrod.simulate(system, system.state(rate=15.0, strain=0.05), ts=TIMES)
    _, energy, momentum = (np.asarray(x) for x in _read(sol))
    np.testing.assert_allclose(momentum, cone.moment_of_inertia() * 1.05**2 * 15.0, rtol=1e-10)
    np.testing.assert_allclose(energy, energy[0], rtol=1e-9)
    assert np.ptp(sol.rate) > 1.0, "the rate must change with the strain"
