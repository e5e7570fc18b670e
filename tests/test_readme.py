"""The README's example runs, and its comments say what it gives."""

import pathlib
import re

import numpy as np

README = pathlib.Path(__file__).parent.parent / "README.md"


def test_example(capsys):
    blocks = re.findall(r"```python\n(.*?)```", README.read_text(), flags=re.DOTALL)
    assert len(blocks) == 1
    names: dict = {}
    exec(compile(blocks[0], str(README), "exec"), names)
    assert np.round(names["f"], 2).tolist() == [22.97]
    assert np.round(names["percent"], 1).tolist() == [19.4]
    assert np.round(names["exact"], 2).tolist() == [19.24, 67.42]
    assert names["out"]["strain"].shape == (100,) and np.isfinite(names["slope"])
    printed = capsys.readouterr().out
    assert "the run reached its end" in printed and "young = 1" in printed and "taper = 1.5" in printed
