"""The time of an event, whatever the size of its condition."""

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxrod.integrators.event_time import EventTime


@pytest.mark.parametrize("size", [1e-12, 1.0, 1e12])
@pytest.mark.parametrize("direction", [None, True])
def test_time_and_its_derivative(size, direction):
    """y' = 2 from 0 passes `level` at level / 2; the other condition never does."""

    def time(level):
        events = {"passed": lambda t, y, args, **_: size * (y - level), "never": lambda t, y, args, **_: y + 1.0}
        event = diffrax.Event(events, EventTime(), direction)
        term = diffrax.ODETerm(lambda t, y, args: 2.0 * jnp.ones_like(y))
        run = diffrax.diffeqsolve(term, diffrax.Tsit5(), 0.0, 1.0, 0.17, jnp.asarray(0.0), event=event, throw=False)
        assert run.ts is not None
        return run.ts[-1], run.result == diffrax.RESULTS.event_occurred

    found, happened = time(0.3)
    assert happened
    np.testing.assert_allclose(found, 0.15, rtol=1e-14)
    np.testing.assert_allclose(jax.grad(lambda level: time(level)[0])(0.3), 0.5, rtol=1e-12)
