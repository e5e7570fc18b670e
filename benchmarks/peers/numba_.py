"""Numba: the same drifts and kicks as the C kernel, n = 1 in the plane, parallel over blocks of 64 lanes.

The inner loop over the lanes of a block is what LLVM vectorises; the coefficients are constants of the compiled
program.

    python -m benchmarks.peers.numba_
"""

import time

import numpy as np

from .common import Missing, Peer, table
from .problem import Problem
from .schemes import BLANES_MOAN_6, KAHAN_LI_8, SOFRONIOU_SPALETTA_10, STEPS, Scheme

try:
    import numba
except ImportError:
    numba = None

BLOCK = 64
GAP = 16  # numbers of 8 bytes between two blocks, so that no two threads write to one line of the cache


def kernel(scheme: Scheme, dtype: np.dtype):
    """The compiled function of (steps, step, k, gamma, x, y, u, v), arrays (blocks, 64 + gap), changed in place."""
    first, kicks = dtype.type(scheme.drifts[0]), np.array(scheme.kicks, dtype)
    drifts = np.array(scheme.drifts[1:], dtype)
    drifts[-1] += first
    stages, one = len(kicks), dtype.type(1)

    @numba.njit(fastmath=True, parallel=True, error_model="numpy")
    def run(steps, h, k, gamma, X, Y, U, V):
        for block in numba.prange(X.shape[0]):
            x, y, u, v = X[block], Y[block], U[block], V[block]
            for i in range(BLOCK):
                x[i] += first * h * u[i]
                y[i] += first * h * v[i]
            for _ in range(steps):
                for stage in range(stages):
                    hk, hg, move = kicks[stage] * h * k, kicks[stage] * h * gamma, drifts[stage] * h
                    for i in range(BLOCK):
                        f = hk * (one / np.sqrt(x[i] * x[i] + y[i] * y[i])) - hk
                        u[i] += f * x[i]
                        v[i] += f * y[i] - hg
                        x[i] += move * u[i]
                        y[i] += move * v[i]
            for i in range(BLOCK):
                x[i] -= first * h * u[i]
                y[i] -= first * h * v[i]

    return run


def aligned(shape: tuple[int, ...], dtype: np.dtype) -> np.ndarray:
    """Zeros that begin on a line of the cache; elsewhere each load of a whole register would touch two lines."""
    size = int(np.prod(shape)) * dtype.itemsize
    memory = np.zeros(size + 64, np.uint8)
    begin = -memory.ctypes.data % 64
    return memory[begin : begin + size].view(dtype).reshape(shape)


class Numba:
    """One scheme, in float64 or float32, on `cores` threads.  A setting is a number of steps."""

    def __init__(self, scheme: Scheme = BLANES_MOAN_6, dtype="float64", cores: int = 1):
        if numba is None:
            raise Missing("Numba is not installed: pip install numba")
        self.scheme, self.dtype, self.cores = scheme, np.dtype(dtype), cores
        self.name = f"Numba, {scheme.name}, {self.dtype}"
        self.settings = STEPS.get(scheme, (500, 1000, 2000, 4000, 8000))
        if self.dtype == np.float32:
            self.settings = self.settings[:3]

    def compile(self, problem: Problem) -> float:
        if problem.n != 1:
            raise Missing("the Numba kernel is of n = 1 only")
        self.problem = problem
        begin = time.perf_counter()
        self.function = kernel(self.scheme, self.dtype)
        self.run(1)
        return time.perf_counter() - begin

    def run(self, setting):
        problem, steps, number = self.problem, int(setting), self.dtype.type
        flat = problem.flat()
        blocks = -(-problem.lanes // BLOCK)
        x, y, u, v = aligned((4, blocks, BLOCK + GAP * 8 // self.dtype.itemsize), self.dtype)
        x[:], v[:, :BLOCK] = 1.0, np.resize(problem.rates, (blocks, BLOCK))
        numba.set_num_threads(min(self.cores, numba.config.NUMBA_NUM_THREADS))
        begin = time.perf_counter()
        self.function(steps, number(problem.duration / steps), number(flat.k), number(flat.gamma), x, y, u, v)
        seconds = time.perf_counter() - begin
        tips = flat.length * np.stack([x[:, :BLOCK].ravel(), y[:, :BLOCK].ravel()], axis=-1)[: problem.lanes].astype(
            np.float64
        )
        return tips, seconds * problem.lanes / (blocks * BLOCK)

    def vector_registers(self) -> str:
        """The widest registers of packed arithmetic in the compiled code, in one line."""
        from .c_kernel import PACKED

        found = {
            kind
            for listing in (self.function.inspect_asm(types) for types in self.function.signatures)
            for kind, _ in PACKED.findall(listing)
        }
        if not found:
            raise RuntimeError(f"{self.name}: no packed arithmetic")
        return f"{self.name}: packed arithmetic on {', '.join(f'{kind}mm' for kind in sorted(found))}"


def peers() -> list[Peer]:
    """The schemes of orders 6, 8 and 10 on one core and two, and float32."""
    schemes = (BLANES_MOAN_6, KAHAN_LI_8, SOFRONIOU_SPALETTA_10)
    return [
        *(Numba(scheme, cores=cores) for cores in (1, 2) for scheme in schemes),
        *(Numba(BLANES_MOAN_6, "float32", cores) for cores in (1, 2)),
    ]


if __name__ == "__main__":
    table([lambda i=i: peers()[i] for i in range(8)], ns=(1,), repeats=4)
