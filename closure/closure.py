"""What a closure is: one interface for those of the package and for a function of one's own."""

import hashlib
import importlib
import inspect
import os
import sys
import time
import types
from collections.abc import Callable, Iterable, Mapping, Sequence
from copy import copy, deepcopy
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from numbers import Real
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from rattle.closure.moments import Trace
from rattle.scene import (
    Floats,
    InputError,
    Scene,
    choice,
    count,
    line,
    nearest,
    section_names,
    state_names,
)
from rattle.scene.elementary import unknown
from rattle.scene.numpy_errors import call_users
from rattle.scene.orbit import follow
from rattle.scene.types import MOST_WHEELS

if TYPE_CHECKING:  # loading it takes as long as all the rest
    import pandas as pd


DERIVED_COLUMNS = ("realizable", "agreement", "discarded", "error_mean", "error_sd", "within")
"""Other columns of `MeanMap.section` than `section_columns`, which are left aside, so that a
changed copy of one may be returned."""
DESCRIBED = ("itinerary", "all paths")
"""Whose moments a closure predicts: the paths that follow its itinerary, or all."""
# microseconds of an impact by a function of which nothing is known, for an estimate beforehand
GUESS = 1000.0
UNPREDICTED = "it predicts nothing after impact {}"


def rho_names(wheels: int) -> list[str]:
    """``rho1, rho2, ...``: correlation of displacement and rate in each gap."""
    return [f"rho{i}" for i in range(1, wheels + 1)]


def section_columns(wheels: int) -> list[str]:
    """Columns of `MeanMap.section` that a closure of one's own may predict."""
    names = section_names(wheels)
    of_names = [f"{what}{name}" for what in ("", "sd_", "skew_") for name in names]
    return of_names + rho_names(wheels)


def moment_names(wheels: int) -> list[str]:
    """Columns of `MeanMap.at_times`."""
    names = state_names(wheels)
    pairs = [f"cov_{a}_{b}" for i, a in enumerate(names) for b in names[i:]]
    return [*names, *pairs, *rho_names(wheels)]


@dataclass(frozen=True)
class Closure:
    """A closure of one's own, where more is to be said than a function can say.

    Wherever the name of a closure is taken (`mean_map`, `validate`, a study, the pytest plugin), a
    plain function is taken too, and is then a closure of that name.  Commands and study files take
    ``package.module:function``.

    Parameters
    ----------
    name : str
        Its name in tables, pages and figures; not that of a closure of the package.
    function : callable
        ``function(scene, impacts)``, returns a DataFrame with a row for each impact (index 1 to
        ``impacts``), or a mapping of names to as many values.  Any of the columns of
        `MeanMap.section`: means ``tau, flight, x1, y1, x2, y2, ...``, standard deviations
        ``sd_tau, sd_y1, ...``, skewness ``skew_...``, correlations ``rho1, rho2, ...``; ``mesh``
        and ``side`` where the impacts are not those of the orbit without noise.  What is missing,
        masked or NaN is not predicted.  It is given the scene as you gave it, and its times ``tau``
        are those of that scene, from ``scene.start.tau`` on.
    at_times : callable, optional
        ``at_times(scene, times)``, the same at fixed times: columns of `MeanMap.at_times`, a row
        for each time, or a mapping of names to as many values.  An attribute ``at_times`` of the
        function serves as well.
    predicts : sequence of str, optional
        Columns that its table must have; by default any will do.
    stages : int, optional
        The number of wheels that it is made for; by default any.
    describes : {"itinerary", "all paths"}, optional
        Whose moments it predicts: those of the paths that follow its itinerary (its sequence of
        meshes and sides), or of all.  Both are judged whatever is said here; pages state it.

    Raises
    ------
    InputError
        If something of it cannot be a closure: a name that is taken, a function that cannot be
        called.

    Examples
    --------
    The first order of `saltation` alone, which shifts no mean:

    >>> from rattle import DAT21, Closure, Scene, mean_map
    >>> def orbit(scene, impacts):
    ...     found = mean_map(scene, impacts=impacts, closure="saltation", order=2)
    ...     return found.section[["tau", "y1"]]
    >>> plain = Closure("orbit", orbit, predicts=("tau", "y1"))
    >>> mean_map(
    ...     Scene.from_gears(DAT21, sigma=0.1), impacts=2, closure=plain
    ... ).section["tau"].round(2).tolist()
    [0.56, 1.14]
    """

    name: str
    function: Callable[..., Any]
    at_times: Callable[[Scene, Sequence[float]], Any] | None = None
    predicts: tuple[str, ...] = ()
    stages: int | None = None
    describes: str | None = None

    # whether `trace` takes a tolerance as its last argument; what limits it where all paths follow
    # its itinerary
    refines: bool = field(default=False, init=False, repr=False)
    limit: str = field(default="own", init=False, repr=False)
    # the text that it was imported by
    origin: str = field(default="", init=False, repr=False, compare=False)

    own: ClassVar[bool] = True
    taken: ClassVar[set[str]] = {"monte carlo"}

    def __post_init__(self) -> None:
        if (
            not isinstance(self.name, str)
            or not self.name
            or line(self.name) != self.name
            or ":" in self.name
        ):
            raise InputError(
                "closure.name", self.name, "give a short text on one line, without a colon"
            )
        if self.own and self.name in self.taken:
            why = (
                "is a closure of this package; give yours another name, as in"
                f" Closure('my_{self.name}', function)"
            )
            raise InputError("closure.name", self.name, why)
        at_times = (
            getattr(self.function, "at_times", None) if self.at_times is None else self.at_times
        )
        if not callable(self.function):
            raise InputError(
                "closure.function",
                self.function,
                "cannot be called; give a function (scene, impacts)",
            )
        if at_times is not None and not callable(at_times):
            raise InputError(
                "closure.at_times", at_times, "cannot be called; give a function (scene, times)"
            )
        if isinstance(self.predicts, str) or not isinstance(self.predicts, Iterable):
            raise InputError(
                "closure.predicts", self.predicts, "give a list of columns, as in ('tau', 'sd_tau')"
            )
        known = section_columns(MOST_WHEELS)
        few = section_columns(2)  # of which a message tells
        predicts = tuple(
            choice("closure.predicts", name, known if name in known else few)
            for name in self.predicts
        )
        if self.stages is not None:
            count("closure.stages", self.stages, least=1, most=MOST_WHEELS)
        if self.describes is not None:
            choice("closure.describes", self.describes, DESCRIBED)
        vars(self).update(at_times=at_times, predicts=predicts)

    @property
    def reference(self) -> str:
        """``package.module:function`` by which a command finds it; empty where there is none."""
        module = getattr(self.function, "__module__", None)
        path = getattr(self.function, "__qualname__", "<")
        plain = self == Closure(self.name, self.function) and path.split(".")[-1] == self.name
        known = plain and "<" not in path and module not in (None, "__main__")
        return self.origin or (f"{module}:{path}" if known else "")

    @cached_property
    def digest(self) -> str:
        """SHA-256 digest of its sources: it changes with the functions and with those of its module
        that they name."""
        parts = [
            self.name,
            str(self.stages),
            *self.predicts,
            *([self.describes] if self.describes else []),
        ]
        for function in (self.function, self.at_times):
            parts += sources(function) if function is not None else []
        return hashlib.sha256("\n".join(parts).encode()).hexdigest()

    def check(self, scene: Scene) -> None:
        """Refuse a scene to which it does not apply."""
        if self.stages is not None and scene.stages != self.stages:
            why = f"closure {self.name!r} is made for {self.stages} wheel{'s' * (self.stages > 1)}"
            raise InputError("scene.stages", scene.stages, why)

    def trace(self, scene: Scene, impacts: int, order: int) -> Trace:
        """Call the function, and read what it returns; raises OwnError where it raises an
        exception."""
        began = time.process_time()
        try:
            given = call_users(self.function, deepcopy(scene), impacts)  # it may change its own
        except (Exception, SystemExit) as error:
            raise OwnError(error) from None
        seconds = time.process_time() - began
        wheels = scene.stages
        known = section_columns(wheels)
        table = read_table(self.name, given, range(1, impacts + 1), "impact", known, self.predicts)
        check_itinerary(self.name, table, wheels)
        if "tau" in table:
            table["tau"] = scene.to_local_time(table["tau"].to_numpy())
        return own_trace(scene.phase_reduced, table, seconds)

    def trace_failure(self, scene: Scene, impacts: int, why: str) -> Trace:
        """The trace of a function that raised an exception: nothing is predicted."""
        import pandas as pd

        table = pd.DataFrame(np.nan, index=range(1, impacts + 1), columns=["tau"])
        return replace(own_trace(scene.phase_reduced, table, np.nan), stopped=why, raised=True)

    def fixed_times(self, scene: Scene, times: Sequence[float]) -> "pd.DataFrame":
        """Moments at fixed times of the scene as it was given; NaN where it predicts none."""
        import pandas as pd

        index = pd.Index(np.asarray(times, dtype=float))
        names = moment_names(scene.stages)
        if self.at_times is None or not len(index):
            return pd.DataFrame(np.nan, index=index, columns=names)
        given = call_users(self.at_times, deepcopy(scene), index.to_numpy())
        table = read_table(f"{self.name}, at_times", given, index, "time", names)
        table = table.reindex(columns=names)
        for i, rho in enumerate(rho_names(scene.stages), 1):
            xx, xy, yy = (table[f"cov_{a}{i}_{b}{i}"] for a, b in ("xx", "xy", "yy"))
            product = (xx * yy).where((xx > 0.0) & (yy > 0.0))
            table[rho] = table[rho].fillna(xy / np.sqrt(product))
        return table

    def seconds(self, trace: Trace, impacts: int) -> float:
        """Seconds that the function took for all impacts: measured, for nobody knows what it
        counts."""
        return trace.seconds

    def most_seconds(self, impacts: int, wheels: int) -> float:
        """A guess of the seconds, before it is called."""
        return 1e-6 * GUESS * impacts


class OwnError(Exception):
    """A function of one's own raised an exception: tells it from what is wrong with the table that
    one returns."""

    def __init__(self, raised: BaseException) -> None:
        super().__init__()
        self.raised = raised


RAISED = "raised "
"""How what is said of a function that raised an exception begins."""


def describe_error(error: BaseException) -> str:
    """An exception of a function of one's own, on one line."""
    return RAISED + name_error(error)


def name_error(error: BaseException) -> str:
    """The kind of an exception and its text, on one line."""
    try:
        text = line(str(error))
    except Exception:  # a text is made by code of the exception's own
        text = "(its text cannot be shown)"
    return f"{type(error).__name__}: {text[:200]}"


def nothing_known(wheels: int, time: float) -> tuple[Floats, Floats]:
    """Mean and covariance at a fixed time, of a closure whose moments there are asked of
    `Closure.fixed_times`."""
    states = 2 * wheels
    return unknown(states), unknown(states, states)


def own_trace(scene: Scene, table: "pd.DataFrame", seconds: float) -> Trace:
    """The trace of a closure of one's own: what its table predicts, along the orbit without noise
    if it has no other.

    A negative sd or ``|rho| > 1`` stays as it is, and is found not to be realizable.  `scene`:
    `Scene.phase_reduced`.
    """
    impacts = len(table)
    orbit = follow(scene, impacts)
    wheels = scene.stages
    names = section_names(wheels)
    states = 2 * wheels
    whole = table.reindex(range(impacts + 1), columns=section_columns(wheels)).astype(float)
    tau = whole["tau"].to_numpy(copy=True)
    tau[0] = scene.phase
    if "tau" not in table and "flight" in table:
        tau = np.cumsum([scene.phase, *table["flight"]])
    sd = whole[[f"sd_{name}" for name in names]].to_numpy(copy=True)
    rho = whole[rho_names(wheels)].to_numpy(copy=True)
    covariance = unknown(impacts + 1, states, states)
    state = sd[:, 2:]
    # a negative sd is a negative variance
    covariance[:, range(states), range(states)] = state * np.abs(state)
    x = np.arange(0, states, 2)
    y = x + 1
    covariance[:, x, y] = covariance[:, y, x] = rho * state[:, x] * state[:, y]
    known = np.flatnonzero(
        table.drop(columns=["mesh", "side"], errors="ignore").notna().any(axis=1).to_numpy()
    )
    predicted = int(known[-1]) + 1 if len(known) else 0
    mesh, side = (
        np.append(along[0], table[name].fillna(0).astype(int)) if name in table else along
        for name, along in (("mesh", orbit.mesh), ("side", orbit.side))
    )
    mean = whole[list(names[2:])].to_numpy(copy=True)
    skew = whole[[f"skew_{name}" for name in names]].to_numpy(copy=True)
    raw = unknown(impacts + 1, wheels, 3, 3)
    at = partial(nothing_known, wheels)
    stopped = "" if predicted == impacts else UNPREDICTED.format(predicted)
    return Trace(
        tau,
        mesh,
        side,
        mean,
        sd,
        skew,
        covariance,
        raw,
        at,
        predicted,
        stopped,
        until=np.inf,
        rho=rho,
        seconds=seconds,
    )


def read_table(
    whose: str,
    given: Any,
    index: Iterable[Any],
    what: str,
    known: Sequence[str],
    needed: Sequence[str] = (),
) -> "pd.DataFrame":
    """Read the table that a function of one's own returns: numbers, a row for each impact or time.

    `whose`: Named in messages.  `index`: The rows that it must have; more are left aside.  `what`:
    "impact" or "time", what a row is of.  `known`: Columns that it may have.  `needed`: Columns
    that it must have.  An infinite value counts as not predicted.
    """
    import pandas as pd

    rows = pd.Index(index)
    if not isinstance(given, Mapping | pd.DataFrame):
        raise InputError(
            f"result of {whose}", type(given).__name__, f"return a DataFrame, a row for each {what}"
        )
    names = list(given)
    if len(set(names)) < len(names):
        raise InputError(f"columns of {whose}", names, "holds a name twice")
    for name in names:
        choice(f"columns of {whose}", name, (*known, *DERIVED_COLUMNS, "mesh", "side"))
    if missing := [name for name in needed if name not in names]:
        raise InputError(f"columns of {whose}", names, f"{missing[0]!r} is missing; return it too")
    if not set(names) & set(known):
        raise InputError(
            f"columns of {whose}", names, "nothing is predicted; return tau or sd_y1, say"
        )
    if isinstance(given, pd.DataFrame):
        if not (given.index.is_unique and rows.isin(given.index).all()):
            why = (
                f"must hold each {what} once, from {rows[0]:g} to {rows[-1]:g}; NaN where nothing"
                " is predicted"
            )
            raise InputError(f"index of {whose}", given.index.tolist(), why)
        given = given.loc[rows]
    picked = [name for name in names if name in (*known, "mesh", "side")]
    columns = {name: _read_numbers(f"{name} of {whose}", given[name]) for name in picked}
    for name, values in columns.items():
        if len(values) != len(rows):
            why = f"return {len(rows)} values, one for each {what}"
            raise InputError(f"length of {name} of {whose}", len(values), why)
    return pd.DataFrame(columns, index=rows)


def _read_numbers(field: str, values: Any) -> Floats:
    """A column as floats; NaN where a value is masked, missing or infinite, and so is not
    predicted."""
    import pandas as pd

    try:
        given = np.ma.asarray(values)
        if given.ndim != 1:
            raise TypeError
        listed = [np.nan if value is None or value is pd.NA else value for value in given.tolist()]
        if not all(isinstance(value, Real) and not isinstance(value, bool) for value in listed):
            raise TypeError
        numbers = np.array([float(value) for value in listed])
    except (TypeError, ValueError, OverflowError):
        raise InputError(
            field, values, "must hold real numbers, or NaN where there is none"
        ) from None
    return np.where(np.isfinite(numbers), numbers, np.nan)


def check_itinerary(whose: str, table: "pd.DataFrame", stages: int) -> None:
    """Refuse an impact at a mesh or on a side that the scene does not have; 0 or NaN stands for no
    impact."""
    for name, valid in (("mesh", range(1, stages + 1)), ("side", (1, -1))):
        if name in table:
            wrong = table[name][~table[name].isin((0, *valid)) & table[name].notna()]
            if len(wrong):
                value = float(wrong.iloc[0])
                value = int(value) if value.is_integer() else value
                raise InputError(
                    f"{name} of {whose} at impact {wrong.index[0]}",
                    value,
                    "give " + " or ".join(map(str, valid)),
                )


def name_of(function: object) -> str:
    """Name of a function, on one line."""
    return (
        line(str(getattr(function, "__name__", type(function).__name__))).replace(":", " ")
        or "unnamed"
    )


def import_closure(field: str, text: str) -> Closure:
    """The closure ``package.module:function``, of an installed package or of a module in the
    working folder."""
    module, _, path = text.partition(":")
    if os.getcwd() not in sys.path:
        sys.path.append(os.getcwd())
    try:
        value: Any = importlib.import_module(module)
    except (Exception, SystemExit) as error:
        why = f"cannot be imported ({name_error(error)})"
        raise InputError(
            field, text, f"{why}; run where its module is, or set PYTHONPATH"
        ) from None
    for name in path.split("."):
        if not hasattr(value, name):
            valid = (
                [n for n, value in vars(value).items() if callable(value)]
                if hasattr(value, "__dict__")
                else []
            )
            raise InputError(field, text, f"{module} has no {name!r}; {nearest(name, valid)}")
        value = getattr(value, name)
    if not callable(value) and not isinstance(value, Closure):
        raise InputError(
            field,
            text,
            f"is a {type(value).__name__}; name a function (scene, impacts), or a Closure",
        )
    closure = copy(value) if isinstance(value, Closure) else Closure(name_of(value), value)
    object.__setattr__(closure, "origin", text)
    return closure


def sources(function: Callable[..., Any], seen: set[int] | None = None) -> list[str]:
    """Sources of a function and of what it names in its module, and the values that it is made
    with."""
    seen = set() if seen is None else seen
    if isinstance(function, partial):
        return [repr(function.args), repr(function.keywords), *sources(function.func, seen)]
    kind: Any = function if isinstance(function, types.FunctionType | type) else type(function)
    if isinstance(function, types.MethodType):
        kind = function.__func__
    if id(kind) in seen:
        return []
    seen.add(id(kind))
    try:
        texts = [inspect.getsource(kind)]
    except (OSError, TypeError):
        module = inspect.getmodule(kind)
        texts = (
            [inspect.getsource(module)]
            if module is not None and hasattr(module, "__file__")
            else [repr(kind)]
        )
    if kind is not function:  # an object that can be called: its state
        texts.append(repr(sorted(vars(getattr(function, "__self__", function)).items())))
    methods = vars(kind).values() if isinstance(kind, type) else [kind]
    texts += [code_text(one.__code__) for one in methods if isinstance(one, types.FunctionType)]
    if isinstance(kind, types.FunctionType):
        given = [
            *(kind.__defaults__ or ()),
            *(cell.cell_contents for cell in kind.__closure__ or ()),
        ]
        texts += [repr(value) for value in given if not callable(value)]
        for other in (*given, *(kind.__globals__.get(name) for name in names_in(kind.__code__))):
            other = getattr(other, "py_func", other)  # of a compiled function
            if getattr(other, "__module__", "") == kind.__module__ and isinstance(
                other, types.FunctionType | type
            ):
                texts += sources(other, seen)
    return texts


def code_text(code: types.CodeType) -> str:
    """The compiled Python of a function: its source is read when it is asked for, and may have been
    edited since."""
    constants = (
        code_text(one) if isinstance(one, types.CodeType) else stable_repr(one)
        for one in code.co_consts
    )
    return " ".join((code.co_code.hex(), *code.co_names, *constants))


def stable_repr(constant: object) -> str:
    """A constant as text; the order in a set changes from process to process."""
    return repr(sorted(map(repr, constant)) if isinstance(constant, frozenset) else constant)


def names_in(code: types.CodeType) -> list[str]:
    """Names that compiled Python asks its module for, inner functions included."""
    inner = [
        names_in(constant) for constant in code.co_consts if isinstance(constant, types.CodeType)
    ]
    return [*code.co_names, *(name for names in inner for name in names)]
