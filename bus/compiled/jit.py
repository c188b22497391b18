"""What stands on the insides of numba: calls without its dispatcher, hints for its compiler, and a
stamp for its cache."""

from __future__ import annotations

from collections.abc import Callable
from hashlib import blake2b
from pathlib import Path
from types import ModuleType

from llvmlite import ir
from numba import types
from numba.extending import intrinsic, lower_builtin, type_callable

__all__ = ["ahead", "apart", "direct", "stamp"]


def direct(kernel: Callable) -> Callable:
    """A kernel without its dispatcher, which looks at the type of every array at each call.

    Parameters
    ----------
    kernel : callable
        Made by `numba.njit` with one signature, for which the caller answers from now on; anything
        else is handed back as it is (NUMBA_DISABLE_JIT).
    """
    if not hasattr(kernel, "overloads"):
        return kernel
    (compiled,) = kernel.overloads.values()
    return compiled.entry_point


def apart() -> None:
    """Tell the compiler that no two arrays of the calling kernel overlap; in Python, nothing.

    It would ask at run time, for every pair of them, and beyond a few pairs give up vectors. A
    kernel with so many arrays is also better off with the widest vectors that there are, which the
    compiler avoids on most processors for the sake of code that needs them now and then.
    """


@type_callable(apart)
def _apart_type(context):
    return lambda: types.none


@lower_builtin(apart)
def _apart_code(context, builder, signature, arguments):
    for argument in builder.function.args:
        if argument.type.is_pointer:
            argument.add_attribute("noalias")
    # llvmlite's own `add` knows but the attributes that have no value.
    set.add(builder.function.attributes, '"prefer-vector-width"="512"')
    return context.get_dummy_value()


@intrinsic
def ahead(typing, array, index):
    """Begin to fetch the cache line of an element of a 1-D array, which may lie beyond its end."""

    def code(context, builder, signature, arguments):
        view = context.make_array(signature.args[0])(context, builder, arguments[0])
        byte, word = ir.IntType(8).as_pointer(), ir.IntType(32)
        kind = ir.FunctionType(ir.VoidType(), [byte, word, word, word])
        name = "llvm.prefetch.p0i8"
        fetch = builder.module.globals.get(name) or ir.Function(builder.module, kind, name)
        place = builder.bitcast(builder.gep(view.data, [arguments[1]]), byte)
        to_read, nearest, data = word(0), word(3), word(1)
        builder.call(fetch, [place, to_read, nearest, data])
        return context.get_dummy_value()

    return types.none(array, types.intp), code


def stamp(*modules: ModuleType) -> int:
    """A number that changes with the files of modules.

    Numba compiles a cached kernel anew when its own file changes, and sees no other file. It does
    see the values that a kernel takes from the function around it: a kernel that calls what stands
    in other files names their stamp there.
    """
    found = blake2b(digest_size=6)
    for module in modules:
        found.update(Path(module.__file__).read_bytes())
    return int.from_bytes(found.digest(), "big")
