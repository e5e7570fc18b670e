"""The one explicit line: `jaxrod.configure()`."""

import importlib.metadata
import os
import pathlib
import sys
import warnings
from typing import Any

_done: list[tuple[str, dict]] = []  # what the first call did, and what it was asked
_said: list[bool] = []
_reminded: list[bool] = []

# XLA launches each kernel of a loop by itself unless the loop touches fewer bytes than this: then it becomes one function.
_WHOLE_LOOPS = f"xla_cpu_small_while_loop_byte_threshold={1 << 21}"
# And it computes what two results share once for each, unless kernels may have several results.
_SHARED_KERNELS = "xla_cpu_use_multi_output_fusion=true"


def configure(
    *,
    x64: bool = True,
    cache: str | os.PathLike[str] | None = "default",
    devices: int | None = None,
    progress: bool | None = None,
) -> str:
    """Sets JAX up for this library and says what it did.  Call it once, before anything else touches JAX.

    **Arguments:**

    - `x64`: compute in float64 by default.
    - `cache`: folder for compiled programs, so that a second process starts at once; "default" is
      `$JAXROD_CACHE`, else `~/.cache/jaxrod`; None keeps none.
    - `devices`: how many CPU devices JAX shows, which `sweep` works on; one for each core, if left out.
    - `progress`: whether what takes longer than two seconds shows a line of what it does; if left out, `$JAXROD_PROGRESS` (1 or
      0), else on a terminal and in a notebook alone.

    **Returns:** a sentence that says what is set.

    It also has XLA compile the time loop of a block of scenes into one function, of kernels with several results and
    with the widest vectors of the machine: without it sweeps take about three times as long.  It adds to what `$XLA_FLAGS`
    holds, but leaves an `xla_backend_extra_options` of your own alone.  LAPACK gets one thread, unless
    `$OPENBLAS_NUM_THREADS` says otherwise.

    **Raises:** `RuntimeError` if JAX has already computed something, as some settings would come too late, or is kept from
    the CPU by `$JAX_PLATFORMS`; `ValueError` for arguments that make no sense.

    Importing `jaxrod` sets nothing.  A second call changes nothing and returns what the first one did; it warns if it asks
    for something else.

    >>> import jaxrod
    >>> print(jaxrod.configure())  # doctest: +SKIP
    jaxrod: float64, 2 CPU devices, compiled programs kept in /home/me/.cache/jaxrod, loops compiled whole
    """
    if not isinstance(x64, bool):
        raise ValueError(f"x64={x64!r} must be True or False.")
    if not (cache is None or isinstance(cache, str | os.PathLike)):
        raise ValueError(f"cache={cache!r} must be a folder, or None for none.")
    if devices is not None and (isinstance(devices, bool) or not isinstance(devices, int) or devices < 1):
        raise ValueError(f"devices={devices!r} must be a positive whole number, or None for one a core.")
    if not (progress is None or isinstance(progress, bool)):
        raise ValueError(f"progress={progress!r} must be True, False, or None for a terminal or a notebook alone.")
    asked = {"x64": x64, "cache": cache, "devices": devices, "progress": progress}
    if _done:
        if asked not in (_done[0][1], {"x64": True, "cache": "default", "devices": None, "progress": None}):
            warnings.warn(f"configure() was called before, and stays: {_done[0][0]}.", stacklevel=2)
        return _done[0][0]
    if "cpu" not in os.environ.get("JAX_PLATFORMS", "cpu").lower():
        raise RuntimeError(
            f"JAX_PLATFORMS={os.environ['JAX_PLATFORMS']} leaves out the CPU, on which jaxrod computes; unset it, or add cpu."
        )
    # Diffrax's runtime checks are host callbacks, and a program with callbacks cannot be kept in the compile cache.
    # `simulate` checks its inputs itself and reports trouble by result codes.
    late, before = "equinox" in sys.modules, dict(os.environ)
    os.environ.setdefault("EQX_ON_ERROR", "nan")
    # Threads of LAPACK's own would fight for the cores that the devices work on.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    os.environ["XLA_FLAGS"] = _flags(os.environ.get("XLA_FLAGS", ""))
    import jax

    devices = _cores() if devices is None else devices
    try:
        jax.config.update("jax_num_cpu_devices", devices)
    except RuntimeError:
        for name in set(os.environ) - set(before):
            del os.environ[name]
        os.environ.update(before)
        raise RuntimeError(
            "jaxrod.configure() came after JAX's first computation; call it before anything else touches JAX."
        ) from None
    if _SHARED_KERNELS in os.environ["XLA_FLAGS"] and _jaxlib() == (0, 10):
        _find_extremes_without_pairs()
    jax.config.update("jax_enable_x64", x64)
    said = [f"float{64 if x64 else 32}", f"{devices} CPU device{'s' if devices > 1 else ''}"]
    if cache is not None:
        home = os.environ.get("JAXROD_CACHE") or pathlib.Path.home() / ".cache" / "jaxrod"
        folder = pathlib.Path(home if cache == "default" else cache).expanduser()
        if _writable(folder):
            jax.config.update("jax_compilation_cache_dir", str(folder))
            jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)  # many small ones add up
            said.append(f"compiled programs kept in {folder}")
        else:
            said.append(f"compiled programs NOT kept, as {folder} cannot be written: name another in $JAXROD_CACHE")
    said.append("loops compiled whole" if loops_are_whole() else "loops NOT compiled whole: sweeps take longer")
    if late:
        said.append("equinox was imported before: its runtime checks stay on, which keeps programs out of the cache")
    _done.append(("jaxrod: " + ", ".join(said), asked))
    return _done[0][0]


def progress() -> bool | None:
    """What `configure` was told of progress, else what `$JAXROD_PROGRESS` says; None if neither does."""
    told = _done[0][1]["progress"] if _done else None
    said = os.environ.get("JAXROD_PROGRESS", "")
    return said.lower() not in ("0", "false", "no", "off") if told is None and said else told


def was_called() -> bool:
    """Whether `configure` has set JAX up."""
    return bool(_done)


def remind_once() -> None:
    """Says, the first time, what is missing where `configure` was not called."""
    import jax

    if _done or _reminded:
        return
    _reminded.append(True)
    set_up: Any = jax.config
    missing = [] if set_up.jax_enable_x64 else ["numbers are float32"]
    missing += [] if set_up.jax_compilation_cache_dir else ["compiled programs are not kept for the next process"]
    if missing:
        warnings.warn(
            f"jaxrod.configure() was not called: {', '.join(missing)}; call it before anything else touches JAX.",
            stacklevel=3,
        )


def remedy_of_float32() -> str:
    """What to do where JAX's default type is float32 and float64 is needed."""
    if not _done:
        return "call jaxrod.configure() before anything else touches JAX, and build the scene after it"
    return "leave x64=False out of jaxrod.configure()" if not _done[0][1]["x64"] else "leave JAX's x64 mode on"


def loops_are_whole() -> bool:
    """Whether XLA makes one function of a loop over many lanes, and one kernel of two results, seen on a small one."""
    import jax
    import jax.numpy as jnp

    def loop(x):
        return jax.lax.fori_loop(0, 3, lambda _, xy: (jnp.sqrt(1 + xy[0] * xy[1]), xy[0] / (1 + xy[1] ** 2)), (x, x))

    text = jax.jit(loop).lower(jnp.zeros(1 << 10)).compile().as_text() or ""
    return "small_call" in text and (") fusion(" in text or _SHARED_KERNELS not in os.environ.get("XLA_FLAGS", ""))


def complain_once() -> None:
    """Says, the first time, what it costs that `configure` was not called or came too late."""
    if _said:
        return
    _said.append(True)
    if (_done and "loops compiled whole" in _done[0][0]) or loops_are_whole():
        return
    remedy = "leave xla_backend_extra_options out of $XLA_FLAGS, and jit on"
    if not _done:
        remedy = "call jaxrod.configure() before anything else touches JAX"
    warnings.warn(
        "XLA does not compile the time loop into one function here, and the sweep takes about three times as long; "
        f"{remedy}.",
        stacklevel=3,
    )


def _find_extremes_without_pairs() -> None:
    """Has `argmax` and `argmin` look for the value, then for its place.

    As a reduction of pairs, which is how JAX has them, two of like shape in one program end the process: the kernels of
    jaxlib 0.10 do not expect pairs among several results.
    """
    import jax
    from jax.interpreters import mlir

    def lowered(largest):
        def place(x, *, axes, index_dtype, **_):
            best = largest(x, axis=axes, keepdims=True)
            found = (x == best) | (x != x)  # NaN wins
            places = jax.lax.broadcasted_iota(index_dtype, x.shape, axes[0])
            return jax.numpy.where(found, places, jax.numpy.iinfo(index_dtype).max).min(axes)

        return mlir.lower_fun(place, multiple_results=False)

    mlir.register_lowering(jax.lax.argmax_p, lowered(jax.numpy.max), platform="cpu")
    mlir.register_lowering(jax.lax.argmin_p, lowered(jax.numpy.min), platform="cpu")


def _jaxlib() -> tuple[int, ...]:
    return tuple(map(int, importlib.metadata.version("jaxlib").split(".")[:2]))


def _flags(given: str) -> str:
    flags, version = given.split(), _jaxlib()
    shared = version in ((0, 10), (0, 12))  # where it has been tried
    if "xla_backend_extra_options" not in given:
        flags.append(f"--xla_backend_extra_options={_WHOLE_LOOPS}{',' + _SHARED_KERNELS if shared else ''}")
        if version == (0, 10) and "xla_cpu_use_fusion_emitters" not in given:
            # The newer emitters of this version abort on results of different shapes; later ones do not know this flag.
            flags.append("--xla_cpu_use_fusion_emitters=false")
    if "xla_cpu_prefer_vector_width" not in given:
        flags.append("--xla_cpu_prefer_vector_width=512")
    return " ".join(flags)


def _writable(folder: pathlib.Path) -> bool:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        return False
    return os.access(folder, os.W_OK)


def _cores() -> int:
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
