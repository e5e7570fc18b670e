"""What the scripts share: paired timing, and pages in docs/, of which each writes its own part."""

import contextlib
import datetime
import importlib.metadata
import os
import pathlib
import platform
import re
import statistics
import time
import warnings
from collections.abc import Callable, Iterator

PAGE = pathlib.Path(__file__).parent.parent / "docs" / "performance.md"


def paired(runs: dict[str, Callable[[], object]], repeats: int = 7) -> dict[str, float]:
    """Median seconds of each run.  They take turns, so that a busy moment of the machine hits all alike.

    Each runs once before, which compiles it.
    """
    for run in runs.values():
        run()
    seconds: dict[str, list[float]] = {name: [] for name in runs}
    for _ in range(repeats):
        for name, run in runs.items():
            began = time.perf_counter()
            run()
            seconds[name].append(time.perf_counter() - began)
    return {name: statistics.median(found) for name, found in seconds.items()}


def table(head: list[str], rows: list[list[str]]) -> str:
    """A Markdown table."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


@contextlib.contextmanager
def quiet() -> Iterator[None]:
    """Without warnings: where failing scenes are what is asked for."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        yield


def machine() -> str:
    """One line on where and when."""
    versions = ", ".join(f"{name} {importlib.metadata.version(name)}" for name in ("jax", "diffrax", "equinox"))
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    cpu = platform.processor() or platform.machine()
    info = pathlib.Path("/proc/cpuinfo")
    if info.exists():
        cpu = next((x.split(":")[1].strip() for x in info.read_text().splitlines() if x.startswith("model name")), cpu)
    return f"{datetime.date.today()}, {cpu}, {cores} cores, Python {platform.python_version()}, {versions}."


def write(part: str, text: str, path: pathlib.Path = PAGE) -> None:
    """Prints the text, and puts it between the marks of its part in a page of docs/."""
    text = f"{text.strip()}\n\n{machine()}"
    print(text)
    page = path.read_text() if path.exists() else f"# {path.stem.capitalize()}\n"
    start, end = f"<!-- {part} -->", f"<!-- /{part} -->"
    block = f"{start}\n{text}\n{end}"
    if start in page:
        page = re.sub(re.escape(start) + ".*?" + re.escape(end), lambda _: block, page, flags=re.DOTALL)
    else:
        page = f"{page.rstrip()}\n\n{block}\n"
    path.write_text(page)
