"""What the exact rod says of a quantity: as well as is wanted, and not where it cannot say."""

import jax.numpy as jnp
import numpy as np
import pytest

import jaxrod
from jaxrod.accuracy.reference import comparable, exact_answer

END = jnp.array([2.0])


def _asked(system, start, quantity, ts=END, wanted=1e-6, **others):
    return exact_answer(system, start, quantity, 0.0, ts, False, wanted, **others)


def test_of_the_rubber_cone(cone):
    """The angle after a sudden start, in agreement with truth.json's exact rod; no more modes than are wanted."""
    system = jaxrod.System(cone, jaxrod.Rotation(), gravity=9.81)
    start = system.state(rate=15.0)
    found = _asked(system, start, jaxrod.FinalAngle())
    assert abs(float(found.value) - 28.9782615555) <= found.apart <= 1e-6 and not found.complete
    better = _asked(system, start, jaxrod.FinalAngle(), wanted=1e-8)
    assert better.apart < found.apart and abs(float(better.value) - 28.9782615555) <= 1e-8
    assert _asked(system, start, jaxrod.FinalAngle(), wanted=0.0, most=16).complete


def test_closed_form(cone):
    """The first frequency is the exact cone's, not that of the scene's own shapes."""
    system = jaxrod.System(cone, jaxrod.Rotation())
    found = _asked(system, system.state(), jaxrod.FirstFrequency())
    np.testing.assert_allclose(found.value, jaxrod.continuum.natural_frequencies(system, 1)[0], rtol=1e-14)
    assert found.apart == 0.0


@pytest.mark.slow
def test_a_plan_for_a_frequency(cone):
    """A rigid rod has none, uniform strain is 19 % off, two shapes are enough for a tenth of a Hz."""
    system = jaxrod.System(cone, jaxrod.Rotation())
    found = jaxrod.plan(system, system.state(rate=10.0), t1=0.1, tolerance=0.1, quantity=jaxrod.FirstFrequency())
    assert found.met and found.basis.n == 2 and "the exact rod" in found.why


def test_what_it_does_not_take(cone):
    """Friction, a body without a rod, functions of what it has not, and times beyond reach."""
    system = jaxrod.System(cone, jaxrod.Rotation(), gravity=9.81)
    rubbed = jaxrod.System(cone, jaxrod.Rotation(), forces=[jaxrod.PivotFriction(0.1)])
    lumped = jaxrod.System(jaxrod.Lumped(1.0, 1.0, 1e4, 1.0), jaxrod.Rotation())
    for scene in (rubbed, lumped):
        assert _asked(scene, scene.state(rate=1.0), jaxrod.FinalAngle()) is None
    ledger = jaxrod.CustomQuantity(lambda sol: sol.ledger.energy)
    assert _asked(system, system.state(rate=1.0), ledger) is None and not comparable(ledger)
    assert _asked(system, system.state(rate=1.0), jaxrod.FinalTip(), ts=1e6 * END) is None
    assert comparable(jaxrod.FinalTip())


@pytest.mark.parametrize("quantity, known", [(jaxrod.FinalTip(), 1e-6), (jaxrod.FinalAngle(), 1e-12)])
def test_where_the_strain_jumps(uniform, quantity, known):
    """Let go from a stretch: the tip, a triangle wave, is known badly, and that is said; the angle is not touched."""
    system = jaxrod.System(uniform, jaxrod.Rotation(), jaxrod.Ritz(1))
    start, t1 = system.state(strain=0.01), 0.3 / float(jaxrod.continuum.natural_frequencies(system, 1)[0])
    found = _asked(system, start, quantity, ts=jnp.array([t1]), wanted=1e-9)
    # A quarter period from the greatest stretch to none: 1 - 4 x 0.3 of it.
    true = 1.0 + 0.01 * (1 - 4 * 0.3) if isinstance(quantity, jaxrod.FinalTip) else 0.0
    off = abs(float(np.ravel(found.value)[0]) - true)
    assert off <= 3 * found.apart + 1e-12 and off <= 10 * known
