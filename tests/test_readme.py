"""The README's example runs, and its comments say what it gives."""

import pathlib
import re

import jax
import jax.numpy as jnp
import pytest

import jaxrod

README = pathlib.Path(__file__).parent.parent / "README.md"


def test_example(capsys):
    text = README.read_text()
    blocks = re.findall(r"```python\n(.*?)```", text, flags=re.DOTALL)
    assert len(blocks) == 4
    names: dict = {}
    exec(compile(blocks[0], str(README), "exec"), names)
    assert f"{names['f'][0]:.2f} Hz" in text
    assert f"{names['percent'][0]:.1f} % above" in text
    assert ", ".join(f"{x:.2f}" for x in names["exact"]) + " Hz" in text
    assert names["out"]["strain"].shape == (100,) and jnp.isfinite(names["slope"])
    printed = capsys.readouterr().out
    assert "the run reached its end" in printed and "young = " in printed and "taper = " in printed


@pytest.mark.slow
def test_any_rod_any_rung_any_load(capsys):
    """The second example: every line runs, and the rungs are as near to the exact rod as it shows."""
    block = re.findall(r"```python\n(.*?)```", README.read_text(), flags=re.DOTALL)[1]
    names: dict = {}
    with jax.numpy_rank_promotion("allow"):  # an example is a user's program
        exec(compile(block, str(README), "exec"), names)
    best, printed = names["best"], capsys.readouterr().out
    exact = jaxrod.continuum.natural_frequencies(best, 2)
    assert jnp.allclose(jaxrod.natural_frequencies(best)[:2], exact, rtol=1e-5)
    assert "the run reached its end" in printed and "growth" in printed
    assert names["run"].strain[-1] > 0


@pytest.mark.slow
def test_a_million_rods():
    """The third example: every scene ends ok, and faster turning stretches more."""
    block = re.findall(r"```python\n(.*?)```", README.read_text(), flags=re.DOTALL)[2]
    names: dict = {}
    exec(compile(block, str(README), "exec"), names)
    out, slopes = names["out"], names["slopes"]
    assert (out["result"] == jaxrod.Result.ok).all()
    assert out["strain"].shape == (256,) and (out["tip"] < 1.2).all()
    assert (slopes["rate"] > 0).mean() > 0.9 and jnp.isfinite(slopes["young"]).all()


@pytest.mark.slow
def test_how_wrong(capsys):
    """The fourth example: the budget and the exact rod are as it says, the plan is kept."""
    text = README.read_text()
    block = re.findall(r"```python\n(.*?)```", text, flags=re.DOTALL)[3]
    names: dict = {}
    exec(compile(block.replace("seconds=20.0", "seconds=1.0"), str(README), "exec"), names)
    budget, exact, run = names["sol"].budget, float(names["exact"].angle[-1]), names["run"]
    assert f"{float(budget.value):.10g} rad ± {float(budget.bound):.1e}" in text and f"{exact:.5f} rad" in text
    assert abs(float(budget.value) - exact) < budget.bound and budget.model > 0.99 * budget.bound
    assert names["found"].met and abs(float(run.angle[-1]) - exact) < 1e-3
    printed = capsys.readouterr().out
    assert "the exact rod" in printed and "distances grow" in printed
