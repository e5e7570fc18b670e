"""The exact rod: longitudinal waves rho A u_tt = (E A u_x)_x of any rod, held anywhere or free.

Its frequencies, its steady spin and, by `simulate`, its whole motion.  Shares no code with the strain bases; of this
library it reads the rod, how it is held and what is prescribed.
"""

from .closed_forms import free_free as free_free
from .closed_forms import held_free as held_free
from .closed_forms import release as release
from .compliance import Axial as Axial
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
