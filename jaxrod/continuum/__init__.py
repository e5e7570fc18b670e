"""The exact rod: longitudinal waves of any rod, held anywhere or free.

    rho A u_tt = (E A u_x)_x

- `mesh` puts nodes along the rod; `compliance` says how it is held and what it gives way to forces there.
- `frequencies` and `modes` are the singular values and vectors of that compliance; `closed_forms`, those of cones.
- `dynamics` are the equations of motion in the modes, `simulation` runs them, `solution` is what it returns.
- `neglected`: what the model of a straight rod leaves out, bending and lateral inertia, in numbers.

Computes nothing by strain bases and `mechanics`.  It reads the rod and how it is held; its `simulate` also what is prescribed,
gravity and the force at the tip.  `simulate` refuses other forces; frequencies leave out all forces, and warn.  What
`jaxrod.simulate` computes by any basis is held against it.
"""

from .closed_forms import free_free as free_free
from .closed_forms import held_free as held_free
from .closed_forms import release as release
from .compliance import AxialCompliance as AxialCompliance
from .compliance import axial as axial
from .compliance import support as support
from .frequencies import critical_rate as critical_rate
from .frequencies import natural_frequencies as natural_frequencies
from .frequencies import spinning_frequencies as spinning_frequencies
from .frequencies import steady_spin as steady_spin
from .simulation import converged as converged
from .simulation import simulate as simulate
from .simulation import untaken as untaken
from .solution import ContinuumSolution as ContinuumSolution
