"""Other solvers of the same equations, for the work-precision comparison.

Each module holds one peer.  A peer is told a `Problem` once by `compile` and then runs at any of its `settings`, from
coarse to fine; `run` returns the tips at the end, (lanes, 2) in m, and the seconds that one run took, without what is
done once for a setting.  Lanes that a slow peer leaves out are NaN, and its seconds are scaled up to all lanes.

A peer whose package or compiler is not here, or that has no form for this problem, raises `Missing` on construction or
from `compile`.

    python -m benchmarks.peers.heyoka_
"""

from .common import Missing, Peer, table
from .problem import Problem, reference

__all__ = ["Missing", "Peer", "Problem", "reference", "table"]
