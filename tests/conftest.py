import os
import pathlib

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("XLA_FLAGS", "--xla_backend_optimization_level=0")  # tests compile for longer than they run

import jaxrod

jaxrod.configure()  # before anything else touches JAX

import jax  # noqa: E402
import pytest  # noqa: E402

FIGURE_2 = {"length": 1.0, "young": 1e7, "density": 1200.0}


@pytest.fixture(scope="session", autouse=True)
def _rank_promotion():
    """A broadcast that nobody meant is an error."""
    jax.config.update("jax_numpy_rank_promotion", "raise")


@pytest.fixture(autouse=True)
def _few_memory_maps():
    """Compiled programs are memory maps, of which Linux lets a process have 65,530: one more ends it."""
    yield
    maps = pathlib.Path("/proc/self/maps")
    if maps.exists() and maps.read_bytes().count(b"\n") > 30_000:
        jax.clear_caches()


@pytest.fixture(scope="session")
def cone() -> "jaxrod.Rod":
    """The paper's rod, thin end held."""
    return jaxrod.Rod(section=jaxrod.Cone(root_radius=0.02, tip_radius=0.03), **FIGURE_2)


@pytest.fixture(scope="session")
def uniform() -> "jaxrod.Rod":
    return jaxrod.Rod(section=jaxrod.Uniform(radius=0.025), **FIGURE_2)


def pytest_collection_modifyitems(items):
    """The longest first: what is begun last keeps one worker busy while the other has nothing left."""
    items.sort(key=lambda item: "notebooks" not in item.nodeid)
