"""Notebooks run from top to bottom, and what is committed is what their source says and prints."""

import pathlib
import re

import jupytext
import nbclient
import pytest

SOURCES = sorted((pathlib.Path(__file__).parent.parent / "notebooks").glob("[0-9]*.py"))


@pytest.mark.slow
@pytest.mark.parametrize("source", SOURCES, ids=lambda path: path.stem)
def test_runs(source, monkeypatch):
    monkeypatch.setenv("JAXROD_PROGRESS", "0")
    notebook = jupytext.read(source)
    where = {"metadata": {"path": str(source.parent)}}
    nbclient.NotebookClient(notebook, timeout=300, kernel_name="python3", resources=where).execute()
    outputs = [output for cell in notebook.cells if cell.cell_type == "code" for output in cell.outputs]
    assert any("image/png" in output.get("data", {}) for output in outputs)
    committed = jupytext.read(source.with_suffix(".ipynb"))
    for cell, before in zip(notebook.cells, committed.cells, strict=True):
        if cell.cell_type == "code" and "measured" not in cell.metadata.get("tags", []):  # times, and what they choose
            assert_alike(_printed(cell), _printed(before))


def _printed(cell) -> str:
    """What a cell printed, and its tables."""
    texts = [output.get("text", "") or output.get("data", {}).get("text/markdown", "") for output in cell.outputs]
    return "".join(texts)


NUMBER = r"[-+]?\d+\.?\d*(?:e[-+]?\d+)?"


def assert_alike(found: str, committed: str) -> None:
    """The same words, and the same numbers but for rounding; how many steps a fit takes is of the version of JAX."""
    found, committed = (re.sub(r"\d+ steps", "steps", text) for text in (found, committed))
    words, before = (re.sub(rf"\s+|{NUMBER}", " ", text).split() for text in (found, committed))
    assert words == before
    numbers, before = (list(map(float, re.findall(NUMBER, text))) for text in (found, committed))
    off = [(x, y) for x, y in zip(numbers, before, strict=True) if abs(x - y) > max(0.02 * abs(y), 1e-9)]
    assert not off


def test_alike():
    assert_alike("a 1.000 b -1e-14", "a 1.001 b  2e-15")
    for found in ("a 1.1 b 0", "a 1.0 c 0", "a 1.0 b"):
        with pytest.raises((AssertionError, ValueError)):
            assert_alike(found, "a 1.0 b 0")


@pytest.mark.parametrize("source", SOURCES, ids=lambda path: path.stem)
def test_committed_outputs_belong_to_the_source(source):
    written, executed = jupytext.read(source), jupytext.read(source.with_suffix(".ipynb"))
    assert [cell.source for cell in written.cells] == [cell.source for cell in executed.cells]
    outputs = [output for cell in executed.cells if cell.cell_type == "code" for output in cell.outputs]
    pictures = [output for output in outputs if "image/png" in output.get("data", {})]
    assert len(pictures) >= 2
