"""How functions are compiled that are parts of compiled loops alone.

Numba makes every function ready to be called by itself: it optimises it with all that it calls, and has machine code written. For a function that only loops
call, nobody ever runs that: the loop takes in its code and is optimised as a whole. Left out, the event loop compiles in three quarters of the time, to
the same bits and as fast.
"""

from __future__ import annotations

from typing import Any

from numba import _dynfunc
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompilerBase, DefaultPassBuilder
from numba.core.compiler_machinery import register_pass
from numba.core.typed_passes import NativeLowering


class PartLibrary(JITCodeLibrary):
    """The code of a part, linked with that of the parts that it calls, and neither optimised nor made ready to run."""

    def finalize(self) -> None:
        """Link what it calls."""
        self._raise_if_finalized()
        for library in dict.fromkeys(self._linking_libraries):
            self._reload_init.update(library._reload_init)
            self._final_module.link_in(library._get_module_for_linking(), preserve=True)
        self._finalized = True


@register_pass(mutates_CFG=True, analysis_only=False)
class PartLowering(NativeLowering):
    """Numba's own step from typed code to that of LLVM, into a `PartLibrary`."""

    _name = "part_lowering"

    def run_pass(self, state: Any) -> bool:
        """Write the code of a function and let others find it; what Python would call it through leads nowhere."""
        state.library = PartLibrary(state.targetctx.codegen(), state.func_id.func_qualname)
        state.flags.no_compile = True
        done = super().run_pass(state)
        result = state["cr"]
        described = result.fndesc
        name = described.qualname.rpartition(".")[2]
        stands_for = _dynfunc.make_function(described.lookup_module(), name, "part of a compiled loop", 0, result.env, (state.library,))
        state.targetctx.insert_user_function(stands_for, described, [state.library])
        state.reload_init.extend(state.library._reload_init)
        state["cr"] = result._replace(cfunc=stands_for)
        return done


class PartCompiler(CompilerBase):
    """Numba's compiler for a part."""

    def define_pipelines(self) -> list[Any]:
        """Numba's own steps but the one that makes machine code."""
        steps = DefaultPassBuilder.define_nopython_pipeline(self.state)
        steps.passes = [(PartLowering if step is NativeLowering else step, words) for step, words in steps.passes]
        return [steps]
