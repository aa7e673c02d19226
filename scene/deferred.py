"""Machine code that is made where it is asked for, once, of a function and all that it calls.

Numba by itself optimises each function and translates it into machine code, then links it into its caller, optimises
that with all that it calls, and so on: a function that is called through four others is optimised five times.  Here a
function of ours that is called by compiled code of ours alone is only linked; the function that Python calls is
optimised, once, with all below it.  Numba's own functions, and those of who imports this package beside his own, are
compiled as ever: one of his that calls one of ours finds it optimised and translated.

What loops over paths is optimised as numba does; closures, small matrices a few thousand times, less: unrolled and in
vectors their loops take LLVM longer than they run.  No optimisation changes a floating-point result.

Numba has no public way to do so.  Of its internals this module and `rattle.scene.dispatcher` use what a code library
does between `finalize` and `get_pointer_to_function`, the pass managers, the environments (Python objects of compiled
code) and the making of a wrapper.  Under a version that was not tested, and where a name is missing, functions are
compiled in numba's plain way, with the same results (`rattle.scene.compiled`).
"""

from typing import Any

from llvmlite.binding.newpassmanagers import create_pass_builder, create_pipeline_tuning_options
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler
from numba.core.environment import lookup_environment

LIBRARY: Any = JITCodeLibrary  # typed as Any: numba has no type hints
COMPILER: Any = Compiler
ENVIRONMENT: Any = lookup_environment
TUNING: Any = create_pipeline_tuning_options
BUILDER: Any = create_pass_builder


class Deferred(LIBRARY):  # type: ignore[misc]
    """The code of a function; machine code from the first time that it is called for from outside."""

    brief = False  # whether to optimise little: neither vectors nor unrolled loops

    def __init__(self, codegen: Any, name: str) -> None:
        super().__init__(codegen, name)
        self._has_machine_code = False
        self.enable_object_caching()

    @property
    def codegen(self) -> Any:
        """Numba's code generator, as it is seen from a library that may have no machine code."""
        return Absent(self._codegen)

    def finalize(self) -> None:
        """End the list of what the function calls."""
        self._raise_if_finalized()
        for library in self._linking_libraries:
            self._reload_init.update(library._reload_init)
        self._finalized = True

    def get_pointer_to_function(self, name: str) -> Any:
        """Address of a function."""
        self._ensure_finalized()
        if any(f.name == name for f in self.get_defined_functions()):
            self._translate()
        return super().get_pointer_to_function(name)

    def _get_module_for_linking(self) -> Any:
        """As numba has it: whoever is not of ours is linked with a function, and all it calls, that is optimised."""
        self._ensure_finalized()
        self._translate()
        return super()._get_module_for_linking()

    def _translate(self) -> None:
        """Link, optimise, and make machine code, unless that was done."""
        if self._has_machine_code:
            return
        for library in self._called():
            self._final_module.link_in(LIBRARY._get_module_for_linking(library), preserve=True)
        self._shared_module = None
        self._optimize_final_module()
        self._final_module.verify()
        self._finalize_final_module()

    def _called(self) -> list[Any]:
        """Libraries of what is called, at any depth, each after those that call it: LLVM links what is missing."""
        callers_last: dict[Any, None] = {}

        def visit(library: Any) -> None:
            if library not in callers_last:
                for called in () if getattr(library, "_has_machine_code", True) else library._linking_libraries:
                    visit(called)
                callers_last[library] = None

        visit(self)
        return [*callers_last][-2::-1]

    def _optimize_final_module(self) -> None:
        if not self.brief:
            super()._optimize_final_module()
            return
        cheap, builder = self._codegen._module_pass_manager(
            loop_vectorize=False, slp_vectorize=False, opt=0, cost="cheap"
        )
        cheap.run(self._final_module, builder)
        options = TUNING(speed_level=1)
        options.loop_unrolling = options.loop_interleaving = False
        options.loop_vectorization = options.slp_vectorization = False
        builder = BUILDER(self._codegen._tm, options)
        builder.getModulePassManager().run(self._final_module, builder)

    def _finalize_final_module(self) -> None:
        self._has_machine_code = True
        super()._finalize_final_module()
        for variable in self._final_module.global_variables:
            environment = ENVIRONMENT(variable.name)
            if environment is not None:
                self.codegen.set_env(variable.name, environment)


class Absent:
    """A code generator that takes the environment of a function that has no machine code for granted."""

    def __init__(self, codegen: Any) -> None:
        self._codegen = codegen

    def __getattr__(self, name: str) -> Any:
        return getattr(self._codegen, name)

    def set_env(self, env_name: str, env: Any) -> None:
        """Say where the Python objects of a function are, if there is machine code of it."""
        if self._codegen._engine.is_symbol_defined(env_name):
            self._codegen.set_env(env_name, env)


class Linked(COMPILER):  # type: ignore[misc]
    """Numba's compiler, for a function whose code is linked into its callers before it is optimised."""

    def define_pipelines(self) -> Any:
        """Numba's passes, with a library of ours to take the code."""
        self.state.library = Deferred(self.state.targetctx.codegen(), self.state.func_id.func_qualname)
        return super().define_pipelines()
