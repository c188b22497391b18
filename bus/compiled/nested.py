"""Compile a function that only kernels call: once, within its callers.

Numba compiles every function as if Python might call it: it optimises the function together with
all that it calls, makes machine code of it and wraps it twice. A kernel of many small functions in
many levels is optimised as often as it has levels. Here a function that only kernels call stays
intermediate code, which is optimised where it ends up: in the kernel. Those that are put into every
caller are optimised before, for vectors are found in small loops only.

Numba finds machine code by a name, made unique by a number that each process counts from zero: two
variants of a kernel that two processes have compiled first have one name, and a third process that
loads both from the cache finds the code of one for both. Here the number follows from what a
function is made of.

Numba lets every index count from the end: where it is negative, the length is added. Unless the
compiler can rule that out, a load of many neighbours becomes a load of each at an address of its
own. Kernels count from the front, and so their code adds nothing; an index that is negative and no
constant would read memory of somebody else. With ``NUMBA_BOUNDSCHECK=1`` kernels raise IndexError
at such an index; numba's own functions that they call are compiled as numba would.

It stands on numba's interface for compilers of one's own, and on private parts (the library of
code, and how a compiled function is made known); where a version lacks them, `pipeline` and
`kernel_pipeline` are None, and numba's own way is used. Where it reads an index in another way,
that stays as it is.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from inspect import signature
from typing import Any

from bus.compiled.stamps import stamp

__all__ = ["kernel_pipeline", "pipeline"]

OF_INDEX = "context", "builder", "idxty", "idx", "size"
"""What numba's function that reads an index takes, in the versions that are known here."""

pipeline: Any = None
"""Of functions that only kernels call: numba's option ``pipeline_class``; None where this numba has
not what it needs."""
kernel_pipeline: Any = None
"""Of the kernels that call them, likewise."""


def _build() -> Any:
    from numba import _dynfunc  # pyright: ignore[reportAttributeAccessIssue]
    from numba.core.codegen import JITCodeLibrary
    from numba.core.compiler_machinery import register_pass
    from numba.core.environment import lookup_environment
    from numba.core.typed_passes import NativeLowering

    base_library: Any = JITCodeLibrary
    front_lower: Any = _front_lower()
    for name in ("_optimize_final_module", "_finalize_final_module", "_finalize_dynamic_globals",
                 "_get_compiled_object"):  # fmt: skip
        getattr(base_library, name)

    class NestedLibrary(base_library):
        """Code that is linked into its callers and never run by itself."""

        optimized = False

        def _optimize_final_module(self):
            if self.optimized:
                super()._optimize_final_module()

        def _finalize_final_module(self):
            self._finalize_dynamic_globals()
            self._finalized = True

    class KernelLibrary(base_library):
        """Code of a kernel, to be kept on disk even if something failed while it was compiled."""

        def _get_compiled_object(self):
            # LLVM hands machine code to a callback, and what is raised there, as by Ctrl-C or by a
            # timer, is lost with the code.
            if self._compiled_object is None:
                self._compiled_object = self._codegen._tm.emit_object(self._final_module)
            return super()._get_compiled_object()

    @register_pass(mutates_CFG=True, analysis_only=False)
    class NestedLowering(NativeLowering):
        """Lower to intermediate code, without machine code and wrappers."""

        _name = "nested_lowering"
        lowering_class = front_lower

        def run_pass(self, state):
            name = state.func_id.func_qualname
            state.library = NestedLibrary(state.targetctx.codegen(), name)
            state.library.enable_object_caching()
            flags = state.flags
            # its loops become vectors before they are part of a larger loop
            state.library.optimized = flags.forceinline
            flags.no_compile = flags.no_cfunc_wrapper = flags.no_cpython_wrapper = True
            super().run_pass(state)
            lowered, library = state["cr"], state.library
            library.finalize()
            # names the function where callers look for its code; not to be called
            entry = _dynfunc.make_function(
                lowered.fndesc.lookup_module(), name, "", 0, lowered.env, (library,)
            )
            state.targetctx.insert_user_function(entry, lowered.fndesc, [library])
            state["cr"] = lowered._replace(cfunc=entry)
            return True

    @register_pass(mutates_CFG=True, analysis_only=False)
    class KernelLowering(NativeLowering):
        """As numba's, and set what `print` and errors with arguments of nested functions use."""

        _name = "kernel_lowering"
        lowering_class = front_lower

        def run_pass(self, state):
            name = state.func_id.func_qualname
            state.library = KernelLibrary(state.targetctx.codegen(), name)
            state.library.enable_object_caching()
            super().run_pass(state)
            for variable in state.library._final_module.global_variables:
                if (environment := lookup_environment(variable.name)) is not None:
                    state.library.codegen.set_env(variable.name, environment)
            return True

    return _compiler(NestedLowering), _compiler(KernelLowering)


def _front_lower() -> type:
    """Numba's lowering of a function, whose indices count from the front."""
    from numba.core.lowering import Lower

    class FrontLower(Lower):
        """Numba's, with `_front_indices`."""

        def lower(self):
            with _front_indices(self.module):
                super().lower()

    return FrontLower


@contextlib.contextmanager
def _front_indices(module: Any) -> Iterator[None]:
    """Do not add the length to the indices of the functions of a module of intermediate code; only
    one thread compiles at a time."""
    from llvmlite import ir
    from numba.core import types
    from numba.np import arrayobj

    from_end = getattr(arrayobj, "fix_integer_index", None)
    if from_end is None or tuple(signature(from_end).parameters) != OF_INDEX:
        yield  # a numba of another version
        return

    def from_front(context, builder, idxty, idx, size):
        if builder.module is not module or isinstance(idx, ir.Constant):
            return from_end(context, builder, idxty, idx, size)
        return context.cast(builder, idx, idxty, types.intp if idxty.signed else types.uintp)

    arrayobj.fix_integer_index = from_front
    try:
        yield
    finally:
        arrayobj.fix_integer_index = from_end


def _compiler(lowering: Any) -> Any:
    """Numba's compiler with another lowering."""
    from numba.core.compiler import CompilerBase, DefaultPassBuilder, Flags
    from numba.core.typed_passes import NativeLowering

    unset = {name: option.default for name, option in Flags.options.items()}

    class ReadAtOnce(Flags):
        """Numba's options of a compilation. They are compared wherever a function is looked up, and
        numba's own are read one by one for it, which takes 7 % of the time of compiling."""

        def values(self):
            return unset | self._values

    class Compiler(CompilerBase):
        """Numba's passes, another lowering instead of its own, and names that stay."""

        def __init__(self, typingctx, targetctx, library, args, return_type, flags, locals):
            own: Any = ReadAtOnce(flags)
            own.no_cfunc_wrapper = True  # kernels are called by their addresses, or from Python
            super().__init__(typingctx, targetctx, library, args, return_type, own, locals)

        def define_pipelines(self):
            identity = self.state.func_id
            identity.unique_id = uid = int(stamp(identity.func)[:15], 16)
            identity.unique_name = f"{identity.func_qualname}${uid}"
            passes = DefaultPassBuilder.define_nopython_pipeline(self.state)
            passes.passes = [
                (lowering, told) if one is NativeLowering else (one, told)
                for one, told in passes.passes
            ]
            passes.finalize()
            return [passes]

    return Compiler


with contextlib.suppress(ImportError, AttributeError):  # a numba of another version
    pipeline, kernel_pipeline = _build()
