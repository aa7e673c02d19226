"""The model's parameters, dimensionless, validated once when a scene is made; all other code trusts
them."""

import math
from copy import copy
from dataclasses import asdict, dataclass, field, fields, replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import tomli_w

from rattle.scene import errors, gears_input
from rattle.scene.errors import InputError, suggesting
from rattle.scene.files import in_file, read_text, read_toml
from rattle.scene.gears import DAT21, Gears, change_gears
from rattle.scene.parts import (
    GAPS,
    LEAST_SIZE,
    MEMORY_RANGE,
    SINE_ALONE,
    Order,
    Start,
    Tolerance,
    move_to_flanks,
)
from rattle.scene.text import as_call, as_html
from rattle.scene.types import SINE, Constants, Floats, Orders

Times = TypeVar("Times", float, Floats)
Part = TypeVar("Part")

LARGEST_VALUES = {
    "alpha": 1e6,
    "beta1": 1e4,
    "beta2": 1e4,
    "gamma1": 1e6,
    "gamma2": 1e6,
    "sigma": 1e6,
}
FAR_ORDERS = 8
"""Gap between orders above which the sine of the next one is not computed from that of the last."""
FREE = ("sigma", "tolerance", "start", "stages", "drive", "correlation_time")
"""Fields of a scene that gears do not fix."""
SWEPT = ("alpha", "epsilon", "beta1", "beta2", "gamma1", "gamma2", "mu", "gap1", "gap2", "sigma")
"""Fields that are a number each, over which a sweep may go."""


@suggesting
@dataclass(frozen=True, kw_only=True)
class Scene:
    """A rattling system, its noise, its tolerances and its start (dimensionless).

    ``alpha, gamma1, gamma2, mu, sigma`` and the tolerances are 0 or at least 1e-30: moments of
    smaller values would underflow.

    Parameters
    ----------
    alpha : float
        Excitation amplitude, 0 to 1e6.
    epsilon : float
        Restitution, 0 to 1.
    beta1, beta2 : float
        Damping ratios in flight, 0 to 1e4.
    gamma1, gamma2 : float
        Constant drags, 0 to 1e6.
    mu : float
        Wheel 1's share of the change of the relative velocity at an impact at mesh 2, between 0 and
        1.
    gap1, gap2 : float
        Half gaps, 1e-9 to 1e6.
    sigma : float
        Intensity of the noise that modulates the excitation, 0 to 1e6.
    tolerance : Tolerance, optional
        Random part of the half gaps.
    start : Start, optional
        The paper's start by default: both stages on the positive flank with speed 2, just before an
        impact at mesh 1, at ``tau = 0``.  A coordinate that lies on a nominal flank is placed on
        each path's own flank.
    stages : {2, 1}
        1 is the single-stage rattler: mesh 1 alone; ``beta2, gamma2, mu, gap2`` are then unused.
    drive : sequence of Order, optional
        The driver's motion ``f(tau) = sum_j a_j sin(j tau + phi_j)``, in place of the default ``sin
        tau``.
    correlation_time : float
        Memory of the noise, in units of ``1 / omega``: the modulation is an Ornstein-Uhlenbeck
        process with the spectrum of white noise of the same `sigma` at frequency 0.  0 (white
        noise), or 1e-4 to 1e6.
    gears : Gears, optional
        The physical gears that the scene was made from, by `from_gears`; None once a value that
        gears fix is another.

    Raises
    ------
    InputError
        For any value that is not admissible; names the field, the value and the remedy.

    Examples
    --------
    >>> from rattle.scene import DAT21
    >>> s = Scene.from_gears(DAT21, sigma=0.1)
    >>> round(s.beta1, 6), s.gap2
    (0.083333, 0.5)
    """

    alpha: float
    epsilon: float
    beta1: float
    gamma1: float
    beta2: float = 0.0
    gamma2: float = 0.0
    mu: float = 0.0
    gap1: float = 0.5
    gap2: float = 0.5
    sigma: float = 0.0
    tolerance: Tolerance | None = None
    start: Start = None  # type: ignore[assignment]  # the paper's start, filled in below
    stages: int = 2
    drive: tuple[Order, ...] = SINE_ALONE
    correlation_time: float = 0.0
    gears: Gears | None = field(default=None, compare=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "stages", errors.count("stages", self.stages, least=1, most=2))
        for f in fields(self):
            if f.type is float or f.type == "float":
                object.__setattr__(self, f.name, errors.finite(f.name, getattr(self, f.name)))
        for name, most in LARGEST_VALUES.items():
            least = 0.0 if name.startswith("beta") else LEAST_SIZE
            errors.check_range(name, errors.non_negative(name, getattr(self, name)), least, most)
        errors.unit_interval("epsilon", self.epsilon)
        for name in ("gap1", "gap2"):
            errors.check_range(name, errors.positive(name, getattr(self, name)), *GAPS, zero=False)
        if self.stages == 2 and not 0.0 < self.mu < 1.0:
            raise InputError(
                "mu", self.mu, "two stages need mu = I2 R1^2 / (I1 R2^2 + I2 R1^2), between 0 and 1"
            )
        errors.check_range("mu", self.mu, LEAST_SIZE, 1.0)
        errors.check_range(
            "correlation_time",
            errors.non_negative("correlation_time", self.correlation_time),
            *MEMORY_RANGE,
        )
        self._check_drive()
        self._check_tolerance()
        if self.start is None:
            object.__setattr__(self, "start", Start(0.0, self.gap1, 2.0, self.gap2, 2.0, mesh=1))
        self._check_start()
        if self.gears is not None and any(
            getattr(self, n) != v for n, v in _parameters_of(self.gears).items()
        ):
            object.__setattr__(self, "gears", None)

    def __repr__(self) -> str:
        """Python text that makes the scene, to the last bit, on a few lines; defaults are left
        out."""
        shown = {f.name: getattr(self, f.name) for f in fields(self) if f.repr}
        defaults: dict[str, Any] = {f.name: f.default for f in fields(self)}
        defaults["start"] = Start(0.0, self.gap1, 2.0, self.gap2, 2.0, mesh=1)
        shown = {
            name: value for name, value in shown.items() if repr(value) != repr(defaults[name])
        }
        if self.gears is None:
            return as_call("Scene", shown)
        settings = {name: shown[name] for name in FREE if name in shown}
        return as_call(
            "Scene.from_gears", settings, first="DAT21" if self.gears == DAT21 else repr(self.gears)
        )

    def _repr_html_(self) -> str:
        return as_html(repr(self))

    def _check_drive(self) -> None:
        """Put the orders in ascending order, or say what is wrong with them."""
        try:
            orders = tuple(self.drive)
        except TypeError:
            raise InputError("drive", self.drive, "give a sequence of Order") from None
        for one in orders:
            if not isinstance(one, Order):
                raise InputError("drive", one, "give a sequence of Order")
        numbers = [one.order for one in orders]
        twice = [number for number in numbers if numbers.count(number) > 1]
        if twice:
            raise InputError(
                "drive.order",
                twice[0],
                "is given twice; give one amplitude and phase to each order",
            )
        if not any(one.amplitude for one in orders):
            raise InputError(
                "drive",
                orders,
                "has no order with an amplitude; for a driver at rest give alpha = 0",
            )
        object.__setattr__(self, "drive", tuple(sorted(orders, key=lambda one: one.order)))

    def _check_tolerance(self) -> None:
        if self.tolerance is None:
            return
        if not isinstance(self.tolerance, Tolerance):
            raise InputError("tolerance", self.tolerance, "give a Tolerance")
        for i in range(1, self.stages + 1):
            c = getattr(self.tolerance, f"c{i}_max")
            gap = getattr(self, f"gap{i}")
            if c >= gap:
                raise InputError(
                    f"tolerance.c{i}_max", c, f"must be below gap{i} = {gap}, or a gap could close"
                )

    def _check_start(self) -> None:
        start = self.start
        if not isinstance(start, Start):
            raise InputError("start", start, "give a Start")
        if start.mesh > self.stages:
            raise InputError("start.mesh", start.mesh, "a single-stage scene has mesh 1 only")
        for i in range(1, self.stages + 1):
            x = getattr(start, f"x{i}")
            y = getattr(start, f"y{i}")
            gap = getattr(self, f"gap{i}")
            c_max = getattr(self.tolerance, f"c{i}_max") if self.tolerance else 0.0
            on_flank = abs(x) == gap
            if abs(x) > gap - c_max and not on_flank:
                raise InputError(
                    f"start.x{i}", x, f"must lie on a flank (+-{gap}) or inside +-{gap - c_max}"
                )
            if start.mesh == i and not (on_flank and x * np.sign(y) > 0.0):
                why = (
                    f"an impact at mesh {i} needs x{i} = +-{gap} and y{i} outward; given x{i} ="
                    f" {x}, y{i} = {y}"
                )
                raise InputError("start.mesh", start.mesh, why)
            if start.mesh == 0 and on_flank and x * np.sign(y) >= 0.0:
                raise InputError(
                    f"start.y{i}",
                    y,
                    f"a start in flight on a flank must move inward, or give mesh={i}",
                )

    @classmethod
    def from_gears(cls, gears: Gears, **settings: Any) -> "Scene":
        """The scene of a physical gear pair.

        Parameters
        ----------
        gears : Gears
            Physical data.
        **settings
            The fields of Scene that gears do not fix: `sigma`, `tolerance`, `start`, `stages`,
            `drive`, `correlation_time`.

        Returns
        -------
        Scene
            With `gears` kept.

        Raises
        ------
        InputError
            For a field that gears fix, or a value that is not admissible; names a field of the
            gears where the value follows from them.

        Examples
        --------
        >>> from rattle.scene import DAT21
        >>> Scene.from_gears(DAT21, sigma=0.1, stages=1).stages
        1
        """
        errors.check_keys("Scene.from_gears", settings, FREE)
        fixed = _parameters_of(gears)
        if gears.wheels == 1 and settings.get("stages", 2) == 2:
            raise InputError(
                "stages", 2, "these gears have no wheel 2: give stages = 1, or inertia2 and radius2"
            )
        try:
            return cls(gears=gears, **fixed, **settings)
        except InputError as error:
            raise gears_input.of_gears(gears, error) from None

    def with_sigma(self, sigma: float) -> "Scene":
        """The same scene at another noise intensity.

        Parameters
        ----------
        sigma : float
            Noise intensity.

        Returns
        -------
        Scene
            With everything else unchanged.

        Raises
        ------
        InputError
            If `sigma` is out of range.
        """
        return replace(self, sigma=sigma)

    def with_gears(self, **changes: float) -> "Scene":
        """The same scene with other values of its gears.

        All other values stay as they were typed, and the driver moves as before, in mm: a larger
        ``backlash1`` makes a smaller `alpha`.  Noise intensity, correlation time, drive and start
        are kept, tolerances in mm; a start on a flank stays on it.

        Parameters
        ----------
        **changes : float
            Values by name, in the unit of `Gears` and `Gears.driven`: those that the gears were
            given by, ``amplitude`` (mm) or ``alpha``.

        Returns
        -------
        Scene
            With the changed gears as its `gears`.

        Raises
        ------
        InputError
            If the scene has no gears, the gears have no such value, or a value is not admissible.

        Examples
        --------
        >>> from rattle.scene import DAT21
        >>> wide = Scene.from_gears(DAT21, sigma=0.1).with_gears(backlash1=0.4, torque1=50.0)
        >>> round(wide.alpha, 6), round(wide.gears.amplitude, 6), wide.sigma
        (0.75, 0.3, 0.1)
        """
        if self.gears is None:
            why = "this scene was not made from gears; use Scene.from_gears, or a file with [gears]"
            raise InputError("gears", None, why)
        gears = change_gears(self.gears, changes)
        settings = {name: getattr(self, name) for name in FREE}
        if self.tolerance is not None:
            unit = self.gears.backlash1 / gears.backlash1  # old unit of length over the new one
            widths = {name: unit * getattr(self.tolerance, name) for name in ("c1_max", "c2_max")}
            settings["tolerance"] = replace(self.tolerance, **widths)
        if gears.wheels == 2:
            gaps = (self.gap1, gears.gap2)
            settings["start"] = move_to_flanks(self.start, (self.gap1, self.gap2), gaps)
        return Scene.from_gears(gears, **settings)

    def scaled(self, factor: float) -> "Scene":
        """The same system in another unit of length.

        All lengths, speeds and accelerations are multiplied by `factor`.  The motion is the same
        but for that factor, to rounding, and bit for bit if the factor is a power of two.  So the
        result is not validated again: its lengths may be outside the admissible ranges.

        Parameters
        ----------
        factor : float
            Old unit of length over the new one.

        Returns
        -------
        Scene
            Without `gears`.

        Examples
        --------
        >>> from rattle.scene import DAT21
        >>> s = Scene.from_gears(DAT21, sigma=0.1).scaled(2.0)
        >>> s.alpha, s.gap1, s.sigma, s.start.y1, s.beta1 == DAT21.beta(1)
        (3.0, 1.0, 0.2, 4.0, True)
        """
        s = self.start
        t = self.tolerance
        state = {name: factor * getattr(s, name) for name in ("x1", "y1", "x2", "y2")}
        lengths = {
            n: factor * getattr(self, n)
            for n in ("alpha", "gamma1", "gamma2", "gap1", "gap2", "sigma")
        }
        tolerance = t and _copy_with(t, c1_max=factor * t.c1_max, c2_max=factor * t.c2_max)
        return _copy_with(
            self, **lengths, start=_copy_with(s, **state), tolerance=tolerance, gears=None
        )

    @property
    def phase(self) -> float:
        """Phase of the start, in [-pi, pi], to full precision however late the start is.

        Closures and simulation compute in local time, which starts at this phase, so that a late
        start loses no digits. Results are reported in absolute time, which starts at ``start.tau``;
        `to_absolute_time` and `to_local_time` convert.

        Examples
        --------
        >>> from rattle.scene import DAT21
        >>> Scene.from_gears(DAT21, start=Start(1e12, 0.5, 2.0, 0.5, 2.0, mesh=1)).phase
        -0.6576247591367865
        """
        tau = self.start.tau
        return tau if abs(tau) <= math.pi else math.atan2(math.sin(tau), math.cos(tau))

    @property
    def phase_reduced(self) -> "Scene":
        """The same scene started at its `phase`: shifted by a whole number of periods of the
        excitation."""
        if self.phase == self.start.tau:
            return self
        return _copy_with(self, start=_copy_with(self.start, tau=self.phase))

    def to_absolute_time(self, time: Times) -> Times:
        """Convert local time to absolute time (see `phase`), as exactly as a float can hold it.

        Parameters
        ----------
        time : float or ndarray
            Local time.

        Returns
        -------
        float or ndarray
            Absolute time.

        Examples
        --------
        >>> from rattle.scene import DAT21
        >>> s = Scene.from_gears(DAT21, start=Start(1e12, 0.5, 2.0, 0.5, 2.0, mesh=1))
        >>> s.to_absolute_time(s.phase + 0.25), s.to_local_time(1e12 + 0.25) == s.phase + 0.25
        (1000000000000.25, True)
        """
        return time if self.phase == self.start.tau else self.start.tau + (time - self.phase)

    def to_local_time(self, time: Times) -> Times:
        """Convert absolute time to local time (see `phase`).

        Parameters
        ----------
        time : float or ndarray
            Absolute time.

        Returns
        -------
        float or ndarray
            Local time.
        """
        return time if self.phase == self.start.tau else self.phase + (time - self.start.tau)

    @property
    def noise_free(self) -> "Scene":
        """The same scene without noise and without random tolerance: the deterministic system."""
        tolerance = (
            self.tolerance
            if self.tolerance is not None and self.tolerance.distribution == "fixed"
            else None
        )
        return _copy_with(self, sigma=0.0, tolerance=tolerance)

    @property
    def constants(self) -> Constants:
        """The numbers of the scene for compiled code; a fixed tolerance is part of the walls."""
        fixed = self.tolerance is not None and self.tolerance.distribution == "fixed"
        wall1, wall2 = self.windows if fixed else (self.gap1, self.gap2)
        values = {
            name: getattr(self, name)
            for name in ("alpha", "epsilon", "beta1", "gamma1", "sigma", "stages")
        }
        values |= {
            name: getattr(self, name) if self.stages == 2 else 0.0
            for name in ("beta2", "gamma2", "mu")
        }
        return Constants(
            **values, wall1=wall1, wall2=wall2, drive=self._orders, memory=self.correlation_time
        )

    @property
    def _orders(self) -> Orders | tuple[()]:
        """The drive for compiled code."""
        moving = tuple(one for one in self.drive if one.amplitude)
        if moving == SINE_ALONE:
            return SINE
        j = np.array([one.order for one in moving])
        a, phase = (
            np.array([getattr(one, name) for one in moving]) for name in ("amplitude", "phase")
        )
        gap = np.diff(j, prepend=0)
        order = j.astype(float)
        most1, most2, most3 = (float((abs(a) * order**n).sum()) for n in (1, 2, 3))
        odd, even = (
            a * np.array([turn(p) for p in phase.tolist()]) for turn in (math.cos, math.sin)
        )
        gap = np.where(gap > FAR_ORDERS, 0, gap)
        waves = np.empty((2, len(j)))
        return Orders(order, gap, odd, even, order[-1], most1, most2, most3, waves)

    @property
    def windows(self) -> tuple[float, float]:
        """Half widths ``g_i + c_i_max`` of the windows of Eqs. 20 and 21, a pair of floats."""
        c1, c2 = (self.tolerance.c1_max, self.tolerance.c2_max) if self.tolerance else (0.0, 0.0)
        return self.gap1 + c1, self.gap2 + c2

    @property
    def start_state(self) -> tuple[float, float, float, float]:
        """``(x1, y1, x2, y2)`` of the start, with a coordinate on a nominal flank moved to the wall
        of `constants`."""
        s = self.start
        k = self.constants
        x1 = math.copysign(k.wall1, s.x1) if abs(s.x1) == self.gap1 else s.x1
        x2 = math.copysign(k.wall2, s.x2) if abs(s.x2) == self.gap2 else s.x2
        return x1, s.y1, x2, s.y2

    def to_dict(self) -> dict[str, Any]:
        """The scene as plain data, for TOML files and manifests; in the gear form where it was made
        from gears.

        Returns
        -------
        dict
            With a table ``scene``, ``gears`` in the gear form, and ``drive`` where it is not the
            sine alone.
        """
        values = {
            f.name: getattr(self, f.name) for f in fields(self) if f.name not in ("gears", "drive")
        }
        for name in ("tolerance", "start"):
            values[name] = values[name] and asdict(values[name])
        for name in ("tolerance", "correlation_time"):
            if not values[name]:
                del values[name]
        drive = {} if self.drive == SINE_ALONE else {"drive": [asdict(one) for one in self.drive]}
        if self.gears is None:
            return drive | {"scene": values}
        return (
            {"gears": self.gears.values}
            | drive
            | {"scene": {k: v for k, v in values.items() if k in FREE}}
        )

    @classmethod
    def from_dict(cls, data: dict[str, Any]) -> "Scene":
        """A scene from the form that `to_dict` gives.

        Parameters
        ----------
        data : dict
            Tables ``scene`` and, in the gear form, ``gears``, and the list ``drive``;
            ``rattle.scene.gears_input`` says what these may hold.

        Returns
        -------
        Scene
            Validated.

        Raises
        ------
        InputError
            For unknown or missing keys and values that are not admissible.
        """
        errors.check_keys("top level", _table("scene", data), ("gears", "scene", "drive"))
        data = gears_input.take_measured(data)
        settings = _table("scene", data.get("scene", {}))
        if "drive" in settings:
            raise InputError(
                "scene.drive",
                settings["drive"],
                "write each order as a table [[drive]] beside [scene]",
            )
        for name, kind in {"tolerance": Tolerance, "start": Start}.items():
            if name in settings:
                table = _table(f"scene.{name}", settings[name])
                errors.check_keys(f"scene.{name}", table, (f.name for f in fields(kind)))
                settings[name] = kind(**table)
        if "gears" in data:
            gears = gears_input.own_amplitude(_table("gears", data["gears"]), data.get("drive"))
            errors.check_keys("scene", settings, FREE)
            pair = gears_input.read_gears(gears, settings.get("stages", 2))
            drawn = gears_input.read_tolerance(gears, pair)
            if drawn is not None:
                if "tolerance" in settings:
                    raise InputError(
                        "gears.tolerance",
                        drawn,
                        "give it once: here in mm, or in [scene.tolerance]",
                    )
                settings["tolerance"] = Tolerance(**drawn)
            if "drive" in data:
                settings["drive"] = gears_input.read_drive(
                    data["drive"], pair, gears.get("driver_radius")
                )
            return cls.from_gears(pair, **settings)
        errors.check_keys("scene", settings, (f.name for f in fields(cls) if f.name != "gears"))
        if missing := [
            name for name in ("alpha", "epsilon", "beta1", "gamma1") if name not in settings
        ]:
            raise InputError("scene", missing, "these keys are missing")
        if "drive" in data:
            settings["drive"] = gears_input.read_drive(data["drive"])
        return cls(**settings)

    def to_toml(self) -> str:
        """The scene as TOML text; `from_toml` gives the same scene back, to the last bit.

        Returns
        -------
        str
            TOML text.
        """
        return tomli_w.dumps(self.to_dict())

    @classmethod
    def from_toml(cls, text: str) -> "Scene":
        """A scene from TOML text.

        Parameters
        ----------
        text : str
            With a ``[scene]`` table; or ``[gears]``, and ``[scene]`` with the fields that gears do
            not fix.  Each order of the drive is a table ``[[drive]]``.

        Returns
        -------
        Scene
            Validated.

        Raises
        ------
        InputError
            For text that is not TOML (a FileError) and whatever `from_dict` refuses.
        """
        return cls.from_dict(read_toml(text))

    @classmethod
    def load(cls, path: str | Path) -> "Scene":
        """A scene from a TOML file.

        Parameters
        ----------
        path : str or Path
            The file.

        Returns
        -------
        Scene
            Validated.

        Raises
        ------
        FileError
            If the file cannot be read.
        InputError
            If its content is not admissible, or its gears cannot exist
            (``rattle.scene.gears_input``); names the file, and the line and key where they are
            known.
        """
        text = read_text("scene file", path)
        with in_file(path, text):
            data = gears_input.find_measured(read_toml(text), Path(path).parent)
            scene = cls.from_dict(data)
            if scene.gears is not None:
                gears_input.check_plausible(scene.gears, data["gears"])
        return scene


def _parameters_of(gears: Gears) -> dict[str, Any]:
    """The parameters of the model that gears fix (docs/model.md section 1)."""
    if not isinstance(gears, Gears):
        raise InputError("gears", gears, "give Gears")
    found: dict[str, Any] = {"alpha": gears.alpha, "epsilon": gears.epsilon, "gap1": 0.5}
    for wheel in range(1, gears.wheels + 1):
        found |= {f"beta{wheel}": gears.beta(wheel), f"gamma{wheel}": gears.gamma(wheel)}
    return found if gears.wheels == 1 else found | {"mu": gears.mu, "gap2": gears.gap2}


def _copy_with(part: Part, **changes: Any) -> Part:
    """A copy with changes that need no validation."""
    changed = copy(part)
    changed.__dict__.update(changes)
    return changed


def _table(name: str, value: object) -> dict[str, Any]:
    if not isinstance(value, dict):
        raise InputError(name, value, f"write it as a table: [{name}]")
    return dict(value)


def check_scene(scene: object) -> None:
    """Check that what was given as a scene is one."""
    if not isinstance(scene, Scene):
        raise InputError("scene", scene, "give a Scene")
