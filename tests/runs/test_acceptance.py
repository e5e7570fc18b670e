"""What a run of equal steps is held against before it is believed."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxrod
from jaxrod.motions.stops import Stops
from jaxrod.runs.acceptance import MOST_STEPS, Comparison, steps_so_far
from jaxrod.runs.scales import Scales
from jaxrod.runs.step_policy import StepPolicy


@pytest.mark.parametrize("ts", [[0.0, 0.1, 0.2, 0.3], [0.05, 0.1, 0.2, 0.3], np.linspace(0.0, 0.3, 20)], ids=len)
def test_the_first_part_of_a_run_has_steps(scene, ts):
    """Also where the first time that is saved is the start, which no step leads to."""
    system, ts, t0 = scene(basis=jaxrod.Ritz(3)), jnp.asarray(ts), jnp.zeros(())
    _, discrete, _ = system.or_idle()
    start = system.state(rate=1.0)
    scales = Scales.of(discrete, start, t0, ts[-1])
    steps = jnp.where(jnp.diff(ts, prepend=t0) > 0, 10, 0)
    found = Comparison.of(discrete, start, scales, t0, ts, Stops(ts, None, None), steps, StepPolicy())
    assert found is not None and not found.whole
    assert found.looked.sum() == 1 and (found.route.taken > 0).sum() == 1
    assert found.route.taken[jnp.argmax(found.looked)] > 0


@pytest.mark.parametrize("counts", [[2**24, 1, 1], [2**29, 2**29, 2**29, 2**30]], ids=["odd", "many"])
def test_steps_are_counted_one_by_one(counts):
    """Also beyond what a float32 tells apart, and what an int32 holds."""
    with jax.enable_x64(False):
        found = steps_so_far(jnp.asarray(counts, jnp.int32))
    np.testing.assert_array_equal(found, np.minimum(np.cumsum(np.asarray(counts, np.int64)), MOST_STEPS))


def test_a_drive_that_turns_fast_between_two_save_times(scene):
    """Steps of which one turns the rod by more than half a right angle are too long, wherever in the run they are."""

    def pulse(t):
        return 1.7 * jnp.exp(-((40 * (t - 0.5)) ** 2))

    system = scene(jaxrod.Driven(pulse))
    results = [
        jaxrod.simulate(
            system, system.state(), t1=1.0, n_steps=n_steps, solver=jaxrod.BlanesMoan6(), throw=False
        ).result
        for n_steps in (50, 400)
    ]
    assert results == [jaxrod.Result.coarse, jaxrod.Result.ok]
