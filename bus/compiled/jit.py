"""Kernels: plain functions, and the one way to compile them.

A kernel is a plain function that writes into its arguments, and one line that compiles it::

    def scale_python(model, data): ...

    scale = compiled(scale_python)

Functions that kernels call carry `jitable`. Both may stand in any file. Machine code is kept on
disk by numba's own cache, in the folder of `bus.compiled.cache`.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterable
from typing import Any

from numba import njit, typeof
from numba.extending import register_jitable

from bus.compiled.cache import kept

__all__ = ["bound", "compiled", "direct", "jitable"]


def compiled(
    function: Callable[..., Any],
    signatures: Iterable[object] = (),
    *,
    fastmath: Iterable[str] = (),
    allocates: bool = True,
) -> Callable[..., Any]:
    """Compile a kernel: divisions as numpy's, without the interpreter's lock, kept on disk.

    Parameters
    ----------
    function : callable
        The kernel; it and what it calls may be closures over constants.
    signatures : iterable, optional
        Types for which it is compiled at once.
    fastmath : iterable of str
        Of "contract", "reassoc" and "arcp". Others would delete tests for NaN, which says
        "no data" here.
    allocates : bool
        False for a kernel that makes no arrays of its own: it takes no references to those of its
        arguments either, of which numba's cost 0.1 µs each in every call. Kernels of a cycle.
    Returns
    -------
    callable
        The compiled kernel; `function` itself where NUMBA_DISABLE_JIT is set.

    Raises
    ------
    ValueError
        Fast-math that would change what NaN and infinity mean.
    """
    flags = set(fastmath)
    if not flags <= {"contract", "reassoc", "arcp"}:
        raise ValueError(f"fastmath: must be of 'contract', 'reassoc', 'arcp'; got {sorted(flags)}")
    compile_it: Any = njit
    options: dict[str, Any] = {"_nrt": allocates, "fastmath": flags or False}
    with kept() as cached:
        kernel = compile_it(error_model="numpy", nogil=True, cache=cached, **options)(function)
    for signature in signatures if hasattr(kernel, "compile") else ():
        kernel.compile(signature)
    return kernel


def bound(kernel: Any, *arguments: Any) -> Callable[..., Any]:
    """A call of a kernel on arguments that stay the same.

    The kernel is compiled for their types, or loaded, at once. The call goes past the dispatcher,
    which would look at the type of every array each time.

    Parameters
    ----------
    kernel : callable
        Of `compiled`; where it is not compiled, it is called as it is.
    *arguments
        Arrays, numbers, truth values, None, and tuples of these.
    """
    return functools.partial(direct(kernel, *arguments), *arguments)


def direct(kernel: Any, *arguments: Any) -> Callable[..., Any]:
    """A kernel compiled for the types of some arguments, without its dispatcher.

    Who calls it answers for the types. Without arguments it is that of the first signature that the
    kernel was made with.
    """
    if not hasattr(kernel, "compile"):
        return kernel
    if arguments:
        return kernel.compile(tuple(map(typeof, arguments)))
    return kernel.compile(kernel.signatures[0])


def jitable(
    function: Callable[..., Any] | None = None, /, *, fastmath: Iterable[str] = ()
) -> Callable[..., Any]:
    """Mark a function that kernels call; from Python it stays as it is.

    Its code is put into that of every caller: loops around it become vectors, and no call passes
    dozens of arrays (the contact stage ran 1.8 times as long with calls).

    Parameters
    ----------
    function : callable
    fastmath : iterable of str
        As of `compiled`; that of the calling kernel if not given.
    """
    if function is None:
        return lambda wrapped: jitable(wrapped, fastmath=fastmath)
    flags = set(fastmath)
    # no wrapper for callers in C, of which there are none
    options: dict[str, Any] = {"forceinline": True, "no_cfunc_wrapper": True}
    options |= {"fastmath": flags} if flags else {}
    return register_jitable(**options)(function)
