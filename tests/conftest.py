import dataclasses
import os
import pathlib

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("XLA_FLAGS", "--xla_backend_optimization_level=0")  # tests compile for longer than they run

import jaxrod

jaxrod.configure()  # before anything else touches JAX

import jax  # noqa: E402
import pytest  # noqa: E402


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


def make_rod(**numbers) -> "jaxrod.Rod":
    """The paper's rod, a cone whose thin end is held, but for the numbers given."""
    paper = {"length": 1.0, "section": jaxrod.Cone(root_radius=0.02, tip_radius=0.03), "young": 1e7, "density": 1200.0}
    return jaxrod.Rod(**(paper | numbers))


def scene(motion=None, basis=None, gravity=None, forces=(), rod=None, **numbers) -> "jaxrod.System":
    """The paper's rod, or `rod`, but for the numbers given: in the plane, without gravity and forces unless told otherwise.

    Under a transformation a rod that is made there is traced throughout, one that is given in its `numbers` alone.
    """
    if rod is None:
        rod = make_rod(**numbers)
    elif numbers:
        rod = dataclasses.replace(rod, **numbers)
    return jaxrod.System(rod, jaxrod.Rotation() if motion is None else motion, basis, gravity, forces)


@pytest.fixture(name="scene", scope="session")
def _scene():
    """For tests; tables and functions of a file, which get no fixtures, import `scene` from here."""
    return scene


@pytest.fixture(scope="session")
def cone() -> "jaxrod.Rod":
    return make_rod()


@pytest.fixture(scope="session")
def uniform() -> "jaxrod.Rod":
    return make_rod(section=jaxrod.Uniform(radius=0.025))


def pytest_collection_modifyitems(items):
    """The longest first: what is begun last keeps one worker busy while the other has nothing left."""
    items.sort(key=lambda item: "notebooks" not in item.nodeid)
