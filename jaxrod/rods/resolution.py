"""Where panels along the rod must end for Gauss-Legendre points on them to integrate what a function of s is.

A panel is halved until its integrals, against polynomials of low degree too, stand still.  A jump or a kink would need
forty halvings: it is looked for by itself and ends a panel.  Works on known numbers, in NumPy.
"""

import dataclasses
from collections.abc import Callable

import numpy as np

from .quadrature import gauss

ORDER = 16  # Gauss-Legendre points per panel; exact for polynomial integrands of degree 31
FIXED = 8  # panels where the function is not known yet
_SAMPLES = 256  # panels of the first look along each piece: 4096 points
_MOST = 100  # panels of a rod; the exact rod has matrices of 16 times as many rows
_FEW = 8  # panels that may have more nodes than they need
_STANDS = 1e-12  # of the integral over the rod: what a panel may be off
_JUMP = 1e-6  # relative size from which an edge is a jump
_MOMENTS = 8  # degrees of the polynomials that a function is integrated against
_ZOOM = np.linspace(0.0, 1.0, 33)


@dataclasses.dataclass(frozen=True)
class Resolution:
    """How a rod is resolved: `knots` (m) where panels end, `jumps` (m) found, nodes for each panel, relative `error`.

    `fixed`: the function was traced, and nothing could be refined.  `place` (m) is where the error is largest.
    """

    knots: tuple[float, ...] = ()
    jumps: tuple[float, ...] = ()
    order: int = ORDER
    error: float = 0.0
    place: float = 0.0
    fixed: bool = False


def resolve(look: Callable[[np.ndarray], np.ndarray], ends: np.ndarray, eps: float) -> Resolution:
    """Refine the panels between `ends` (m) for the positive functions look(s): (points,) to (k, points).

    `eps` is the rounding of their values.  What is narrower than 1/4096 of a piece may pass unseen.
    """
    tolerance = max(_STANDS, 64 * eps)
    start, end = ends[:-1], ends[1:]
    done, found, jumps, scale, level = [], [], [], None, 0
    while True:
        error, whole = _error(look, start, end, ORDER, max(2, _SAMPLES >> level), _MOMENTS)
        scale = np.sum(whole, axis=1, keepdims=True) if scale is None else scale
        error = np.max(error / scale, axis=0)
        coarse = (error > tolerance) & (end - start > 64 * eps * ends[-1])
        done += zip(start[~coarse], end[~coarse], error[~coarse], strict=True)
        start, end, error = start[coarse], end[coarse], error[coarse]
        if len(done) + 2 * start.size > max(_MOST, 2 * ends.size):
            done += zip(start, end, error, strict=True)
            break
        if not start.size:
            break
        middle, jumped = _edges(look, start, end, eps)
        found += list(middle)
        jumps += list(middle[jumped])
        start, end = np.sort(np.concatenate([start, middle])), np.sort(np.concatenate([middle, end]))
        level += 1
    panels = np.array(sorted(done))
    worst = panels[np.argmax(panels[:, 2])]
    knots = sorted(set(map(float, found)) - set(map(float, jumps)))
    order = _order(look, panels[:, 0], panels[:, 1], scale, tolerance) if len(panels) > _FEW else ORDER
    error = float(np.sum(panels[panels[:, 2] > tolerance, 2]))
    return Resolution(tuple(knots), tuple(sorted(map(float, jumps))), order, error, float(np.mean(worst[:2])))


def moments(degrees: int, order: int, parts: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """Points on [-1, 1] of `parts` panels, and weights (points, degrees) of integrals against P_0 .. P_degrees-1."""
    x, w = gauss(order)
    x = ((2 * np.arange(parts)[:, None] + 1 + x) / parts - 1).reshape(-1)
    return x, np.tile(w / parts, parts)[:, None] * np.polynomial.legendre.legvander(x, degrees - 1)


def _error(look, start, end, order: int, parts: int, degrees: int) -> tuple[np.ndarray, np.ndarray]:
    """By function and panel: how far its moments are from those on `parts` panels instead of one, and its integral."""
    half, middle = (end - start) / 2, (start + end) / 2
    sums = []
    for x, weights in (moments(degrees, order), moments(degrees, ORDER, parts)):
        values = look((middle[:, None] + half[:, None] * x).reshape(-1))
        sums.append(half[:, None] * (values.reshape(len(values), start.size, x.size) @ weights))
    return np.max(np.abs(sums[0] - sums[1]), axis=-1), sums[1][..., 0]


def _order(look, start, end, scale, tolerance: float) -> int:
    """The fewest nodes for each panel that do."""
    for order in (8, 12):
        error, _ = _error(look, start, end, order, 2, order // 2)
        if np.all(error <= tolerance * scale):
            return order
    return ORDER


def _edges(look, start, end, eps: float) -> tuple[np.ndarray, np.ndarray]:
    """Where to divide each panel, and whether the functions jump there: at the sharpest edge, if one has any, else in the middle.

    The second difference of a step h is h^2 f'' where f is smooth, h at a kink, and does not shrink at a jump.
    """
    skin = 1e-9 * (end - start)  # the ends themselves are no part of the panel: a pointed tip has no area there
    low, high, sizes = start + skin, end - skin, []
    for _ in range(14):
        s = low[:, None] + (high - low)[:, None] * _ZOOM
        values = look(s.reshape(-1))
        values = values.reshape(len(values), *s.shape)
        values = values / np.max(np.abs(values), axis=-1, keepdims=True)
        bend = np.max(np.abs(values[..., 2:] - 2 * values[..., 1:-1] + values[..., :-2]), axis=0)
        size, sharpest = np.max(bend, axis=1), np.argmax(bend, axis=1)[:, None]
        sizes.append(size)
        clear = size > 256 * eps
        low = np.where(clear, np.take_along_axis(s, sharpest, 1)[:, 0], low)
        high = np.where(clear, np.take_along_axis(s, sharpest + 2, 1)[:, 0], high)
    sizes = np.array(sizes)
    last = np.sum(np.logical_and.accumulate(sizes > 4096 * eps), axis=0)  # steps that tell more than rounding
    panel = np.arange(start.size)
    shrunk = sizes[np.maximum(last - 3, 0), panel] / np.maximum(
        sizes[np.maximum(last - 1, 0), panel], eps
    )  # in two steps
    edge, middle = (low + high) / 2, (start + end) / 2
    inside = np.minimum(edge - start, end - edge) > 1e-6 * (end - start)
    sharp = (last > 3) & (shrunk < 64.0**2) & inside
    return np.where(sharp, edge, middle), sharp & (sizes[-1] > max(_JUMP, eps**0.5))
