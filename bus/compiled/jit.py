"""Kernels: plain functions, and the one way to compile them.

A kernel is a plain function that writes into its arguments, and one line that compiles it::

    def scale_python(model, data): ...

    scale = compiled(scale_python)

Functions that kernels call carry `jitable`. Both may stand in any file: the cache of compiled code
sees all that a kernel is made of, see `bus.compiled.cache`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

from numba import njit
from numba.extending import register_jitable

from bus.compiled import nested
from bus.compiled.cache import cache_on_disk
from bus.compiled.stamps import mark

__all__ = ["compiled", "jitable"]


def compiled(
    function: Callable[..., Any],
    signatures: Iterable[object] = (),
    *,
    fastmath: Iterable[str] = (),
    cache: bool = True,
    allocates: bool = True,
    made_by: tuple[Any, ...] | None = None,
    **options: object,
) -> Callable[..., Any]:
    """Compile a kernel: divisions as numpy's, without the interpreter's lock, kept on disk.

    Parameters
    ----------
    function : callable
        The kernel; it and what it calls may be closures over constants.
    signatures : iterable, optional
        Types for which it is compiled at once, and no others; as they are called if not given.
    fastmath : iterable of str
        Of "contract", "reassoc" and "arcp". Others would delete tests for NaN, which says
        "no data" here.
    cache : bool
        Whether its machine code is kept on disk.
    allocates : bool
        False for a kernel that makes no arrays of its own: it does not count references to those of
        its arguments then, which it would do whenever it takes one from a tuple.
    **options
        Further ones of `numba.njit`.

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
    # Always said: what is compiled within another kernel takes over what is not.
    options["_nrt"] = allocates
    if nested.kernel_pipeline is not None:
        options["pipeline_class"] = nested.kernel_pipeline
    options |= {"error_model": "numpy", "nogil": True, "fastmath": flags or False}
    compile_it: Any = njit
    kernel = compile_it(**options)(function)
    if not hasattr(kernel, "overloads"):
        return kernel
    kernel.made_by = made_by
    if cache:
        cache_on_disk(kernel, options)
    compiled_at_once = list(signatures)
    for signature in compiled_at_once:
        kernel.compile(signature)
    if compiled_at_once:
        kernel.disable_compile()
    return kernel


def jitable(
    function: Callable[..., Any] | None = None, /, *, inline: bool = False, **options: object
) -> Callable[..., Any]:
    """Mark a function that kernels call; from Python it stays as it is.

    Parameters
    ----------
    function : callable
    inline : bool
        Whether its code is put into that of every caller, so that loops around it become vectors.
    **options
        Of `numba.extending.register_jitable`. What is not given is as in the calling kernel.
    """
    if function is None:
        return lambda wrapped: jitable(wrapped, inline=inline, **options)
    if inline:
        options = {"forceinline": True, **options}
    if nested.pipeline is not None:
        options = {"pipeline_class": nested.pipeline, **options}
    mark(function, options)
    return register_jitable(**options)(function) if options else register_jitable(function)
