"""A kernel in C for n = 1 in the plane, compiled on the spot for this machine with the scheme's coefficients in it.

Blocks of 64 lanes are given to the threads of OpenMP; equal steps of any scheme of drifts and kicks.

Tried, ns per stage and lane in float64 on a machine with AVX-512: `#pragma omp simd` over 64 lanes in memory 0.9, with
vectors of 256 or 512 bits, with sqrt and division or in float32 with a correction alike; groups of four registers of
512 bits kept through all steps 0.7, of three 0.8, of two 1.0, and with sqrt and division 0.9.  The registers are
taken where there is AVX-512, the loops elsewhere or with `loops=True`.

    python -m benchmarks.peers.c_kernel
"""

import ctypes
import os
import pathlib
import re
import shutil
import subprocess
import tempfile
import time

import numpy as np

from .common import Missing, Peer, table
from .problem import Problem
from .schemes import BLANES_MOAN_6, KAHAN_LI_8, SOFRONIOU_SPALETTA_10, STEPS, Scheme

SOURCE = pathlib.Path(__file__).with_name("kernel.c")
FLAGS = ("-O3", "-march=native", "-ffast-math", "-fopenmp", "-fPIC")
BLOCK = 64
PACKED = re.compile(r"\sv(?:fn?m(?:add|sub)\d+|mul|add|sub|div|sqrt|rsqrt14)p[sd]\s.*?%([xyz])mm|\sfmla\s+v\d+\.(\d\w)")
SCALAR = re.compile(r"\sv(?:fn?m(?:add|sub)\d+|mul|add|sub|div|sqrt)s[sd]\s|\sf(?:madd|mul|add|sub)\s+[sd]\d")


class Kernel:
    """The kernel with one scheme, in float64 or float32, on `cores` threads.  A setting is a number of steps."""

    def __init__(self, scheme: Scheme = BLANES_MOAN_6, dtype="float64", cores: int = 1, *, loops: bool = False):
        self.compiler = shutil.which(os.environ.get("CC", "cc"))
        if self.compiler is None:
            raise Missing("no C compiler on the path")
        self.scheme, self.dtype, self.cores, self.loops = scheme, np.dtype(dtype), cores, loops
        self.name = f"C, {scheme.name}, {self.dtype}" + (", loops" if loops else "")
        self.settings = STEPS.get(scheme, (500, 1000, 2000, 4000, 8000))
        if self.dtype == np.float32:
            self.settings = self.settings[:3]

    def compile(self, problem: Problem) -> float:
        if problem.n != 1:
            raise Missing("the kernel is of n = 1 only")
        self.problem = problem
        begin = time.perf_counter()
        self.folder = tempfile.TemporaryDirectory()
        library = pathlib.Path(self.folder.name) / "kernel.so"
        self._call("-shared", "-o", str(library))
        self.function = ctypes.CDLL(str(library)).run
        number, long = ctypes.c_double, ctypes.c_long
        self.function.argtypes = [long, ctypes.c_int, long, number, number, number, *4 * [ctypes.c_void_p]]
        self.function.restype = None
        return time.perf_counter() - begin

    def _call(self, *options: str) -> None:
        drifts, kicks = list(self.scheme.drifts), self.scheme.kicks
        first = drifts.pop(0)
        drifts[-1] += first
        stages = " ".join(f"STAGE({kick!r}, {drift!r})" for kick, drift in zip(kicks, drifts, strict=True))
        header = pathlib.Path(self.folder.name) / "scheme.h"
        header.write_text(f"#define FIRST {first!r}\n#define SCHEME {stages}\n", encoding="utf-8")
        real = "float" if self.dtype == np.float32 else "double"
        macros = [f"-DREAL={real}", *(["-DLOOPS"] if self.loops else [])]
        command = [self.compiler, *FLAGS, *macros, "-I", self.folder.name, str(SOURCE), *options, "-lm"]
        done = subprocess.run(command, capture_output=True, text=True)
        if done.returncode:
            raise Missing("the C compiler failed: " + next(iter(done.stderr.strip().splitlines()), "no message"))

    def vector_registers(self) -> str:
        """What the compiler made of the steps, in one line.

        **Raises:** `RuntimeError` if nothing is packed, or most of it is scalar.
        """
        listing = pathlib.Path(self.folder.name) / "kernel.s"
        self._call("-S", "-o", str(listing))
        body = listing.read_text(encoding="utf-8").split("\nhot:")[1].split(".size\thot")[0]
        # The steps are the longest of the loops: what lies between a label and the branch back to it.
        lines = body.splitlines()
        labels = {line[:-1]: number for number, line in enumerate(lines) if re.fullmatch(r"\.L\w+:", line)}
        loops = [
            (number - labels[target], "\n".join(lines[labels[target] : number]))
            for number, line in enumerate(lines)
            for target in re.findall(r"\s(?:j\w+|b\.\w+|cb\w+\s.*,)\s+(\.L\w+)$", line)
            if labels.get(target, number) < number
        ]
        steps = max(loops)[1] if self.loops or len(loops) == 1 else self._innermost(loops)
        packed, scalar = PACKED.findall(steps), len(SCALAR.findall(steps))
        if len(packed) <= scalar:
            raise RuntimeError(f"{self.name}: {len(packed)} packed instructions, {scalar} scalar: not vectorised.")
        counts = ", ".join(f"{sum(x == kind for x, _ in packed)} {kind}mm" for kind in "zyx")
        if not any(kind for kind, _ in packed):
            counts = f"{len(packed)} fmla"
        fused = len(re.findall(r"\svfn?m(?:add|sub)\d+p[sd]\s", steps))
        return f"{self.name}: loop of the steps: packed arithmetic {counts}, of it {fused} fused; {scalar} scalar"

    @staticmethod
    def _innermost(loops) -> str:
        """The longest loop that holds no other."""
        texts = [text for _, text in loops]
        return max((text for text in texts if not any(x != text and x in text for x in texts)), key=len)

    def run(self, setting):
        problem, steps = self.problem, int(setting)
        flat = problem.flat()
        blocks = -(-problem.lanes // BLOCK)
        # The last block's empty lanes repeat the first ones.
        x, y, u, v = np.zeros((4, blocks * BLOCK), self.dtype)
        x[:], v[:] = 1.0, np.resize(problem.rates, blocks * BLOCK)
        places = [array.ctypes.data for array in (x, y, u, v)]
        begin = time.perf_counter()
        self.function(blocks, self.cores, steps, problem.duration / steps, flat.k, flat.gamma, *places)
        seconds = time.perf_counter() - begin
        tips = flat.length * np.stack([x, y], axis=-1)[: problem.lanes].astype(np.float64)
        return tips, seconds * problem.lanes / (blocks * BLOCK)


def peers() -> list[Peer]:
    """The schemes of orders 6, 8 and 10 on one core and two, and float32."""
    schemes = (BLANES_MOAN_6, KAHAN_LI_8, SOFRONIOU_SPALETTA_10)
    return [
        *(Kernel(scheme, cores=cores) for cores in (1, 2) for scheme in schemes),
        *(Kernel(BLANES_MOAN_6, "float32", cores) for cores in (1, 2)),
    ]


def main() -> None:
    import jaxrod

    jaxrod.configure(cache=None)
    problem = Problem.figure_2(1, np.linspace(14.0, 16.0, BLOCK))
    for dtype in ("float64", "float32"):
        for loops in (False, True):
            kernel = Kernel(BLANES_MOAN_6, dtype, loops=loops)
            kernel.compile(problem)
            print(kernel.vector_registers())
    loops = [lambda: Kernel(BLANES_MOAN_6, loops=True)]
    table([*loops, *(lambda i=i: peers()[i] for i in range(len(peers())))], ns=(1,), repeats=4)


if __name__ == "__main__":
    main()
