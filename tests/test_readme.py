"""The README's examples run as a reader runs them, each in a process of its own, and print what their comments say."""

import os
import pathlib
import re
import subprocess
import sys

import pytest

README = pathlib.Path(__file__).parent.parent / "README.md"
BLOCKS = re.findall(r"```python\n(.*?)```", README.read_text(), flags=re.DOTALL)


def printed(block: int, **instead: str) -> str:
    """What a block prints, as a program of its own; `instead`: keywords with other values."""
    program = BLOCKS[block]
    for name, value in instead.items():
        program, count = re.subn(rf"\b{name}=[\w.]+", f"{name}={value}", program)
        assert count == 1
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1"}
    run = subprocess.run(
        [sys.executable, "-W", "error::UserWarning", "-c", program],
        capture_output=True, text=True, timeout=900, env=environment, cwd=README.parent,
    )  # fmt: skip
    assert run.returncode == 0, run.stderr
    assert run.stdout.strip()
    return run.stdout


def numbers(line: str) -> list[float]:
    return [float(x) for x in re.findall(r"-?\d+\.?\d*(?:e[+-]\d+)?", line)]


def test_there_are_four_and_each_configures():
    assert len(BLOCKS) == 4 and all("jaxrod.configure()" in block for block in BLOCKS)


@pytest.mark.slow
def test_ten_lines():
    text, lines = README.read_text(), printed(0).splitlines()
    frequency, percent, exact = (
        numbers(line) for line in lines[lines.index(next(x for x in lines if x[0] == "[")) :][:3]
    )
    assert f"{frequency[0]:.2f} Hz" in text and f"{percent[0]:.1f} % above" in text
    assert ", ".join(f"{x:.2f}" for x in exact) + " Hz" in text
    out = "\n".join(lines)
    assert "the run reached its end" in out and "young = " in out and "taper = " in out and "float64" in out


@pytest.mark.slow
def test_any_rod_any_rung_any_load():
    out = printed(1)
    assert "the run reached its end" in out and "growth" in out
    frequencies = numbers(out[: out.index("frequency, Hz")].replace("\n", " "))
    assert abs(frequencies[0] / frequencies[4] - 1) < 1e-5 and abs(frequencies[1] / frequencies[5] - 1) < 1e-5
    before, after = numbers(out.splitlines()[-1])
    assert after > before + 0.1  # the blow


@pytest.mark.slow
def test_a_million_rods():
    ok, many, strain, slope, *apart = numbers(printed(2).replace("rate) up", "up"))
    assert ok == many == 256 and 0 < strain < 0.2 and slope > 0
    assert len(apart) == 5 and max(map(abs, apart)) < 1e-9


@pytest.mark.slow
def test_how_wrong():
    """The budget and the exact rod are as it says, the plan is kept."""
    text, out = README.read_text(), printed(3, seconds="1.0")
    ((value, bound),) = ([float(x) for x in found] for found in re.findall(r"([\d.]+) rad ± ([\d.e+-]+)", text))
    (exact,) = map(float, re.findall(r"exact rod: ([\d.]+) rad", text))
    shown = re.search(r"([\d.]+) rad ± ([\d.e+-]+)", out)
    assert shown and abs(float(shown[1]) - value) < 1e-6 and abs(float(shown[2]) / bound - 1) < 0.05
    assert abs(value - exact) < bound and "all of it the model's" in text
    assert "distances grow" in out and "the exact rod" in out
