"""What can be told of numbers and functions before they are computed: is a value known, what does a program depend on, which
functions are alike; and how a function becomes one program.

Under a transformation of JAX a number is *traced*: it has a shape and a type, and no value yet.
"""

import builtins
import dis
import functools
import types
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jax.extend.core import Literal
from jaxtyping import Array, Inexact

_ALONG = frozenset(["s"])
_STEPPED = {"floor", "ceil", "round", "sign", "rem"}  # steps in floating point; comparisons and integers step anyway


def known(value: Any) -> bool:
    """Whether `value` holds numbers that can be looked at now (and not a tracer)."""
    return not isinstance(value, Tracer)


def closes_over_traced(value: Any, inside: bool = False, depth: int = 8, seen: set[int] | None = None) -> bool:
    """Whether a function in `value` has a traced number in its closure, where no pytree sees it.

    `inside`: whether `value` itself is in a closure; leaves of pytrees outside are no secret.
    """
    seen = set() if seen is None else seen
    if isinstance(value, Tracer) or depth == 0 or id(value) in seen:
        return isinstance(value, Tracer) and inside
    seen.add(id(value))
    if isinstance(value, list | tuple):
        inner = value
    elif isinstance(value, dict):
        inner = value.values()
    elif isinstance(value, functools.partial):
        inner = (value.func, value.args, value.keywords)
        inside = inside or not isinstance(value, jax.tree_util.Partial)
    elif isinstance(value, types.FunctionType):
        inner = (*(content(cell) for cell in value.__closure__ or ()), value.__defaults__, value.__kwdefaults__)
        inside = True
    elif isinstance(value, types.MethodType):
        inner = (value.__func__, value.__self__)
    elif isinstance(value, eqx.Module):
        inner = vars(value).values()
    elif hasattr(value, "__dict__") and not isinstance(value, type | types.ModuleType | jax.Array):
        inner, inside = vars(value).values(), True  # an object that is no pytree
    else:
        return False
    return any(closes_over_traced(x, inside, depth - 1, seen) for x in inner)


def content(cell) -> Any:
    """What a cell of a closure holds; None if nothing yet."""
    try:
        return cell.cell_contents
    except ValueError:
        return None


def depends_on_first(function: Callable[..., Any], first: Any, *others: Any) -> bool:
    """Whether the program of `function` uses its first argument for its answer."""
    jaxpr = jax.make_jaxpr(function)(first, *others).jaxpr
    reached = set(jaxpr.invars[: len(jax.tree.leaves(first))])
    for eqn in jaxpr.eqns:
        if any(not isinstance(x, Literal) and x in reached for x in eqn.invars):
            reached.update(eqn.outvars)
    return any(not isinstance(x, Literal) and x in reached for x in jaxpr.outvars)


def at_once(function: Callable[..., Any]) -> Callable[..., Any]:
    """The function as one compiled program where all it is given is known: JAX would compile each operation by itself.

    Of traced numbers it works as it stands, so that what does not depend on them stays known.
    """
    compiled = eqx.filter_jit(function)

    @functools.wraps(function)
    def call(*args):
        traced = any(isinstance(x, Tracer) for x in jax.tree.leaves(args))
        return function(*args) if traced else compiled(*args)

    return call


def program(function: Callable[..., Any]) -> Callable[..., Any]:
    """The function as one compiled program, which takes a keyword more: `seldom`, for a program that is to run a few times.

    That is compiled in about half the time, to run up to three times as long; under a transformation it is a part of another
    program, and compiled as that is.
    """
    unoptimised: dict[str, Any] = {"compiler_options": {"xla_backend_optimization_level": 0}}
    often, sooner = eqx.filter_jit(function), eqx.filter_jit(function, **unoptimised)

    @functools.wraps(function)
    def call(*args, seldom: bool = False, **named):
        # While jit traces, operations of known numbers are traced too.
        within = isinstance(jnp.zeros(()), Tracer) or any(isinstance(x, Tracer) for x in jax.tree.leaves((args, named)))
        if seldom and not within:
            try:
                return sooner(*args, **named)
            except (
                ValueError
            ) as error:  # it reads a traced number that is no argument, and is a part of another program
                if "compiler_options" not in str(error):
                    raise
        return often(*args, **named)

    return call


def run_seldom(function: Callable[..., Any]) -> Callable[..., Any]:
    """The function as one compiled `program` that is to run a few times."""
    return functools.wraps(function)(functools.partial(program(function), seldom=True))


@jax.custom_jvp
def no_derivative(x: Any, where: Any) -> Any:
    """x; its derivatives are NaN where `where` holds."""
    del where
    return x


@no_derivative.defjvp
def _no_derivative_jvp(primals, tangents):
    (x, where), (dx, _) = primals, tangents
    return no_derivative(x, where), dx * jnp.where(where, jnp.nan, 1.0).astype(dx.dtype)


def carried(function: Callable[..., Any]) -> Any:
    """A function as a pytree, so that it passes through jit and vmap: a module keeps its numbers as leaves.

    Of functions of one code that hold the same numbers one stands for all: JAX compiles for it alone.
    """
    if not isinstance(function, eqx.Module | jax.tree_util.Partial):
        return jax.tree_util.Partial(_first_alike(function))
    leaves, structure = jax.tree.flatten(function)
    if all(map(eqx.is_array_like, leaves)):
        return function
    return _Carried(
        [x for x in leaves if eqx.is_array_like(x)],
        tuple(None if eqx.is_array_like(x) else x for x in leaves),
        structure,
    )


_ALIKE: dict[Any, Any] = {}  # functions by what they are told from others by
_MOST_ALIKE = 1000
_FIXED = {"math", "cmath", "numpy", "jax"}  # modules that do not change, nor what is in them
_PLAIN = {
    "abs",
    "bool",
    "complex",
    "divmod",
    "float",
    "int",
    "len",
    "max",
    "min",
    "pow",
    "range",
    "round",
    "sum",
    "tuple",
    "zip",
}
_READS = {"LOAD_GLOBAL", "LOAD_NAME"}
_NOT_PLAIN = ("STORE_DEREF", "DELETE_DEREF", "STORE_GLOBAL", "DELETE_GLOBAL", "IMPORT_NAME", "MAKE_FUNCTION")


def _first_alike(function: Any) -> Any:
    """One function for all of a code with the same numbers, as they are now; the function itself where it reads or writes
    anything but numbers, text and modules that do not change."""
    if not isinstance(function, types.FunctionType) or vars(function) or function.__kwdefaults__:
        return function
    code, held = function.__code__, [content(cell) for cell in function.__closure__ or ()]
    steps = list(dis.get_instructions(code))
    read = {step.argval: _read(function, step.argval) for step in steps if step.opname in _READS}
    numbers = (*held, *(function.__defaults__ or ()))
    constant = all(map(_is_number, numbers)) and all(x is not None for x in read.values())
    if not constant or any(step.opname in _NOT_PLAIN for step in steps):
        return function
    told_by = code, tuple((type(x), repr(x)) for x in numbers), tuple((name, id(x)) for name, x in read.items())
    if len(_ALIKE) >= _MOST_ALIKE:
        _ALIKE.clear()
    if told_by not in _ALIKE:  # variables of its own: what it was told by and what it does stay together
        cells = tuple(types.CellType(x) for x in held)
        alone = types.FunctionType(code, read, function.__name__, function.__defaults__, cells)
        alone.__module__, alone.__qualname__ = function.__module__, function.__qualname__
        _ALIKE[told_by] = alone
    return _ALIKE[told_by]


def _read(function: types.FunctionType, name: str) -> Any:
    """What a global name stands for, if that does not change; else None."""
    if name not in function.__globals__:
        return getattr(builtins, name) if name in _PLAIN else None
    value = function.__globals__[name]
    fixed = isinstance(value, types.ModuleType) and value.__name__.partition(".")[0] in _FIXED
    return value if fixed else None


def _is_number(value: Any) -> bool:
    return type(value) in (bool, int, float, complex, str) or isinstance(value, np.number)


class _Carried(eqx.Module):
    """A module that is called, of whose leaves some are functions: they are no leaves here."""

    numbers: list[Any]
    others: tuple = eqx.field(static=True)
    structure: Any = eqx.field(static=True)

    def __call__(self, *given: Any) -> Any:
        numbers = iter(self.numbers)
        leaves = [next(numbers) if x is None else x for x in self.others]
        return jax.tree.unflatten(self.structure, leaves)(*given)


def traced(part: Any) -> bool:
    """Whether a number in its pytree, or in its closures, is traced."""
    return any(isinstance(x, Tracer) for x in jax.tree.leaves(part)) or closes_over_traced(part)


def deciding(part: Any, s: Any) -> list[Inexact[Array, "..."]]:
    """The traced numbers in part(s), of its pytree and of its closures, that are compared with s.

    They decide where it is divided, as b does in where(s < b, ...): by the place of a jump automatic differentiation finds
    a derivative of zero, as nothing that it knows depends on b.
    """
    numbers, rest = eqx.partition(part, eqx.is_array)
    leaves, structure = jax.tree.flatten(numbers)
    if not traced(part):
        return []

    def values(leaves, s):
        return eqx.combine(jax.tree.unflatten(structure, leaves), rest)(s)

    closed = jax.make_jaxpr(values)(leaves, s)
    given = [*leaves, *closed.consts]
    names = [frozenset([k]) if isinstance(x, Tracer) else frozenset() for k, x in enumerate(given)]
    _, found = _followed(closed.jaxpr, [*names[: len(leaves)], _ALONG], names[len(leaves) :])
    return [given[k] for k in sorted(found) if eqx.is_inexact_array(given[k])]


def _followed(jaxpr: Any, inputs: list, constants: Any = None) -> tuple[list, frozenset]:
    """What the outputs of a program depend on, and what is compared with s in it."""
    depends = dict(zip(jaxpr.invars, inputs, strict=True))
    depends.update(zip(jaxpr.constvars, constants or [frozenset()] * len(jaxpr.constvars), strict=True))
    found = frozenset()

    def of(x):
        return frozenset() if isinstance(x, Literal) else depends[x]

    for equation in jaxpr.eqns:
        each = [of(x) for x in equation.invars]
        union = frozenset().union(*each)
        outputs = [union] * len(equation.outvars)
        inner = [x for value in equation.params.values() for x in _programs(value)]
        for program in inner:
            # A call passes its arguments on; of loops and branches everything may depend on everything.
            call = len(inner) == 1 and equation.primitive.name != "scan" and len(program.invars) == len(each)
            results, compared = _followed(program, each if call else [union] * len(program.invars))
            outputs, found = results if call else outputs, found | compared
        stepped = equation.primitive.name in _STEPPED or any(_exact(x) for x in equation.outvars)
        if not inner and stepped and union >= _ALONG:
            found |= union - _ALONG
        depends.update(zip(equation.outvars, outputs, strict=True))
    return [of(x) for x in jaxpr.outvars], found


def _programs(value: Any) -> list:
    """The jaxprs in a parameter of an equation."""
    if isinstance(value, tuple | list):
        return [program for x in value for program in _programs(x)]
    value = getattr(value, "jaxpr", value)
    return [value] if hasattr(value, "eqns") else []


def _exact(variable: Any) -> bool:
    return not jax.numpy.issubdtype(getattr(variable.aval, "dtype", float), jax.numpy.inexact)
