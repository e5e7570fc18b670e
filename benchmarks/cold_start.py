"""How long until the first answer?  Whole processes: with an empty compile cache, and the second time.

    python benchmarks/cold_start.py

Against `python -c "import diffrax, matplotlib"`, which any program of this kind pays.  Medians of processes in turn.
Writes the part "cold start" of docs/performance.md.
"""

import os
import subprocess
import sys
import tempfile
from collections.abc import Callable

import report

SIMULATE = """
import jaxrod; jaxrod.configure()
rod = jaxrod.Rod(1.0, jaxrod.Cone(0.02, 0.03), young=1e7, density=1200.0)
system = jaxrod.System(rod, jaxrod.Rotation(), jaxrod.Ritz(%d), gravity=9.81)
print(jaxrod.simulate(system, system.state(rate=15.0), t1=1.0).angle)
"""


def main() -> None:
    with tempfile.TemporaryDirectory() as folder:

        def process(arguments, cache=f"{folder}/warm"):
            environment = {**os.environ, "JAXROD_CACHE": cache}
            subprocess.run(
                [sys.executable, *arguments], check=True, cwd=folder, env=environment, stdout=subprocess.DEVNULL
            )

        def cold(arguments):
            with tempfile.TemporaryDirectory() as empty:
                process(arguments, empty)

        paper, one, three = ["-m", "jaxrod", "paper"], ["-c", SIMULATE % 1], ["-c", SIMULATE % 3]
        runs: dict[str, Callable[[], object]] = {
            "import diffrax, matplotlib": lambda: process(["-c", "import diffrax, matplotlib"]),
            "jaxrod paper, second process": lambda: process(paper),
            "simulate, Ritz(1), second process": lambda: process(one),
            "simulate, Ritz(3), second process": lambda: process(three),
        }
        times = report.paired(runs, 3)
        first = {"jaxrod paper": paper, "simulate, Ritz(1)": one, "simulate, Ritz(3)": three}
        times |= report.paired({f"{name}, empty cache": lambda a=a: cold(a) for name, a in first.items()}, 1)
    least = times["import diffrax, matplotlib"]
    rows = [[name, f"{t:.1f}", f"{t / least:.2f}"] for name, t in times.items()]
    head = "## Cold start\n\n`python benchmarks/cold_start.py`: whole processes, medians of three in turn (empty cache: one).\n\n"
    report.write("cold start", head + report.table(["process", "s", "ratio"], rows))


if __name__ == "__main__":
    main()
