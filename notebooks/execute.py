"""Runs each notebook's source (NN_name.py) and writes it with its outputs (NN_name.ipynb): python notebooks/execute.py"""

import os
import pathlib

import jupytext
import nbclient

os.environ["JAXROD_PROGRESS"] = "0"  # outputs are to be the same again
for source in sorted(pathlib.Path(__file__).parent.glob("[0-9]*.py")):
    notebook = jupytext.read(source)
    nbclient.NotebookClient(
        notebook, timeout=600, kernel_name="python3", resources={"metadata": {"path": str(source.parent)}}
    ).execute()
    jupytext.write(notebook, source.with_suffix(".ipynb"))
    print(f"wrote {source.with_suffix('.ipynb').name}")
