"""What accuracy costs, measured on a scene."""

import dataclasses
import sys

import numpy as np
import pytest

import jaxrod
from jaxrod.__main__ import main
from jaxrod.accuracy.ladder import at_rest, on_rung
from jaxrod.accuracy.run_plan import named
from jaxrod.accuracy.work_precision import Row, Tradeoff, _ways


def test_front():
    """The rows that no other beats in both; not one that is a hundredth better and costs more."""
    worth = ((1e-2, 1), (1e-1, 2), (1e-4, 3), (0.99e-4, 4))
    rows = [Row("a", "x", "float64", 10, error, cost) for error, cost in worth]
    found = Tradeoff(rows, "tip", "m", "the exact rod", 1e-9, 3, 12.0)
    assert [row.cost for row in found.front] == [1, 3]
    assert "no time for 3 more ways: all take about seconds=12" in str(found) and str(found).count("float64") == 2


@pytest.mark.slow
def test_no_luck(monkeypatch):
    """Started steadily, uniform strain is 5.0e-3 rad off after 2 s, and no steps that happen to undo it make it better."""
    monkeypatch.setattr(sys.modules["jaxrod.accuracy.work_precision"], "RUNGS", (jaxrod.Ritz(1),))
    monkeypatch.setattr(
        sys.modules["jaxrod.accuracy.work_precision"], "solvers", lambda scene: [jaxrod.StormerVerlet()]
    )
    monkeypatch.setattr(sys.modules["jaxrod.accuracy.work_precision"], "_FRACTIONS", np.geomspace(0.1, 4.0, 40))
    scene = jaxrod.scenes.cone_started_steadily()
    known = {"t1": scene.t1, "quantity": scene.quantity, "static": True}
    found = jaxrod.tradeoff(scene.system, scene.start, **known, seconds=1.0, progress=False)
    errors = [row.error for row in found.rows]
    assert len(errors) >= 20 and 4.9e-3 < min(errors) < 5.1e-3


@pytest.mark.slow
def test_its_own_rung_comes_first(monkeypatch, scene):
    """And rungs that are far apart, before other types and solvers; without time one way is tried, and all are counted."""
    system = scene(basis=jaxrod.Ritz(4), gravity=9.81)
    ways = [named(way.basis) for way in _ways(system)]
    assert ways[:3] == ["Ritz(4)", "Ritz(1)", "rigid"] and len(set(ways[:9])) == 9
    found = jaxrod.tradeoff(system, system.state(rate=5.0), t1=0.05, seconds=1e-3)
    assert {row.rung for row in found.rows} == {"Ritz(4)"} and found.left == len(ways) - 1
    legend = jaxrod.plot.tradeoff(found).axes[0].get_legend()
    assert [text.get_text() for text in legend.get_texts()] == ["Ritz(4)"]
    assert f"no time for {found.left} more ways" in str(found) and found.seconds > 0.1 * len(ways)


@pytest.mark.slow
def test_of_a_scene(cone, tmp_path, monkeypatch):
    """Rigid first; more shapes are nearer to the exact rod; and a picture."""
    rungs = (jaxrod.Ritz(0), jaxrod.Ritz(1), jaxrod.Ritz(3), jaxrod.LoadRitz(4))
    monkeypatch.setattr(sys.modules["jaxrod.accuracy.work_precision"], "RUNGS", rungs)
    monkeypatch.setattr(
        sys.modules["jaxrod.accuracy.work_precision"], "solvers", lambda scene: [jaxrod.default_solver(scene)]
    )
    system = jaxrod.System(cone, jaxrod.Rotation(), gravity=9.81)
    found = jaxrod.tradeoff(system, system.state(rate=15.0), t1=0.2, seconds=1e6, progress=False)
    assert found.left == 0 and {row.dtype for row in found.rows} == {"float32", "float64"}
    best = {}
    for row in found.rows:
        best[row.rung] = min(row.error, best.get(row.rung, np.inf))
    assert found.reference == "the exact rod" and found.own_error < 1e-7
    assert best["rigid"] > 30 * best["LoadRitz(4)"] and best["Ritz(1)"] > 3 * best["Ritz(3)"]
    jaxrod.plot.tradeoff(found, "cone").savefig(tmp_path / "front.png")
    assert (tmp_path / "front.png").stat().st_size > 10_000


@pytest.mark.slow
def test_static_starts_stay(cone):
    """Steadily turning without gravity, every rung keeps the strain that it starts with."""
    system = jaxrod.System(cone, jaxrod.Rotation(), jaxrod.Ritz(1))
    for basis in (jaxrod.Ritz(1), jaxrod.LoadRitz(3)):
        scene, start = on_rung(system, system.state(rate=15.0), basis)
        start = at_rest(scene, start)
        end = jaxrod.simulate(scene, start, t1=0.2).states
        np.testing.assert_allclose(end.amplitudes[-1], start.amplitudes, atol=1e-9)
        assert abs(start.amplitudes[0]) > 1e-3


def test_refusals(cone):
    system = jaxrod.System(cone, jaxrod.Rotation())
    with pytest.raises(ValueError, match="seconds="):
        jaxrod.tradeoff(system, system.state(), t1=1.0, seconds=0.0)
    with pytest.raises(ValueError, match="Lumped"):
        jaxrod.tradeoff(jaxrod.paper.literal(), jaxrod.paper.literal().state(), t1=1.0)
    assert main(["tradeoff", "a-misspelt-scene"]) == 2
    with pytest.raises(SystemExit):
        main(["tradeoff", "impact", "--seconds", "0"])


@pytest.mark.slow
def test_laws_and_late_starts_have_their_rungs(cone):
    """No condensed rung of a law that is not Hooke's; driven neither; and a steady strain is that of its own time."""
    stiffening = dataclasses.replace(cone, law=jaxrod.law.neo_hookean)
    for rod, motion, whether in (
        (cone, jaxrod.Rotation(), True), (stiffening, jaxrod.Rotation(), False), (cone, jaxrod.scenes.steady(1.0), False)
    ):  # fmt: skip
        ways = list(sys.modules["jaxrod.accuracy.work_precision"]._ways(jaxrod.System(rod, motion)))
        assert any(isinstance(way.basis, jaxrod.QuasiStatic) for way in ways) == whether
        assert {jaxrod.LoadRitz, jaxrod.Ritz} <= {type(way.basis) for way in ways}
    faster = jaxrod.System(cone, jaxrod.Driven(lambda t: 5.0 * t**2), jaxrod.LoadRitz(6))
    exact = jaxrod.continuum.simulate(faster, faster.state(), t0=2.0, ts=[2.001], static=True)
    late = jaxrod.simulate(faster, at_rest(faster, faster.state(), 2.0), t0=2.0, t1=2.001)
    np.testing.assert_allclose(late.strain, exact.tip_stretch, rtol=1e-3)
    assert late.strain[0] > 0.01
    bent = jaxrod.System(stiffening, jaxrod.Rotation())
    with pytest.raises(ValueError, match="static strain is of Hooke's law"):
        at_rest(bent, bent.state(rate=10.0))
    with pytest.raises(ValueError, match="static=True is of Hooke's law"):
        jaxrod.tradeoff(bent, bent.state(rate=10.0), t1=1.0, static=True)


OWN = """
import jaxrod

def pendulum():
    rod = jaxrod.Rod(length=1.0, section=jaxrod.Uniform(0.02), young=1e7, density=1200.0)
    system = jaxrod.System(rod, jaxrod.Rotation(), gravity=9.81)
    return jaxrod.scenes.Scene("a pendulum", system, system.state(), 0.1, jaxrod.FinalTip())

def number():
    return 1.0
"""


@pytest.mark.slow
def test_command_line_with_a_scene_of_ones_own(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(sys.modules["jaxrod.accuracy.work_precision"], "RUNGS", (jaxrod.Ritz(0), jaxrod.Ritz(1)))
    (tmp_path / "own.py").write_text(OWN)
    out = ["--seconds", "0.1", "--out", str(tmp_path / "out")]
    for wrong in ("own.py:number", "own.py:none", "missing.py:pendulum", "own.py"):
        assert main(["tradeoff", str(tmp_path / wrong), *out]) == 2
    assert main(["tradeoff", f"{tmp_path / 'own.py'}:pendulum", *out]) == 0
    assert "a pendulum" in capsys.readouterr().out and (tmp_path / "out" / "pendulum.png").stat().st_size > 10_000


@pytest.mark.slow
def test_a_blow():
    """A fixed root doubles the wave of a blow at the tip; uniform strain, struck like an oscillator, feels less than half."""
    scene = jaxrod.scenes.impact()
    ts, static = scene.quantity.times(0.0, scene.t1), 0.01
    exact = jaxrod.continuum.simulate(scene.system, scene.start, ts=ts, modes=64, error=False)
    assert abs(float(scene.quantity(exact)) / static - 2.0) < 1e-3
    # An oscillator after a half-sine of r times its rate: 2 r cos(pi / 2 r) / (r^2 - 1) of the static answer.
    r = np.pi / 0.72 / np.sqrt(3.0)
    struck = 2 * r * np.cos(np.pi / (2 * r)) / (r**2 - 1)
    uniform = jaxrod.simulate(scene.system, scene.start, ts=ts)
    np.testing.assert_allclose(scene.quantity(uniform) / static, struck, rtol=1e-3)
    assert 0.76 < struck < 0.77


@pytest.mark.parametrize("name", list(jaxrod.scenes.NAMED))
def test_named_scenes_run(name):
    scene = jaxrod.scenes.NAMED[name]()
    sol = jaxrod.simulate(scene.system, scene.start, ts=scene.quantity.times(0.0, scene.t1 / 10))
    assert np.all(np.isfinite(scene.quantity(sol))), scene.title
