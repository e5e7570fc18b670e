"""The paper this library starts from.

- `reproduction`: its scene and figure, as printed and corrected, and its slips.
- `claims`: what it says, measured; `jaxrod paper` writes them.

Its two scenes are made of what users have: as printed a `Lumped` body, corrected a `Rod`.  They compose as any other scene; the
exact rod takes the corrected one.
"""

from . import claims as claims
from .reproduction import DENSITY as DENSITY
from .reproduction import DURATION as DURATION
from .reproduction import GRAVITY as GRAVITY
from .reproduction import LENGTH as LENGTH
from .reproduction import SAMPLES as SAMPLES
from .reproduction import SPIN as SPIN
from .reproduction import THICK as THICK
from .reproduction import THIN as THIN
from .reproduction import YOUNG as YOUNG
from .reproduction import Slip as Slip
from .reproduction import both as both
from .reproduction import corrected as corrected
from .reproduction import figure_2 as figure_2
from .reproduction import literal as literal
from .reproduction import omissions as omissions
from .reproduction import rod as rod
from .reproduction import slips as slips
