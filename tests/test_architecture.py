"""The packages: which imports which, how large they are, what their names say."""

import ast
import importlib
import inspect
import pathlib
import pkgutil

import pytest

import jaxrod

ROOT = pathlib.Path(jaxrod.__file__).parent
# Each may import those before it.
FLOORS = [
    ["configuration"],
    ["core"],
    ["integrators", "rods"],
    ["shapes"],
    ["motions"],
    ["continuum"],
    ["mechanics"],
    ["runs"],
    ["accuracy", "identification"],
    ["simulation", "ensemble"],
    ["plot"],
    ["paper"],
    ["scenes"],
    ["__main__"],
]
FLOOR = {room: floor for floor, rooms in enumerate(FLOORS) for room in rooms}
MODULES = [module.name for module in pkgutil.walk_packages(jaxrod.__path__, "jaxrod.")]
PACKAGES = [name for name in MODULES if (ROOT.parent / name.replace(".", "/")).is_dir()]


def _imported(name: str) -> set[str]:
    """What a module of ours imports of ours, dotted."""
    path = ROOT.parent / name.replace(".", "/")
    package = path.is_dir()
    base = name.split(".") if package else name.split(".")[:-1]
    found = set()
    for node in ast.walk(ast.parse((path / "__init__.py" if package else path.with_suffix(".py")).read_text("utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.level:
            whence = ".".join([*base[: len(base) - node.level + 1], *(node.module or "").split(".")]).strip(".")
            of_modules = {f"{whence}.{x.name}" for x in node.names} & {*MODULES}
            found |= of_modules or {whence}
    return found


def test_imports_run_one_way():
    for name in MODULES:
        room = name.split(".")[1]
        others = {x.split(".")[1] for x in _imported(name) if x != "jaxrod"} - {room}
        assert all(FLOOR[other] < FLOOR[room] for other in others), (name, others)


def test_no_cycles_within_a_package():
    above = {name: _imported(name) & {*MODULES} for name in MODULES if name not in PACKAGES}
    while above:
        free = [name for name, others in above.items() if not others & above.keys()]
        assert free, sorted(above)
        above = {name: others for name, others in above.items() if name not in free}


def test_listings_are_short():
    """Twenty entries at the top, ten modules in a package, ten floors of packages."""
    top = [path for path in ROOT.iterdir() if path.name != "__pycache__"]
    assert len(top) <= 20
    for name in PACKAGES:
        modules = list(pkgutil.iter_modules([str(ROOT.parent / name.replace(".", "/"))]))
        assert len(modules) <= 10, name
    floors = [rooms for rooms in FLOORS if any((ROOT / room).is_dir() for room in rooms)]
    assert len(floors) <= 10


@pytest.mark.parametrize("name", PACKAGES)
def test_a_package_s_page_names_its_modules(name):
    page = importlib.import_module(name).__doc__ or ""
    inside = [module.name for module in pkgutil.iter_modules([str(ROOT.parent / name.replace(".", "/"))])]
    assert not [module for module in inside if module not in page]


def test_no_module_bears_the_name_of_what_it_exports():
    """An attribute of a package is the module or the function, whichever was touched last."""
    for name in MODULES:
        if name.endswith("__main__"):
            continue
        last = name.split(".")[-1]
        assert not callable(getattr(importlib.import_module(name), last, None)), name


def test_public_names_are_what_they_are_meant_to_be():
    modules = {"claims", "continuum", "energy", "ladder", "law", "paper", "plot", "scenes"}
    for name in jaxrod.__all__:
        found = getattr(jaxrod, name)
        assert inspect.ismodule(found) == (name in modules)
        assert name in modules or inspect.isclass(found) == name[0].isupper(), name
