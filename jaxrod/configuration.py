"""The one explicit line: `jaxrod.configure()`."""

import os
import pathlib
import sys

_done: list[str] = []


def configure(*, x64: bool = True, cache: str | os.PathLike[str] | None = "default", devices: int = 1) -> str:
    """Sets JAX up for this library and says what it did.  Call it once, before anything else touches JAX.

    **Arguments:**

    - `x64`: compute in float64 by default.
    - `cache`: folder for compiled programs, so that a second process starts at once; "default" is
      `$JAXROD_CACHE`, else `~/.cache/jaxrod`; None keeps none.
    - `devices`: how many CPU devices JAX shows.

    **Raises:** `RuntimeError` if JAX has already computed something: some settings would come too late.

    Importing `jaxrod` sets nothing.  A second call changes nothing and returns what the first one did.
    """
    if _done:
        return _done[0]
    # Diffrax's runtime checks are host callbacks, and a program with callbacks cannot be kept in the compile cache.
    # `simulate` checks its inputs itself and reports trouble by result codes.
    late = "equinox" in sys.modules
    os.environ.setdefault("EQX_ON_ERROR", "nan")
    import jax

    try:
        jax.config.update("jax_num_cpu_devices", devices)
    except RuntimeError:
        raise RuntimeError(
            "jaxrod.configure() came after JAX's first computation; call it right after the imports."
        ) from None
    jax.config.update("jax_enable_x64", x64)
    said = [f"float{64 if x64 else 32}", f"{devices} CPU device{'s' if devices > 1 else ''}"]
    if cache is not None:
        home = os.environ.get("JAXROD_CACHE", pathlib.Path.home() / ".cache" / "jaxrod")
        folder = pathlib.Path(home if cache == "default" else cache)
        jax.config.update("jax_compilation_cache_dir", str(folder))
        jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.2)
        said.append(f"compiled programs kept in {folder}")
    if late:
        said.append("equinox was imported before: its runtime checks stay on, which keeps programs out of the cache")
    _done.append("jaxrod: " + ", ".join(said))
    return _done[0]
