"""The one loop of equal steps: its program holds what the scene requires and nothing else, and does not grow with it."""

import jax
import pytest

import jaxrod


def _lowered(system):
    def end(rate):
        return jaxrod.simulate(system, system.state(rate=rate), t1=0.1).angle[-1]

    return jax.jit(end).lower(10.0)


def _operations(system) -> float:
    """Of the compiled program, the body of each loop counted once."""
    cost = _lowered(system).compile().cost_analysis()
    assert isinstance(cost, dict)
    return cost["flops"]


@pytest.mark.slow
def test_more_shapes_take_more_operations(scene):
    found = [
        _operations(scene(basis=jaxrod.LoadRitz(n) if n > 1 else jaxrod.Ritz(n), gravity=9.81)) for n in (0, 1, 3, 12)
    ]
    assert found == sorted(set(found))


@pytest.mark.parametrize("basis", [jaxrod.Ritz(1), jaxrod.LoadRitz(3)], ids=repr)
def test_what_is_not_there_takes_none(scene, basis):
    bare = scene(basis=basis)
    weighing = scene(basis=basis, gravity=9.81)
    loaded = scene(basis=basis, gravity=9.81, forces=[jaxrod.Torque(lambda t, state: 0.1 * state.angle)])
    found = [_operations(system) for system in (bare, weighing, loaded)]
    assert found == sorted(set(found))


def test_the_program_does_not_grow_with_the_shapes(scene):
    """As text: arrays get longer, lines do not get more."""
    few, many = (len(_lowered(scene(basis=jaxrod.LoadRitz(n), gravity=9.81)).as_text().splitlines()) for n in (4, 12))
    assert many < 1.1 * few
