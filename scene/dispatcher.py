"""Compiled functions that can be called from Python, and are made so only where Python calls them.

Most functions here are called by compiled code alone.  Those are neither translated into machine code by themselves
(`rattle.scene.deferred`) nor kept on disk, and do without the code that turns Python's objects, arrays and named tuples
most of all, into arguments: it is longer than many a small function.
"""

from copy import copy
from typing import Any

from numba.core import sigutils
from numba.core.compiler import Flags
from numba.core.compiler_lock import global_compiler_lock
from numba.core.environment import Environment
from numba.core.registry import CPUDispatcher
from numba.core.targetconfig import ConfigStack

from rattle.scene.deferred import Deferred, Linked

DISPATCHER: Any = CPUDispatcher  # typed as Any: numba has no type hints
NORMALIZED: Any = sigutils.normalize_signature
SETTINGS: Any = ConfigStack
FLAGS: Any = Flags
ENVIRONMENT: Any = Environment
FEW = "rattle.closure."  # where no loop is over paths or time steps: small matrices, a few thousand times


class Shared(DISPATCHER):  # type: ignore[misc]
    """A function of numba's that is compiled for compiled callers; a wrapper is added where Python calls it."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs, pipeline_class=Linked)
        self.targetoptions["no_cpython_wrapper"] = True
        self.inner = False  # whether the caller that it is being compiled for is compiled
        self._bare: dict[Any, Any] = {}  # by signature: what Python cannot call
        self._lower, self._compiler.compile = self._compiler.compile, self._make

    def get_call_template(self, args: Any, kws: Any) -> Any:
        """Compile the function for a compiled caller, if need be."""
        with global_compiler_lock:
            before, self.inner = self.inner, True
            try:
                return super().get_call_template(args, kws)
            finally:
                self.inner = before

    def compile(self, sig: Any) -> Any:
        """Compile the function, or read it from the cache, for a signature."""
        with global_compiler_lock:
            args = tuple(NORMALIZED(sig)[0])
            if not self.inner and self.overloads.get(args) is self._bare.get(args):
                self.overloads.pop(args, None)
            return super().compile(sig)

    def add_overload(self, made: Any) -> None:
        """Take a compiled function into use."""
        if self.inner:
            self.overloads[tuple(made.signature.args)] = made
        else:
            super().add_overload(made)

    def _make(self, args: Any, return_type: Any) -> Any:
        """What is in use under a signature from now on."""
        if args not in self._bare:
            self._bare[args] = self._lower(args, return_type)
        return self._bare[args] if self.inner else self._wrapped(self._bare[args])

    def _wrapped(self, made: Any) -> Any:
        """The same function, for Python."""
        context, description = made.target_context, copy(made.fndesc)
        description.env_name += "_for_python"  # objects of its own: callers are kept without those of a wrapper
        environment = ENVIRONMENT.from_fndesc(description)
        library = Deferred(made.codegen, description.qualname)
        library.brief = self.py_func.__module__.startswith(FEW)
        library.add_linking_library(made.library)
        flags = FLAGS()
        self.targetdescr.options.parse_as_flags(flags, self.targetoptions)
        with SETTINGS().enter(flags), context.push_code_library(library):
            context.create_cpython_wrapper(
                library, description, environment, made.call_helper, release_gil=flags.release_gil
            )
        entry = context.get_executable(library, description, environment)
        context.insert_user_function(entry, description, [library])
        return made._replace(
            library=library, entry_point=entry, fndesc=description, environment=environment, metadata={}
        )
