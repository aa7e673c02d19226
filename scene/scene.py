"""The model's parameters, dimensionless, validated once when a scene is made; all other code trusts
them."""

import math
from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import tomli_w

from rattle.scene import errors, gears_input
from rattle.scene.errors import InputError, suggesting
from rattle.scene.files import in_file, read_text, read_toml
from rattle.scene.gears import DAT21, Gears, change_gears
from rattle.scene.noise import DRIVE_NOISE, NoiseSources, list_sources, read_noise
from rattle.scene.parts import (
    GAPS,
    LEAST_SIZE,
    MEMORY_RANGE,
    SINE_ALONE,
    TWO_STATES,
    Order,
    Start,
    Tolerance,
    Wheel,
    fields_of,
    find_parents,
    move_to_flanks,
    wheel_labels,
)
from rattle.scene.scene_checks import (
    are_in_a_row,
    check_springs,
    check_start,
    check_tolerance,
    of_wheel,
    short_form,
    sort_orders,
)
from rattle.scene.scene_tables import FREE_FIELDS, SHORT, read_tables, write_tables
from rattle.scene.text import as_call, as_html
from rattle.scene.types import Constants, Facts, Floats, Wheels
from rattle.scene.words import BODIES, GEARBOX, PAIR, Words

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
CACHED = ("tree", "_compiled_wheels", "law", "noise_sources")
"""What a scene computes once and keeps."""
UNRELATED = {"sigma", "start"}
"""Fields whose change leaves that as it is."""
PLAIN_WHEEL = Wheel(beta=0.0, gamma=0.0)


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
        Intensity of the noise, 0 to 1e6.
    tolerance : Tolerance, optional
        Random part of the half gaps.
    start : Start, optional
        The paper's start by default: both stages on the positive flank with speed 2, just before an
        impact at mesh 1, at ``tau = 0``.  A coordinate that lies on a nominal flank is placed on
        each path's own flank.
    stages : int
        Number of loose wheels.  2, or 1 for the single-stage rattler: mesh 1 alone; ``beta2,
        gamma2, mu, gap2`` are then unused.  Where `wheels` are given it is their number.
    drive : sequence of Order, optional
        The driver's motion ``f(tau) = sum_j a_j sin(j tau + phi_j)``, in place of the default ``sin
        tau``.
    correlation_time : float
        Memory of the noise, in units of ``1 / omega``: it is an Ornstein-Uhlenbeck process with
        the spectrum of white noise of the same `sigma` at frequency 0.  0 (white noise), or 1e-4
        to 1e6; of several noises each is white.
    noise : str, int or dict
        What the noise acts on: ``drive``, which it modulates, or the name or number of a wheel or
        body, on which it is a random force: ``sigma`` times white noise is added to its
        acceleration.  Of several independent noises a table: the name or number of each, with its
        intensity in units of `sigma`, 0 to 1e6; that of the drive is 1.
    wheels : sequence of Wheel, optional
        The loose wheels of a gearbox, 1 to 32, each after the one that it meshes with; in place of
        ``beta1, gamma1, beta2, gamma2, mu, gap1, gap2``.  `epsilon` is then that of the wheels
        that have none of their own, and is not needed where all have.  One or two wheels in a row
        become the short form.
    bodies : bool
        Whether answers and pages call the wheels bodies, and their meshes contacts; they do so by
        themselves where the scene cannot be gears.
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

    Two loose wheels on the driver, the second with another radius of the driver there:

    >>> pair = [Wheel(beta=0.1, gamma=0.3), Wheel(beta=0.2, gamma=0.2, mass=0.5, ratio=1.2)]
    >>> Scene(alpha=2.0, epsilon=0.8, wheels=pair).stages
    2
    """

    alpha: float
    epsilon: float = None  # type: ignore[assignment]  # of the wheels, where these are given
    beta1: float = None  # type: ignore[assignment]  # beta1, gamma1: needed without wheels
    gamma1: float = None  # type: ignore[assignment]
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
    noise: NoiseSources = DRIVE_NOISE
    wheels: tuple[Wheel, ...] = ()
    bodies: bool = False
    gears: Gears | None = field(default=None, compare=False, repr=False)

    def __post_init__(self) -> None:
        if not isinstance(self.wheels, Sequence):
            raise InputError("wheels", self.wheels, "give a sequence of Wheel")
        for wheel in self.wheels:
            if not isinstance(wheel, Wheel):
                raise InputError("wheels", wheel, "give a sequence of Wheel")
        if self.gears is not None:
            self._check_gears()
        are_gears = self.is_gears or self.gears is not None
        object.__setattr__(self, "bodies", bool(self.bodies) or not are_gears)
        with (BODIES if self.bodies else PAIR).in_errors():
            self._validate()

    def _validate(self) -> None:
        """Check all fields, as floats where they are numbers, and fill in what follows from
        others."""
        if self.wheels:
            self._take_wheels()
        else:
            object.__setattr__(self, "stages", errors.count("stages", self.stages, 1, 2))
            for name in ("epsilon", "beta1", "gamma1"):
                if getattr(self, name) is None:
                    raise InputError(name, None, "is needed, or give wheels")
        for f in fields(self):
            if f.type is float:
                object.__setattr__(self, f.name, errors.finite(f.name, getattr(self, f.name)))
        for name, most in LARGEST_VALUES.items():
            least = 0.0 if name.startswith("beta") else LEAST_SIZE
            errors.non_negative(name, getattr(self, name), least, most)
        errors.unit_interval("epsilon", self.epsilon)
        for name in ("gap1", "gap2"):
            errors.positive(name, getattr(self, name), *GAPS)
        if self.stages == 2 and not self.wheels and not 0.0 < self.mu < 1.0:
            raise InputError(
                "mu", self.mu, "two stages need mu = I2 R1^2 / (I1 R2^2 + I2 R1^2), between 0 and 1"
            )
        errors.check_range("mu", self.mu, LEAST_SIZE, 1.0)
        errors.non_negative("correlation_time", self.correlation_time, *MEMORY_RANGE)
        object.__setattr__(self, "drive", sort_orders(self.drive))
        check_springs(self.tree)
        for label, wheel in zip(self.wheel_names, self.tree, strict=True):
            with of_wheel(label):
                _ = wheel.law  # refuses one that does not fit its epsilon
        self._check_noise()
        check_tolerance(self.tolerance, self.tree, not self.wheels)
        if self.start is None:
            object.__setattr__(self, "start", self._default_start)
        check_start(self.start, self.tree)

    def _check_gears(self) -> None:
        """Keep the gears only as long as all that they fix is theirs."""
        if not isinstance(self.gears, Gears):
            raise InputError("gears", self.gears, "give Gears")
        for name, value in self.gears.parameters.items():
            given = getattr(self, name)
            if not (np.isscalar(given) or isinstance(given, tuple)) or given != value:
                object.__setattr__(self, "gears", None)
                return

    def __repr__(self) -> str:
        """Python text that makes the scene, to the last bit, on a few lines; defaults are left
        out."""
        shown = fields_of(self, "gears")
        if isinstance(self.noise, tuple):
            shown["noise"] = dict(self.noise)
        defaults: Facts = {f.name: f.default for f in fields(self)}
        defaults["start"] = self._default_start
        defaults["bodies"] = not self.is_gears
        if self.wheels:
            defaults |= {"stages": self.stages} | SHORT
        shown = {
            name: value for name, value in shown.items() if repr(value) != repr(defaults[name])
        }
        if self.gears is None:
            return as_call("Scene", shown)
        settings = {name: shown[name] for name in FREE_FIELDS if name in shown}
        return as_call(
            "Scene.from_gears", settings, first="DAT21" if self.gears == DAT21 else repr(self.gears)
        )

    def _repr_html_(self) -> str:
        return as_html(repr(self))

    def _check_noise(self) -> None:
        """Check that the noise acts on something that the scene has."""
        object.__setattr__(self, "noise", read_noise(self.noise, self.wheel_names))
        if self.correlation_time and len(self.noise_sources) > 1:
            why = "of several noises each is white, 0; a single one may have a memory"
            raise InputError("correlation_time", self.correlation_time, why)

    @property
    def noisy_wheel(self) -> int:
        """Number of the wheel or body on which the first noise is a random force; 0 where it
        modulates the drive.

        Examples
        --------
        >>> ball = Wheel(beta=0.0, gamma=1.0, one_sided=True, name="ball")
        >>> Scene(alpha=0.0, epsilon=0.8, wheels=[ball], noise="ball").noisy_wheel
        1
        """
        return self.noise_sources[0][0]

    @cached_property
    def noise_sources(self) -> list[tuple[int, float]]:
        """What each independent noise acts on, the number of a wheel or 0 for the drive, and its
        intensity over `sigma`; in ascending order.

        Examples
        --------
        >>> ball = Wheel(beta=0.0, gamma=1.0, one_sided=True, name="ball")
        >>> noise = {"drive": 1.0, "ball": 0.3}
        >>> Scene(alpha=2.0, epsilon=0.8, wheels=[ball], noise=noise).noise_sources
        [(0, 1.0), (1, 0.3)]
        """
        return list_sources(self.noise, self.wheel_names)

    def _take_wheels(self) -> None:
        """Check the wheels of a gearbox; one or two in a row become the short form."""
        given = tuple(self.wheels)
        for name, unused in SHORT.items():
            if getattr(self, name) not in (None, unused):
                raise InputError(name, getattr(self, name), "give it, or wheels; not both")
            object.__setattr__(self, name, unused)
        parents = find_parents(given, "parent")
        for label, wheel in zip(wheel_labels(given), given, strict=True):
            if wheel.epsilon is None and self.epsilon is None:
                why = "give it one, or the scene"
                raise InputError(f"wheel.{label}.epsilon", None, why)
        given = tuple(replace(w, parent=p) for w, p in zip(given, parents, strict=True))
        first = given[0].mass
        if first != 1.0:
            given = tuple(replace(wheel, mass=wheel.mass / first) for wheel in given)
        if any(wheel.tolerance for wheel in given) and self.tolerance is None:
            object.__setattr__(self, "tolerance", Tolerance())
        if self.epsilon is None:
            object.__setattr__(self, "epsilon", given[0].epsilon)
        values = {"wheels": given, "stages": len(given)}
        if self.gears is None and are_in_a_row(given, self.epsilon):
            values |= short_form(given, self.tolerance)
        vars(self).update(values)

    @cached_property
    def tree(self) -> tuple[Wheel, ...]:
        """The loose wheels, each with its number of the parent, its restitution and its tolerance.

        Examples
        --------
        >>> from rattle.scene import DAT21
        >>> [wheel.parent for wheel in Scene.from_gears(DAT21).tree]
        [0, 1]
        """
        if self.wheels:
            return tuple(
                wheel if wheel.epsilon is not None else _copy_with(wheel, epsilon=self.epsilon)
                for wheel in self.wheels
            )
        tolerance = self.tolerance or Tolerance()
        first = _copy_with(
            PLAIN_WHEEL,
            beta=self.beta1,
            gamma=self.gamma1,
            gap=self.gap1,
            epsilon=self.epsilon,
            tolerance=tolerance.c1_max,
        )
        if self.stages == 1:
            return (first,)
        second = _copy_with(
            first,
            beta=self.beta2,
            gamma=self.gamma2,
            gap=self.gap2,
            mass=self.mu / (1.0 - self.mu),
            parent=1,
            tolerance=tolerance.c2_max,
        )
        return first, second

    @property
    def is_gears(self) -> bool:
        """Whether it is loose gears: every body has two walls and no spring, and noise modulates
        the drive."""
        free = not any(wheel.one_sided or wheel.stiffness for wheel in self.wheels)
        # asked before the noise is checked: it may be a name or any table of them
        return free and repr(DRIVE_NOISE) in repr(self.noise)

    @property
    def words(self) -> Words:
        """What its parts are called in answers, pages and figures.

        Examples
        --------
        >>> ball = Wheel(gamma=1.0, one_sided=True, name="ball")
        >>> Scene(alpha=0.0, epsilon=0.8, wheels=[ball]).words.mesh
        'contact'
        """
        if self.bodies:
            return BODIES
        return PAIR if self.stages <= 2 else GEARBOX

    @property
    def wheel_names(self) -> tuple[str, ...]:
        """What a person calls each loose wheel: its name, or its number.

        Examples
        --------
        >>> pair = [Wheel(beta=0.1, gamma=0.3, name="shaft"), Wheel(beta=0.1, gamma=0.2, parent=1)]
        >>> Scene(alpha=2.0, epsilon=0.8, wheels=pair).wheel_names
        ('shaft', '2')
        """
        return wheel_labels(self.tree)

    @property
    def half_gaps(self) -> tuple[float, ...]:
        """The half gaps of all wheels, and of a single stage that of the unused mesh 2 too."""
        return tuple(wheel.gap for wheel in self.wheels) or (self.gap1, self.gap2)

    @property
    def _default_start(self) -> Start:
        """The paper's start: all wheels on the positive flank with speed 2, just before an impact
        at mesh 1."""
        if not self.wheels:
            return Start(0.0, self.gap1, 2.0, self.gap2, 2.0, mesh=1)
        state = [value for wheel in self.wheels for value in (wheel.gap, 2.0)]
        return Start(0.0, state=tuple(state), mesh=1)

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
        errors.check_keys("Scene.from_gears", settings, FREE_FIELDS)
        if not isinstance(gears, Gears):
            raise InputError("gears", gears, "give Gears")
        is_single = len(gears.tree) == 1 and not gears.wheels
        if is_single and settings.get("stages", 2) == 2:
            raise InputError(
                "stages", 2, "these gears have no wheel 2: give stages = 1, or inertia2 and radius2"
            )
        try:
            return cls(gears=gears, **gears.parameters, **settings)
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
            given by, ``amplitude`` (mm) or ``alpha``.  Those of wheel 3 are ``torque3`` or, as in
            ``**{"wheel.third.torque": 50.0}``, by its name.

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
        settings = {name: getattr(self, name) for name in FREE_FIELDS}
        if self.tolerance is not None:
            # old unit of length over the new one
            unit = self.gears.units.length / gears.units.length
            widths = {name: unit * getattr(self.tolerance, name) for name in ("c1_max", "c2_max")}
            settings["tolerance"] = replace(self.tolerance, **widths)
        gaps = [gears.gap(number) for number in range(1, len(gears.tree) + 1)]
        settings["start"] = move_to_flanks(self.start, self.half_gaps[: len(gaps)], gaps)
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
        state: Facts = {n: factor * getattr(s, n) for n in TWO_STATES}
        state["state"] = tuple(factor * value for value in s.state)
        wheels = tuple(
            _copy_with(
                w,
                gamma=factor * w.gamma,
                gap=factor * w.gap,
                tolerance=factor * w.tolerance,
                restitution=w.restitution and w.restitution.scaled(factor),
            )
            for w in self.wheels
        )
        lengths = {
            n: factor * getattr(self, n)
            for n in ("alpha", "gamma1", "gamma2", "gap1", "gap2", "sigma")
        }
        tolerance = t and _copy_with(t, c1_max=factor * t.c1_max, c2_max=factor * t.c2_max)
        start = _copy_with(s, **state)
        parts = {"start": start, "tolerance": tolerance, "wheels": wheels, "gears": None}
        return _copy_with(self, **lengths, **parts)

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
        """The same scene without noise, random tolerance and random restitution: the deterministic
        system."""
        changes: Facts = {"sigma": 0.0}
        if any(wheel.law.sd for wheel in self.tree):
            changes["wheels"] = tuple(wheel.with_mean_restitution for wheel in self.tree)
        if self.tolerance is not None and self.tolerance.distribution != "fixed":
            changes["tolerance"] = None
            given = changes.get("wheels", self.wheels)
            changes["wheels"] = tuple(_copy_with(wheel, tolerance=0.0) for wheel in given)
        return _copy_with(self, **changes)

    @property
    def constants(self) -> Constants:
        """The numbers of the scene for compiled code; a fixed tolerance is part of the walls."""
        # here, for it loads numba, which --help has no use for
        from rattle.scene.scene_constants import compile_orders

        return Constants(
            self.alpha,
            self.sigma,
            self._compiled_wheels,
            compile_orders(self.drive),
            self.correlation_time,
            0.0 if self.noisy_wheel else 1.0,
        )

    @cached_property
    def _compiled_wheels(self) -> Wheels:
        """The wheels for compiled code, which only reads them."""
        from rattle.scene.scene_constants import compile_wheels

        fixed = self.tolerance is not None and self.tolerance.distribution == "fixed"
        return compile_wheels(self.tree, fixed, self.noise_sources, self.drive)

    @property
    def differs_by_set(self) -> bool:
        """Whether every gear set has backlashes of its own, for good."""
        tolerance = self.tolerance
        if tolerance is None or tolerance.draw != "path" or tolerance.distribution == "fixed":
            return False
        return any(wheel.tolerance > 0.0 for wheel in self.tree)

    @property
    def windows(self) -> tuple[float, ...]:
        """Half widths ``g_i + c_i_max`` of the windows of Eqs. 20 and 21, a tuple of floats."""
        return tuple(wheel.gap + wheel.tolerance for wheel in self.tree)

    @property
    def start_state(self) -> Floats:
        """``(x1, y1, ...)`` of the start, with a coordinate on a nominal flank moved to the wall of
        `constants`.

        Shapes: result (2 wheels,).
        """
        walls = self.constants.wheels["wall"]
        state = np.array(self.start.values[: 2 * self.stages])
        for i, wheel in enumerate(self.tree):
            side = wheel.side_of(state[2 * i])
            state[2 * i] = side * walls[i] if side else state[2 * i]
        return state

    def to_dict(self) -> Facts:
        """The scene as plain data, for TOML files and manifests; in the gear form where it was made
        from gears.

        Returns
        -------
        dict
            With a table ``scene``, ``gears`` in the gear form and the list ``wheel`` where it has
            any number of wheels, ``body`` where it is no gears, and ``drive`` where it is not the
            sine alone.
        """
        return write_tables(fields_of(self), self.is_gears)

    @classmethod
    def from_dict(cls, data: Facts) -> "Scene":
        """A scene from the form that `to_dict` gives.

        Parameters
        ----------
        data : dict
            Tables ``scene`` and, in the gear form, ``gears``, and the lists ``wheel``, ``body``
            and ``drive``; ``rattle.scene.gears_input`` says what these may hold.

        Returns
        -------
        Scene
            Validated.

        Raises
        ------
        InputError
            For unknown or missing keys and values that are not admissible.
        """
        gears, settings = read_tables(data, [f.name for f in fields(cls)])
        return cls(**settings) if gears is None else cls.from_gears(gears, **settings)

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
            not fix.  Each of more than two loose wheels is a table ``[[wheel]]``, each body that is
            no gear wheel a table ``[[body]]``, and each order of the drive a table ``[[drive]]``.

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


def _copy_with(part: Part, **changes: Any) -> Part:
    """A copy with changes that need no validation."""
    changed = copy(part)
    if not changes.keys() <= UNRELATED:
        for name in CACHED:
            changed.__dict__.pop(name, None)
    changed.__dict__.update(changes)
    return changed


def check_scene(scene: object) -> None:
    """Check that what was given as a scene is one."""
    if not isinstance(scene, Scene):
        raise InputError("scene", scene, "give a Scene")


def check_each_impact(scene: Scene) -> None:
    """Refuse a restitution that differs from path to path, where only the mean over impacts is
    known."""
    if any(wheel.law.sd and wheel.law.draw == "path" for wheel in scene.tree):
        why = "only simulated impacts can have a restitution by path here; give draw = 'contact'"
        raise InputError("restitution.draw", "path", why)
