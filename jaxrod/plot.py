"""Pictures.  Each function draws on a new figure and returns it; saving is the caller's."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator

from .accuracy.run_plan import named
from .accuracy.work_precision import RUNGS, Tradeoff
from .core import validation
from .motions.state import State
from .runs.solution import Solution
from .shapes.load_basis import LoadRitz

_BLUE, _ORANGE, _GREY = "#1f5fa8", "#d9661f", "#9a9a9a"


def bands(solutions: Mapping[str, Solution], slow: Mapping[str, Any], until: float) -> Figure:
    """The paper's Figure 2: angular velocity and strain against time, a column for each solution.

    `slow` holds the slow bands of rate and strain (T,), drawn over the signals; `until` is the end of the axis in s.
    """
    _check_mapping("solutions", solutions, "solutions of a System by their titles")
    _check_mapping("slow", slow, "the slow bands of rate and strain by the same titles")
    if not all(isinstance(x, Solution) and isinstance(x.states, State) for x in solutions.values()):
        raise ValueError(f"solutions={validation.given(solutions)} holds something else; give solutions of a System.")
    if set(slow) != set(solutions):
        raise ValueError(f"slow has titles {list(slow)} and solutions has {list(solutions)}; give the same.")
    until = float(validation.positive("until", until, "s", "seconds"))
    figure, axes = _columns(len(solutions), 2, height=5.0, bottom=0.5, top=0.65, sharex=True, sharey="row")
    for column, (name, solution) in zip(axes.T, solutions.items(), strict=True):
        shown = np.asarray(solution.ts) <= until
        t = np.asarray(solution.ts)[shown]
        rows = (
            (column[0], solution.rate, slow[name][0], 1.0, "angular velocity ω, rad/s", _BLUE),
            (column[1], solution.strain, slow[name][1], 100.0, "strain ε, %", _ORANGE),
        )
        for axis, signal, band, unit, label, color in rows:
            axis.plot(t, unit * np.asarray(signal)[shown], color=color, linewidth=0.9, label="motion")
            inner = t > 0.05 * until  # before that the filter rings from the start of the signal
            axis.plot(
                t[inner],
                unit * np.asarray(band)[shown][inner],
                color="black",
                linewidth=1.1,
                label="its slow band (gravity)",
            )
            axis.grid(alpha=0.25)
            if column[0] is axes[0, 0]:
                axis.set_ylabel(label)
        column[0].set_title(name, fontsize=10)
        column[1].set_xlabel("time, s")
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="upper center", ncols=2, fontsize=9)
    return figure


def release(tau: np.ndarray, tips: Mapping[str, tuple[np.ndarray, np.ndarray]]) -> Figure:
    """Tip displacement after letting go from uniform stretch: exact and uniform-strain model, a column for each rod.

    `tau` is time over the travel time of a wave along the rod; displacements are over the initial one.
    """
    _check_mapping("tips", tips, "pairs (exact, model) of displacements by their titles")
    tau = np.asarray(validation.numbers("tau", tau, "times over the travel time"))
    for name, pair in tips.items():
        if not (isinstance(pair, tuple | list) and len(pair) == 2 and all(np.shape(x) == tau.shape for x in pair)):
            raise ValueError(
                f"tips[{name!r}] does not fit; give a pair (exact, model), each of shape {tau.shape} like tau."
            )
    figure, axes = _columns(len(tips), 1, height=3.0, bottom=0.5, top=0.3, sharey=True)
    for axis, (name, (exact, model)) in zip(axes[0], tips.items(), strict=True):
        axis.plot(tau, exact, color=_BLUE, linewidth=1.4, label="exact rod")
        axis.plot(tau, model, color=_ORANGE, linewidth=1.2, linestyle="--", label="uniform strain (the paper)")
        axis.axhline(0, color=_GREY, linewidth=0.5)
        axis.set_title(name, fontsize=10)
        axis.set_xlabel("time / travel time of a wave")
        axis.grid(alpha=0.25)
    axes[0, 0].set_ylabel("tip displacement / initial")
    axes[0, 0].legend(loc="lower right", fontsize=8)
    return figure


def _check_mapping(name: str, value: Any, wanted: str) -> None:
    if not isinstance(value, Mapping) or not value:
        raise ValueError(f"{name}={validation.given(value)} is not a mapping; give a dict of {wanted}.")


def _columns(columns: int, rows: int, height: float, bottom: float, top: float, **shared: Any) -> tuple[Figure, Any]:
    """A figure and its axes, with margins in inches: a layout that is searched for draws everything twice."""
    width = 5.2 * columns
    figure = Figure(figsize=(width, height))
    figure.subplots_adjust(0.75 / width, bottom / height, 1 - 0.1 / width, 1 - top / height, wspace=0.05, hspace=0.06)
    return figure, figure.subplots(rows, columns, squeeze=False, **shared)


def tradeoff(found: Tradeoff, title: str = "") -> Figure:
    """Error against cost of every way that was measured, a colour for each rung; pale what another beats in both."""
    if not isinstance(found, Tradeoff):
        raise ValueError(f"found={validation.given(found)} is not a trade-off; give what jaxrod.tradeoff returned.")
    if not isinstance(title, str):
        raise ValueError(f"title={validation.given(title)} is not text; give a string.")
    figure = Figure(figsize=(7.6, 4.6), layout="constrained")
    axis = figure.subplots()
    # Of one colour in every picture; paler the one that is tried beside it where a force acts at the tip.
    colors = {named(basis): 2 * k for k, basis in enumerate(RUNGS)}
    colors |= {f"ForceRitz({basis.n})": 2 * k + 1 for k, basis in enumerate(RUNGS) if isinstance(basis, LoadRitz)}
    front, seen = set(found.front), {row.rung for row in found.rows}
    colors |= {rung: 2 * len(RUNGS) + k for k, rung in enumerate(sorted(seen - colors.keys()))}  # the scene's own
    for rung, color in ((rung, colormaps["tab20"](k)) for rung, k in colors.items() if rung in seen):
        for pale in (True, False):
            rows = [row for row in found.rows if row.rung == rung and (row not in front) == pale and row.error > 0]
            axis.scatter(
                [row.cost for row in rows], [row.error for row in rows], color=color, s=14 if pale else 46,
                alpha=0.25 if pale else 1.0, label=None if pale else rung, zorder=2 if pale else 3,
            )  # fmt: skip
    steps = [row for row in found.front if row.error > 0]
    axis.plot([row.cost for row in steps], [row.error for row in steps], color=_GREY, linewidth=0.8, zorder=1)
    if found.own_error > 0:
        axis.axhline(found.own_error, color=_GREY, linestyle=":", linewidth=1.0)
        left, known = axis.get_yaxis_transform(), f"{found.reference} is known to this"
        axis.text(0.99, found.own_error, known, transform=left, ha="right", va="bottom", fontsize=7, color=_GREY)
    axis.set(xscale="log", yscale="log", xlabel="computing time, s for each simulated second", title=title)
    axis.set_ylabel(f"error of the {found.quantity}, {found.unit}".rstrip(", "))
    axis.xaxis.set_minor_locator(LogLocator(subs=(2, 5)))  # labels of more lie one on the other
    axis.grid(alpha=0.25)
    axis.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize=8, title="rung")
    return figure
