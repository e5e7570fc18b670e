"""jaxrod: thin rods that stretch while they swing, spin and fly.

CONTRIBUTING.md says which package answers which question; `help(jaxrod.NAME)`, what a name does.

Importing it imports nothing else: JAX and the rest are loaded when a name is first used (`__init__.pyi` lists the
names), so that `configure()` can set what must be set before.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
__version__ = "0.2.0"
