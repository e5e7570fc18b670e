"""How many shapes does a rod need?  Errors of the first three natural frequencies in both bases, n = 1 .. 12.

    python benchmarks/convergence.py [--out docs]

The reference is `jaxrod.continuum`, itself first compared with closed forms, solved here by bracketing.  Then the
steady stretch of a spinning rod.  Writes accuracy.md and convergence.png to the folder.
"""

import argparse
import concurrent.futures
import dataclasses
import datetime
import importlib.metadata
import pathlib
import platform
from typing import NamedTuple

import jaxrod

jaxrod.configure()

import jax  # noqa: E402
import numpy as np  # noqa: E402
import scipy.optimize  # noqa: E402
from matplotlib.figure import Figure  # noqa: E402

BASES = (jaxrod.Ritz, jaxrod.ForceRitz)
N = 12
KEPT = 3  # frequencies
SHOWN = (1, 2, 4, 8)
WANTED, BY = 1e-6, 8
FLOOR = 1e-13  # below it rounding is what is left
MEASURED = pathlib.Path(__file__).parent.parent / "notebooks" / "measured_radii.csv"
LENGTH, YOUNG, DENSITY = 1.0, 1e7, 1200.0


class Case(NamedTuple):
    """A scene whose basis is still to choose, and omega length / sqrt(E / rho) in closed form where there is one."""

    name: str
    system: jaxrod.System
    kappa: np.ndarray | None


def zeros(equation, starts, ends):
    return np.array([scipy.optimize.brentq(equation, a, b, xtol=1e-16, rtol=1e-15) for a, b in zip(starts, ends)])


def cone_kappa(held, free):
    """kappa cot kappa = 1 - held / free: one root in each interval of pi."""
    c = 1 - held / free
    k = np.arange(KEPT) * np.pi
    return zeros(lambda x: x * np.cos(x) - c * np.sin(x), np.maximum(k, 1e-6), k + np.pi)


def cases():
    def case(name, section, kappa, motion=None, **numbers):
        rod = jaxrod.Rod(**({"length": LENGTH, "young": YOUNG, "density": DENSITY} | numbers), section=section)
        return Case(name, jaxrod.System(rod, motion or jaxrod.Rotation()), kappa)

    odd = (np.arange(KEPT) + 0.5) * np.pi
    yield case("uniform", jaxrod.Cone(0.025, 0.025), odd)  # a cone too, so as not to compile once more
    for tip, root in ((1, 1000), (1, 100), (1, 10), (2, 3), (3, 2), (10, 1), (100, 1), (1000, 1)):
        r, R = (0.03 * x / max(tip, root) for x in (root, tip))
        yield case(f"cone, tip : root {tip} : {root}", jaxrod.Cone(r, R), cone_kappa(r, R))
    for name, root, tip in (("root", 4e-3, 1e-3), ("tip", 1e-3, 4e-3)):
        # tan^2(kappa / 2) = A_root / A_tip
        x = np.arctan(np.sqrt(root / tip))
        yield case(f"step 4 : 1, thick {name}", jaxrod.Steps([0.5], [root, tip]), 2 * np.array([x, np.pi - x, np.pi + x]))
    parts = [cone_kappa(0.023, 0.02) / 0.3, cone_kappa(0.023, 0.03) / 0.7]
    kappa = np.sort(np.concatenate(parts))[:KEPT]
    yield case("the paper's cone, pivot at 0.3", jaxrod.Cone(0.02, 0.03), kappa, jaxrod.Rotation(0.3))
    kappa = np.sort(np.concatenate([odd / 0.5, odd / 0.5]))[:KEPT]
    yield case("uniform, pivot in the middle", jaxrod.Cone(0.025, 0.025), kappa, jaxrod.Rotation(0.5))
    mass = float(jaxrod.Rod(LENGTH, jaxrod.Uniform(0.025), YOUNG, DENSITY).mass)
    k = np.arange(KEPT) * np.pi
    kappa = zeros(lambda x: x * np.sin(x) - np.cos(x), k, k + np.pi / 2)  # kappa tan kappa = 1
    yield case("uniform, its own mass at the tip", jaxrod.Uniform(0.025), kappa, tip_mass=mass)
    station, radius = 1e-3 * np.loadtxt(MEASURED, delimiter=",", skiprows=1).T
    yield case("measured radii", jaxrod.Table(station, radius), None, length=station[-1])


def measure(scenes: list[Case], exact: np.ndarray) -> np.ndarray:
    """Relative errors (case, basis, n - 1, frequency); NaN where n is too small."""
    errors = np.full((len(scenes), len(BASES), N, KEPT), np.nan)

    def fill(job):
        b, n = job
        # One function each.  Compiled in haste: each runs for milliseconds.
        run = jax.jit(jaxrod.natural_frequencies.__wrapped__ if False else (lambda system: jaxrod.natural_frequencies(system)), compiler_options={"xla_backend_optimization_level": 0})
        for c, scene in enumerate(scenes):
            found = run(dataclasses.replace(scene.system, basis=BASES[b](n)))[:KEPT]
            errors[c, b, n - 1, : found.size] = np.abs(np.asarray(found) / exact[c, : found.size] - 1)

    with concurrent.futures.ThreadPoolExecutor(2) as pool:
        list(pool.map(fill, [(b, n) for n in range(N, 0, -1) for b in range(len(BASES))]))
    return errors
