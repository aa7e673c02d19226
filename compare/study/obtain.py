"""Obtains one result: read from the store, or computed and stored by one process at a time."""

from collections.abc import Callable

from rattle.compare.study.cells import Cell
from rattle.compare.study.store import Store, Stored
from rattle.compare.study.waiting import Waiting, print_on_stderr

Compute = Callable[[Cell], Stored]
"""Computes a cell; in this thread by default."""


def _here(cell: Cell) -> Stored:
    return cell.compute()


def read_stored(store: Store, cell: Cell) -> Stored | None:
    """Read a cell's result from the store; a file of that name with another content is moved aside."""
    found = store.read(cell.key)
    if found is None:
        return None
    try:
        cell.restore(found)
        float(found.facts["seconds"])
    except (LookupError, TypeError, ValueError, AttributeError) as error:
        store.set_aside(cell.key, f"is no result of this kind ({error})")
        return None
    except MemoryError as error:
        raise store.unreadable(cell.key, error) from None
    return found


def attempt(store: Store, cell: Cell, compute: Compute = _here) -> Stored | None:
    """Read or compute a cell's result, unless another process or thread is computing it."""
    found = read_stored(store, cell)
    if found is not None:
        return found
    with store.alone(cell.key) as alone:
        if not alone:
            return None
        found = read_stored(store, cell)  # another process may have stored it just before the lock was taken
        if found is None:
            found = compute(cell)
            store.write(cell.key, found.table, found.facts)
        return found


def obtain(
    store: Store, cell: Cell, compute: Compute = _here, say: Callable[[str], object] = print_on_stderr
) -> Stored:
    """Read or compute a cell's result, waiting for another process that computes it.

    `say`: Prints a line that names the process that is waited for; to standard error by default.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> from rattle.compare.study.cells import Prediction
    >>> from rattle.scene import DAT21, Scene
    >>> store = Store(Path(tempfile.mkdtemp()))
    >>> cell = Prediction(Scene.from_gears(DAT21), impacts=1, closure="corrected")
    >>> round(float(cell.restore(obtain(store, cell)).section.loc[1, "tau"]), 3)
    0.56
    """
    waiting = Waiting(store.lock, say)
    while (found := attempt(store, cell, compute)) is None:
        waiting.pause([cell])
    return found
