"""The README's example runs, and its comments say what it gives."""

import pathlib
import re

import jax.numpy as jnp

README = pathlib.Path(__file__).parent.parent / "README.md"


def test_example(capsys):
    text = README.read_text()
    blocks = re.findall(r"```python\n(.*?)```", text, flags=re.DOTALL)
    assert len(blocks) == 1
    names: dict = {}
    exec(compile(blocks[0], str(README), "exec"), names)
    assert f"{names['f'][0]:.2f} Hz" in text
    assert f"{names['percent'][0]:.1f} % above" in text
    assert ", ".join(f"{x:.2f}" for x in names["exact"]) + " Hz" in text
    assert names["out"]["strain"].shape == (100,) and jnp.isfinite(names["slope"])
    printed = capsys.readouterr().out
    assert "the run reached its end" in printed and "young = " in printed and "taper = " in printed
