"""Compiled functions that can be called from Python, and are made so only where Python calls them.

Turning Python's objects into arguments, arrays and named tuples most of all, takes more machine code than many a small
function does itself.  Most functions here are called by compiled code alone.
"""

from typing import Any

from numba.core import sigutils
from numba.core.compiler_lock import global_compiler_lock
from numba.core.registry import CPUDispatcher

__all__ = ["Shared"]

DISPATCHER: Any = CPUDispatcher  # typed as Any: numba has no type hints
NORMALIZED: Any = sigutils.normalize_signature


class Shared(DISPATCHER):  # type: ignore[misc]
    """A function of numba's that is compiled for compiled callers, and once more for Python where Python calls it."""

    _inner = False  # whether the caller is compiled

    @property
    def inner(self) -> bool:
        """Whether the function is being compiled for a compiled caller."""
        return self._inner

    def get_call_template(self, args: Any, kws: Any) -> Any:
        """Compile the function for a compiled caller, if need be.

        Parameters
        ----------
        args, kws
            Types, as numba hands them over.

        Returns
        -------
        tuple
            What numba makes of it.
        """
        with global_compiler_lock:
            before, self._inner = self._inner, True
            try:
                return super().get_call_template(args, kws)
            finally:
                self._inner = before

    def compile(self, sig: Any) -> Any:
        """Compile the function, or read it from the cache, for a signature.

        Parameters
        ----------
        sig
            The signature, as numba hands it over.

        Returns
        -------
        object
            The compiled function.
        """
        with global_compiler_lock:
            args = tuple(NORMALIZED(sig)[0])
            known = self.overloads.get(args)
            if known is not None and not self._inner and known.entry_point in self._bare:
                del self.overloads[args]
            self.targetoptions["no_cpython_wrapper"] = self._inner
            return super().compile(sig)

    def add_overload(self, made: Any) -> None:
        """Take a compiled function into use.

        Parameters
        ----------
        made
            What numba has compiled or read.
        """
        if self._inner:
            self._bare.add(made.entry_point)
            self.overloads[tuple(made.signature.args)] = made
        else:
            super().add_overload(made)

    @property
    def _bare(self) -> set[Any]:
        """Compiled functions that Python cannot call."""
        bare: set[Any] = self.__dict__.setdefault("_bare_ones", set())
        return bare
