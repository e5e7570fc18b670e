"""The rod of the paper's Figure 2, started at many rates: what all peers solve, and the answer they should give.

With z = (1, a) and the rod's projection M, K, p, tip of the library,

    T = a'^T M_aa a' / 2 + (z^T M z) psi'^2 / 2,    V = a^T K a / 2 + g sin(psi) p^T z,

and the tip is at (tip . z) (cos psi, sin psi).  Start: angle 0, strain 0, a rate for each lane.

    python -m benchmarks.peers
"""

import dataclasses
from typing import NamedTuple

import numpy as np

KNOWN = (15.0, 10.0, 146.434545534944, 0.00856831368333735)  # rate, t, psi, eps of n = 1, from a series of 45 digits


class Flat(NamedTuple):
    """n = 1 in the plane, q = (1 + eps) d:  q'' = -k (1 - 1/|q|) q - gamma e_y,  tip = length q."""

    k: float
    gamma: float
    length: float


class Modal(NamedTuple):
    """Any n, with a = W eta, W^T M_aa W = 1 and W^T K W = diag(squares), and the angular momentum l as a state:

    psi' = l / J,  l' = -g cos(psi) (p0 + P . eta),  eta_i'' = -w_i^2 eta_i + psi'^2 (b_i + eta_i) - g sin(psi) P_i,
    J = inertia + 2 b . eta + |eta|^2 = rest + |eta + b|^2,  tip at (reach + tips . eta) (cos psi, sin psi).
    """

    inertia: float
    rest: float
    squares: np.ndarray
    b: np.ndarray
    p0: float
    P: np.ndarray
    reach: float
    tips: np.ndarray


@dataclasses.dataclass(frozen=True)
class Problem:
    """The rod's arrays, gravity, the rates at the start (lanes,) in rad/s, and the time of the answer in s."""

    mass: np.ndarray
    stiffness: np.ndarray
    moments: np.ndarray
    tip: np.ndarray
    gravity: float
    rates: np.ndarray
    duration: float = 10.0

    @classmethod
    def figure_2(cls, n: int, rates, duration: float = 10.0) -> "Problem":
        """Figure 2's rod with n shapes."""
        import jaxrod

        rod = jaxrod.Rod(length=1.0, section=jaxrod.Cone(root_radius=0.02, tip_radius=0.03), young=1e7, density=1200.0)
        return cls.of(jaxrod.System(rod, jaxrod.Rotation(), jaxrod.Ritz(n), gravity=9.81), rates, duration)

    @classmethod
    def of(cls, system, rates, duration: float = 10.0) -> "Problem":
        """From a system of the library, in float64."""
        body = system.body
        arrays = (body.mass_matrix, body.stiffness_matrix, body.first_moments, body.tip)
        mass, stiffness, moments, tip = (np.asarray(x, np.float64) for x in arrays)
        rates = np.atleast_1d(np.asarray(rates, np.float64))
        return cls(mass, stiffness, moments, tip, float(system.gravity), rates, float(duration))

    @property
    def n(self) -> int:
        return len(self.stiffness)

    @property
    def lanes(self) -> int:
        return len(self.rates)

    def at(self, lanes) -> "Problem":
        """The same problem for some of its lanes."""
        return dataclasses.replace(self, rates=self.rates[lanes])

    def flat(self) -> Flat:
        """Constants of the planar form."""
        inertia, moment, length = self.mass[0, 0], self.moments[0], self.tip[0]
        same = np.allclose(self.mass, inertia) and np.allclose(self.moments, moment) and np.allclose(self.tip, length)
        if self.n != 1 or not same:
            raise ValueError("the planar form is of one uniform strain.")
        return Flat(float(self.stiffness[0, 0] / inertia), float(self.gravity * moment / inertia), float(length))

    def modal(self) -> Modal:
        """Constants of the modal form."""
        lower = np.linalg.cholesky(self.mass[1:, 1:])
        squares, vectors = np.linalg.eigh(np.linalg.solve(lower, np.linalg.solve(lower, self.stiffness).T))
        w = np.linalg.solve(lower.T, vectors)
        b, inertia = w.T @ self.mass[1:, 0], float(self.mass[0, 0])
        P, tips = w.T @ self.moments[1:], w.T @ self.tip[1:]
        return Modal(inertia, inertia - float(b @ b), squares, b, float(self.moments[0]), P, float(self.tip[0]), tips)


def polar(problem: Problem, psi, eta) -> np.ndarray:
    """Tips (lanes, 2) from the modal form's angle (lanes,) and eta (lanes, n)."""
    modal = problem.modal()
    return np.float64((modal.reach + eta @ modal.tips)[:, None] * np.stack([np.cos(psi), np.sin(psi)], axis=-1))


def reference(problem: Problem) -> np.ndarray:
    """Tips to about 1e-15: heyoka's Taylor series in extended precision; without heyoka, DOP853 at 1e-13."""
    from .common import Missing
    from .heyoka_ import extended

    try:
        return extended(problem)
    except Missing:
        from .scipy_ import dop853

        return dop853(problem)
