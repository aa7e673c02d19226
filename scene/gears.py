"""Loose gears in physical units (mm, kg, N, s), and the only conversion of units (Eqs. 1-3)."""

import math
from collections.abc import Sequence
from dataclasses import InitVar, dataclass, replace
from typing import Any, ClassVar

from rattle.scene.drag import DRAG_TABLES, DragLaw, drag_at
from rattle.scene.errors import (
    InputError,
    check_keys,
    non_negative,
    positive,
    suggesting,
)
from rattle.scene.loose_wheel import (
    GEAR_VALUES,
    WHEEL_KINDS,
    LooseWheel,
    check_value,
    ratios_of,
    read_wheels,
    spell_value,
    value_name,
)
from rattle.scene.parts import Wheel, are_given, fields_of, find_parents, wheel_labels
from rattle.scene.text import as_call
from rattle.scene.types import Facts
from rattle.scene.units import Units

KG_MM_PER_S2_PER_N = 1000.0  # 1 N = 1000 kg mm / s^2
DRIVES = ("alpha", "amplitude", "amplitude_rad")
"""The ways to give the drive; just one of them."""
SPEEDS = {"speed_rpm": 2.0 * math.pi / 60.0, "speed_rad_s": 1.0}
"""The ways to give the mean speed of the driver, at most one of them, and their units in rad/s."""
WHEEL2 = ("inertia2", "radius2")
"""What a second wheel must have."""
NUMBERED = tuple(f"{kind}{number}" for kind in WHEEL_KINDS for number in (1, 2))
"""Fields of one or two wheels in a row, which gears given as `wheels` have no use for."""


@suggesting
@dataclass(frozen=True, kw_only=True)
class Gears:
    """Physical data of the driver and its loose wheels.

    One or two wheels in a row are given by numbered values, any number of them up to 32 as
    `wheels`.

    `driven` takes the amplitude of the driver's motion in place of `alpha`, and the mean speed.
    All dimensional values are at most 1e12 in the units below; frequency, inertias, radii and
    backlashes are at least 1e-12.

    ``dataclasses.replace`` leaves everything else as it was typed: of a drive that was given in mm
    or rad another ``backlash1`` makes another ``alpha``, and with ``alpha`` given another motion; a
    mean speed is counted in again.

    Parameters
    ----------
    alpha : float
        Excitation amplitude ``R_e a / backlash1`` (dimensionless).
    epsilon : float
        Restitution of all meshes (dimensionless, 0 to 1); of `wheels`, of those that have none of
        their own.
    omega : float
        Excitation frequency in rad/s.
    inertia1, inertia2 : float
        Moments of inertia of the wheels in kg mm^2; without a second wheel `inertia2` and `radius2`
        are left out.
    radius1, radius2 : float
        Base radii in mm.
    backlash1, backlash2 : float
        Full backlashes (nu_1, nu_2) in mm; both meshes have the same if the second is left out.
    damping1, damping2 : float
        Rotational damping in N mm s; left out, none, and of wheel 2 that of wheel 1.
    torque1, torque2 : float
        Drag torques in N mm at the mean speed; left out, none, and on wheel 2 that on wheel 1.
        Damping acts on the oscillation alone: what it brakes the mean rotation by, ``damping * mean
        speed``, is part of the torque.
    wheels : sequence of Gears.Wheel, optional
        The loose wheels of a gearbox, 1 to 32, each after the one that it meshes with, in place of
        all numbered values; a dictionary of its values will do for each.  The first one meshes
        with the driver, and its backlash is the unit of length.
    origin : Gears, optional
        Those that these are a changed copy of; given by ``dataclasses.replace``.

    Raises
    ------
    InputError
        If a value has no physical meaning; names the field.

    Examples
    --------
    >>> round(DAT21.mu, 6)
    0.601187
    >>> wheels = {"inertia1": 950.0, "inertia2": 620.0, "radius1": 38.0, "radius2": 30.0}
    >>> pair = Gears(alpha=1.5, epsilon=0.9, omega=300.0, backlash1=0.2, torque1=60.0, **wheels)
    >>> pair.backlash2, pair.damping2, pair.torque2
    (0.2, 0.0, 60.0)
    >>> from dataclasses import replace
    >>> pair = Gears.driven(amplitude=0.3, epsilon=0.9, omega=300.0, backlash1=0.2, **wheels)
    >>> wide = replace(pair, backlash1=0.4)
    >>> pair.amplitude, wide.amplitude, round(wide.alpha, 6)
    (0.3, 0.3, 0.75)

    A shaft behind the driver, and two wheels on its second and third toothing:

    >>> shaft = Gears.Wheel(name="shaft", inertia=9000.0, radius=45.0, backlash=0.12, torque=80.0)
    >>> others = {"meshes": "shaft", "inertia": 1500.0, "torque": 30.0}
    >>> first = Gears.Wheel(name="first", parent_radius=20.0, radius=58.0, **others)
    >>> third = Gears.Wheel(name="third", parent_radius=36.0, radius=42.0, **others)
    >>> box = Gears.driven(amplitude=0.4, omega=170.0, epsilon=0.6, wheels=[shaft, first, third])
    >>> box.wheel_names, box.tree[2].backlash
    (('shaft', 'first', 'third'), 0.12)
    """

    alpha: float
    epsilon: float = None  # type: ignore[assignment]  # of wheels that all have one of their own
    omega: float
    inertia1: float = None  # type: ignore[assignment]  # None of wheels that do not exist
    inertia2: float = None  # type: ignore[assignment]
    radius1: float = None  # type: ignore[assignment]
    radius2: float = None  # type: ignore[assignment]
    backlash1: float = None  # type: ignore[assignment]
    backlash2: float = None  # type: ignore[assignment]  # what is left out is filled in below
    damping1: float = None  # type: ignore[assignment]
    damping2: float = None  # type: ignore[assignment]
    torque1: float = None  # type: ignore[assignment]
    torque2: float = None  # type: ignore[assignment]
    wheels: tuple[LooseWheel, ...] = ()
    origin: InitVar["Gears | None"] = None

    Wheel: ClassVar[type[LooseWheel]] = LooseWheel
    tree: ClassVar[tuple[LooseWheel, ...]] = ()
    """The loose wheels of an instance, in either form; torques are those at the mean speed."""
    # of an instance what `driven` was given in place of a field's value
    _typed: ClassVar[Facts] = {}
    ELSEWHERE = dict.fromkeys(
        (*DRIVES[1:], "driver_radius", *SPEEDS, *DRAG_TABLES), "give it to Gears.driven"
    )

    def __post_init__(self, origin: "Gears | None") -> None:
        given = {name: getattr(self, name) for name in NUMBERED}
        has_wheels = are_given(self.wheels)
        if has_wheels:
            tree = read_wheels(self.wheels)
            values: Facts = {"wheels": tree}
            for name, value in given.items():
                if value is not None:
                    why = "belongs to gears without wheels; give it with each wheel"
                    raise InputError(name, value, why)
            values["epsilon"] = _common_epsilon(tree, self.epsilon)
        else:
            tree = read_wheels(_numbered_wheels(given), named=False)
            values = {name: check_value(name, v) for name, v in given.items() if v is not None}
            for number, wheel in enumerate(tree, 1):
                values |= {f"{kind}{number}": getattr(wheel, kind) for kind in WHEEL_KINDS}
        for name in ("alpha", "epsilon", "omega"):
            values[name] = check_value(name, values.get(name, getattr(self, name)))
        vars(self).update(values, tree=tree)
        if origin is not None:
            self._keep_typed(origin)
        else:
            self._check_complete()
        object.__setattr__(self, "origin", self)

    def _check_complete(self) -> None:
        """Refuse what needs the driver's speed or radius, which `driven` takes."""
        for number, wheel in enumerate(self.tree, 1):
            if wheel.torque_over_rpm is not None:
                name = self.name_of(number, "torque_over_rpm")
                raise InputError(name, wheel.torque_over_rpm, self.ELSEWHERE["speed_rpm"])
        ratios_of(self.tree)

    def _keep_typed(self, origin: "Gears") -> None:
        """Derive again what was derived in the gears that these are a changed copy of."""
        changed = {
            name: value for name, value in fields_of(self).items() if value != getattr(origin, name)
        }
        values = origin.values | changed
        for table, torque in DRAG_TABLES.items():
            if torque in changed:
                values.pop(table, None)
        if "alpha" in changed:
            values = drive_by(values, "alpha", self.alpha)
        vars(self).update(vars(Gears.driven(**values)))

    def __repr__(self) -> str:
        return as_call("Gears.driven" if self._typed else "Gears", self.values)

    @property
    def values(self) -> Facts:
        """The values as they were typed, by name, without those of a wheel that does not exist."""
        values = fields_of(self)
        if set(DRIVES) & set(self._typed):
            del values["alpha"]
        values |= self._typed
        if all(wheel.epsilon is not None for wheel in self.wheels) and self.wheels:
            del values["epsilon"]
        names = (*DRIVES, *values)
        shown = dict.fromkeys(names)
        return {name: values[name] for name in shown if values.get(name) not in (None, ())}

    @property
    def wheel_names(self) -> tuple[str, ...]:
        """What a person calls each wheel: its name, or its number."""
        return wheel_labels(self.tree)

    def name_of(self, number: int, kind: str) -> str:
        """The name of a value of a wheel: ``torque1``, or ``wheel.third.torque``."""
        return value_name(self.wheel_names, number, kind, bool(self.wheels))

    @classmethod
    def driven(
        cls,
        *,
        amplitude: float | None = None,
        amplitude_rad: float | None = None,
        driver_radius: float | None = None,
        speed_rpm: float | None = None,
        speed_rad_s: float | None = None,
        torque1_over_rpm: DragLaw | None = None,
        torque2_over_rpm: DragLaw | None = None,
        **values: Any,
    ) -> "Gears":
        """Gears whose drive is given as the amplitude of the driver's motion, or with the mean
        speed of the driver.

        Parameters
        ----------
        amplitude : float, optional
            Amplitude ``R_e a`` of the motion on the driver's pitch circle, in mm.
        amplitude_rad : float, optional
            Amplitude ``a`` of the driver's rotation in rad, in place of `amplitude`; with
            `driver_radius`.
        driver_radius : float, optional
            Base radius ``R_e`` of the driver in mm; with `amplitude_rad` or a speed.
        speed_rpm, speed_rad_s : float, optional
            Mean speed of the driver in revolutions per minute or in rad/s, one of them.  Wheel i
            then turns at ``speed R_e / R_i``, and what its damping brakes it by is added to the
            torque that is given.
        torque1_over_rpm, torque2_over_rpm : sequence of pairs, or mapping, optional
            In place of `torque1` and `torque2`, with a mean speed: drag torques over the speed of
            the driver, as pairs of 1/min and N mm at rising speeds, straight between them; or as
            ``{"polynomial": (a0, a1, a2), "rpm": (lowest, highest)}``, the torque ``a0 + a1 rpm +
            a2 rpm**2`` at these speeds.  Left out with `torque2`, wheel 2 has that of wheel 1.
        **values : float
            All other fields of Gears; `alpha` where no amplitude is given.

        Returns
        -------
        Gears
            With ``alpha = R_e a / backlash1`` (Eqs. 1-3) and ``torque_i + damping_i speed R_e /
            R_i``.

        Raises
        ------
        InputError
            Unless the drive is given in just one way, or if a value has no physical meaning, or for
            a speed without `driver_radius`, or drag over speed without a speed.

        Examples
        --------
        >>> others = {k: v for k, v in DAT21.values.items() if k != "alpha"}
        >>> Gears.driven(
        ...     amplitude=0.3, **others
        ... ) == Gears.driven(amplitude_rad=0.01, driver_radius=30.0, **others)
        True
        >>> others |= {"amplitude": 0.3, "driver_radius": 30.0, "damping1": 0.0}
        >>> del others["torque1"]
        >>> oil = ((600.0, 40.0), (3000.0, 100.0))
        >>> Gears.driven(speed_rpm=1800.0, torque1_over_rpm=oil, **others).torque1
        70.0
        """
        given = {
            "amplitude": amplitude,
            "amplitude_rad": amplitude_rad,
            "speed_rpm": speed_rpm,
            "speed_rad_s": speed_rad_s,
            "driver_radius": driver_radius,
            "torque1_over_rpm": torque1_over_rpm,
            "torque2_over_rpm": torque2_over_rpm,
        }
        typed: Facts = {name: value for name, value in given.items() if value is not None}
        tables = {name: typed.pop(name) for name in DRAG_TABLES if name in typed}
        return cls._drive(typed, tables, values)

    @classmethod
    def _drive(cls, typed: Facts, tables: Facts, values: Facts) -> "Gears":
        """Gears from what `driven` takes: the values that are no fields of theirs, tables of drag
        over speed, and the others."""
        given = [name for name in DRIVES if name in typed or values.get(name) is not None]
        if len(given) != 1:
            why = "give the drive once: alpha, amplitude or amplitude_rad"
            raise InputError("gears", given, why)
        speeds = [name for name in SPEEDS if name in typed]
        if len(speeds) == 2:
            raise InputError("gears", speeds, "give the mean speed of the driver once")
        has_wheels = are_given(values.get("wheels", ()))
        if has_wheels:
            for name, table in tables.items():
                raise InputError(name, table, "give each wheel its own torque_over_rpm")
            wheels = read_wheels(values["wheels"])
            typed["wheels"] = wheels
            wheels = _share_radius(wheels, typed.get("driver_radius"))
            radius: Any = wheels[0].parent_radius
        else:
            wheels = read_wheels(_numbered_wheels(values | tables), named=False)
            radius = typed.get("driver_radius")
        _check_radius(radius, typed, has_wheels)
        amplitude = typed.get("amplitude")
        if "amplitude_rad" in typed:
            amplitude = radius * non_negative("amplitude_rad", typed["amplitude_rad"])
        if amplitude is not None:
            values["alpha"] = non_negative("amplitude", amplitude) / wheels[0].backlash
        names = [
            value_name(wheel_labels(wheels), number, "torque_over_rpm", has_wheels)
            for number in range(1, len(wheels) + 1)
        ]
        if speeds:
            braked = _brake(wheels, names, typed, radius)
        else:
            braked = wheels
            _check_no_tables(wheels, names)
        if has_wheels:
            values["wheels"] = braked
        elif speeds:
            tables = {name: w.torque_over_rpm for name, w in zip(names, wheels, strict=True)}
            typed = tables | typed
            for name, wheel, after in zip(names, wheels, braked, strict=True):
                typed[DRAG_TABLES[name]] = wheel.torque
                values[DRAG_TABLES[name]] = after.torque
        gears = cls(**values)
        object.__setattr__(gears, "_typed", typed)
        return gears

    def sigma_from(
        self,
        *,
        rms: float | None = None,
        bandwidth: float | None = None,
        spectrum: tuple[Sequence[float], Sequence[float]] | None = None,
        wheel: int | None = None,
    ) -> float:
        """Noise intensity `sigma` of a scene from a measured modulation of the driver's motion, or
        of the drag torque of a wheel.

        The modulation m(t) is relative: the acceleration of the driver is ``a omega^2 (1 + m)``
        times the sine.  It is taken for white noise of the same spectral density: with ``G`` its
        one-sided density (the mean square of m in a band, per Hz of frequencies above 0), ``sigma =
        alpha sqrt(omega G / 2)``.

        Parameters
        ----------
        rms : float, optional
            Root mean square of the modulation, 0.03 for 3 %; with `bandwidth`.
        bandwidth : float, optional
            One-sided bandwidth in Hz: the modulation has frequencies from 0 to this one, ``G =
            rms^2 / bandwidth``.
        spectrum : pair of array_like, optional
            In place of both: frequencies in Hz, rising, and at each the one-sided density of the
            modulation in 1/Hz. ``G`` is its mean over these frequencies.
        wheel : int, optional
            Number of the wheel whose drag torque fluctuates, ``T (1 + m)``, in place of the
            driver's motion: its `gamma` takes the place of alpha (``Scene.noise`` of that wheel).

        Returns
        -------
        float
            `sigma`, dimensionless.

        Raises
        ------
        InputError
            Unless the modulation is given in just one way, by numbers that are not negative; for a
            wheel that does not exist.

        Examples
        --------
        >>> round(DAT21.sigma_from(rms=0.03, bandwidth=50.0), 4)
        0.0779
        >>> round(DAT21.sigma_from(spectrum=([0.0, 50.0], [1.8e-5, 1.8e-5])), 4)
        0.0779
        >>> round(DAT21.sigma_from(rms=0.2, bandwidth=50.0, wheel=2), 4)
        0.0102
        """
        if spectrum is not None and rms is None and bandwidth is None:
            density = _mean_density(*spectrum)
        elif spectrum is None and rms is not None and bandwidth is not None:
            density = non_negative("rms", rms) ** 2 / positive("bandwidth", bandwidth)
        else:
            given = [
                n
                for n, v in {"rms": rms, "bandwidth": bandwidth, "spectrum": spectrum}.items()
                if v is not None
            ]
            raise InputError("sigma_from", given, "give rms and bandwidth, or a spectrum")
        mean = self.alpha if wheel is None else self.gamma(wheel)
        return mean * math.sqrt(0.5 * self.omega * density)

    @property
    def amplitude(self) -> float:
        """Amplitude of the motion on the driver's pitch circle, ``alpha`` times the backlash of
        wheel 1, in mm."""
        return float(self._typed.get("amplitude", self.alpha * self.tree[0].backlash))

    @property
    def units(self) -> Units:
        """What one dimensionless unit of time, length, speed and energy is, in ms, mm, mm/s and
        mJ."""
        first = self.tree[0]
        # mm/s, kg
        speed = first.backlash * self.omega
        rim_mass = first.inertia / first.radius**2
        return Units(1000.0 / self.omega, first.backlash, speed, 1e-3 * rim_mass * speed**2)

    @property
    def mu(self) -> float:
        """Wheel 1's share of the change of the relative velocity at an impact of both wheels
        (dimensionless, Eq. 2)."""
        first = self._wheel(1)
        second = self._wheel(2)
        a = first.inertia * second.radius**2
        b = second.inertia * first.radius**2
        return b / (a + b)

    @property
    def gap2(self) -> float:
        """Half gap of mesh 2 in units of ``backlash1`` (docs/model.md section 1)."""
        return self.gap(2)

    def gap(self, wheel: int) -> float:
        """Half gap of the mesh of a wheel with its parent, in units of the backlash of mesh 1."""
        return self._wheel(wheel).backlash / (2.0 * self.tree[0].backlash)

    @property
    def parameters(self) -> Facts:
        """The parameters of the model that gears fix, by the field of a scene (docs/model.md
        section 1)."""
        values: Facts = {"alpha": self.alpha, "epsilon": self.epsilon}
        if self.wheels:
            return values | {"wheels": _model_wheels(self)}
        values["gap1"] = 0.5
        for number in range(1, len(self.tree) + 1):
            values |= {f"beta{number}": self.beta(number), f"gamma{number}": self.gamma(number)}
        return values if len(self.tree) == 1 else values | {"mu": self.mu, "gap2": self.gap2}

    def beta(self, wheel: int) -> float:
        """Damping ratio of a wheel, ``d / (I omega)`` (below Eq. 2, dimensionless).

        Parameters
        ----------
        wheel : int
            Which wheel, from 1 on.

        Returns
        -------
        float
            ``beta_i`` of wheel i.

        Raises
        ------
        InputError
            If there is no such wheel.
        """
        at = self._wheel(wheel)
        return KG_MM_PER_S2_PER_N * at.damping / (at.inertia * self.omega)

    def gamma(self, wheel: int) -> float:
        """Drag of a wheel, ``T R / (I nu_1 omega^2)`` (below Eq. 2, dimensionless).

        All wheels are divided by ``nu_1``: the only choice that leaves Eq. 3 free of ratios of
        backlashes.

        Parameters
        ----------
        wheel : int
            Which wheel, from 1 on.

        Returns
        -------
        float
            ``gamma_i`` of wheel i.

        Raises
        ------
        InputError
            If there is no such wheel.
        """
        at = self._wheel(wheel)
        unit = at.inertia * self.tree[0].backlash * self.omega**2
        return KG_MM_PER_S2_PER_N * at.torque * at.radius / unit

    def _wheel(self, number: int) -> LooseWheel:
        """A wheel by its number."""
        tree = self.tree
        if number not in range(1, len(tree) + 1):
            last = len(tree)
            known = (
                f"the loose wheels are 1 to {last}" if last > 1 else "there is one loose wheel, 1"
            )
            raise InputError("wheel", number, known)
        return tree[number - 1]


def _model_wheels(gears: Gears) -> tuple[Wheel, ...]:
    """The wheels of the model; an error names the wheel."""
    first = gears.wheels[0]
    rim_mass = first.inertia / first.radius**2
    ratios, _ = ratios_of(gears.wheels)
    parents = find_parents(gears.wheels, "meshes")
    wheels = []
    for number, wheel in enumerate(gears.wheels, 1):
        try:
            wheels.append(
                Wheel(
                    beta=gears.beta(number),
                    gamma=gears.gamma(number),
                    gap=gears.gap(number),
                    mass=wheel.inertia / wheel.radius**2 / rim_mass,
                    parent=parents[number - 1],
                    ratio=ratios[number - 1],
                    epsilon=wheel.epsilon,
                    tolerance=0.5 * wheel.backlash_tolerance / first.backlash,
                    name=wheel.name,
                )
            )
        except InputError as error:
            name = gears.name_of(number, error.field.removeprefix("wheel."))
            raise InputError(name, error.value, error.remedy) from None
    return tuple(wheels)


def values_of(gears: Gears) -> dict[str, float]:
    """The values of gears that can be others: those that were typed, the drive in mm and as
    `alpha`, and the restitution of every named wheel."""
    typed = gears.values
    wheels = typed.pop("wheels", ())
    values = {name: value for name, value in typed.items() if name not in DRAG_TABLES}
    for number, wheel in enumerate(wheels, 1):
        for kind in GEAR_VALUES:
            if getattr(wheel, kind) is not None:
                values[gears.name_of(number, kind)] = getattr(wheel, kind)
        values.setdefault(gears.name_of(number, "epsilon"), gears.epsilon)
    return {"alpha": gears.alpha, "amplitude": gears.amplitude} | values


def check_typed(gears: Gears, name: str, asked: str) -> None:
    """Refuse a value of other gears, which these were given without."""
    numbers = range(1, len(gears.tree) + 1)
    of_wheels = (gears.name_of(i, kind) for i in numbers for kind in GEAR_VALUES)
    if name not in values_of(gears) and name in (*Gears.ELSEWHERE, *NUMBERED, *of_wheels):
        why = "these gears were given without it; give it to Gears.driven, or in [gears], first"
        raise InputError(asked, name, why)


def change_gears(gears: Gears, changes: Facts) -> Gears:
    """Gears with other values; all others stay as they were typed, and the driver's motion as it
    is."""
    names = gears.wheel_names
    changes = {spell_value(name, names, bool(gears.wheels)): v for name, v in changes.items()}
    for name in changes:
        check_typed(gears, name, "gears")
    check_keys("gears", changes, values_of(gears))
    drives = [name for name in DRIVES if name in changes]
    if len(drives) > 1:
        raise InputError("gears", drives, "give the drive once")
    values = gears.values
    for name, value in changes.items():
        _, of_wheel, rest = name.partition("wheel.")
        if of_wheel:
            label, kind = rest.split(".")
            at = names.index(label)
            new = replace(values["wheels"][at], **{kind: value})
            values["wheels"] = (*values["wheels"][:at], new, *values["wheels"][at + 1 :])
        elif name not in DRIVES:
            values[name] = value
    if drives:
        values = drive_by(values, drives[0], changes[drives[0]])
    elif "alpha" in values and gears.name_of(1, "backlash") in changes:
        first = gears.name_of(1, "backlash")
        values["alpha"] = gears.amplitude / check_value(first, changes[first])
    return Gears.driven(**values)


def _numbered_wheels(values: Facts) -> tuple[LooseWheel, ...]:
    """One or two wheels in a row from numbered values; None is left out."""
    given = [name for name in WHEEL2 if values.get(name) is not None]
    if len(given) == 1:
        other = WHEEL2[1 - WHEEL2.index(given[0])]
        why = f"goes with {given[0]}; leave out both where there is no wheel 2"
        raise InputError(other, None, why)
    table2 = values.get("torque2_over_rpm")
    if table2 is not None and not given:
        why = "belongs to wheel 2, which these gears do not have"
        raise InputError("torque2_over_rpm", table2, why)
    wheels = []
    for number in range(1, 3 if given else 2):
        of_wheel: Facts = {
            kind: values.get(value_name((), number, kind, named=False))
            for kind in (*WHEEL_KINDS, "torque_over_rpm")
        }
        wheels.append(LooseWheel(meshes=number - 1, **of_wheel))
    return tuple(wheels)


def _common_epsilon(wheels: Sequence[LooseWheel], epsilon: float | None) -> float | None:
    """The restitution of gears: that of the first wheel where each has its own."""
    without = [number for number, wheel in enumerate(wheels) if wheel.epsilon is None]
    if without and epsilon is None:
        label = wheel_labels(wheels)[without[0]]
        raise InputError("epsilon", None, f"give it, or wheel {label} one of its own")
    return epsilon if without else wheels[0].epsilon


def _share_radius(wheels: tuple[LooseWheel, ...], radius: float | None) -> tuple[LooseWheel, ...]:
    """The wheels, the first one with the driver's radius there, which is given with it or with the
    drive."""
    first = wheels[0]
    if radius is None:
        return wheels
    if first.parent_radius is not None:
        why = f"wheel {first.name or 1} has parent_radius too, which is the same; keep one of them"
        raise InputError("driver_radius", radius, why)
    return (replace(first, parent_radius=check_value("driver_radius", radius)), *wheels[1:])


def _check_radius(radius: float | None, typed: Facts, has_wheels: bool) -> None:
    """Refuse gears without the driver's radius where it is needed, or with it for nothing."""
    has_speed = bool(set(SPEEDS) & set(typed))
    if has_speed and radius is None:
        why = (
            "give the driver's base radius in mm, for the wheels' speeds; or wheel 1's, with"
            " wheel 1's speed"
        )
        raise InputError("driver_radius", None, why)
    is_needed = has_speed or "amplitude_rad" in typed
    is_allowed = is_needed or has_wheels
    if (is_needed and radius is None) or (radius is not None and not is_allowed):
        why = "goes with amplitude_rad or a speed, in mm, and with nothing else"
        raise InputError("driver_radius", radius, why)
    if radius is not None:
        check_value("driver_radius", radius)


def _brake(
    wheels: Sequence[LooseWheel], names: Sequence[str], typed: Facts, radius: float
) -> tuple[LooseWheel, ...]:
    """Wheels with their torques at the driver's mean speed, and what their damping takes there.

    `names`: of the tables of drag over speed.  `typed`: what `Gears.driven` was given.
    """
    name = next(name for name in SPEEDS if name in typed)
    speed = typed[name]
    # mean speed of the driver's pitch circle, mm/s
    rim = radius * SPEEDS[name] * non_negative(name, speed)
    rpm = speed * (SPEEDS[name] / SPEEDS["speed_rpm"])
    braked = []
    for name, wheel, turn in zip(names, wheels, ratios_of(wheels)[1], strict=True):
        torque = wheel.torque
        if wheel.torque_over_rpm is not None:
            if torque is not None:
                why = f"{name} is given too; keep one of them"
                raise InputError(name.removesuffix("_over_rpm"), torque, why)
            torque = drag_at(name, wheel.torque_over_rpm, rpm)
        torque += wheel.damping * rim * turn / wheel.radius
        braked.append(replace(wheel, torque=torque, torque_over_rpm=None))
    return tuple(braked)


def _check_no_tables(wheels: Sequence[LooseWheel], names: Sequence[str]) -> None:
    """Refuse drag over the driver's speed where there is none."""
    for name, wheel in zip(names, wheels, strict=True):
        if wheel.torque_over_rpm is not None:
            why = f"give it, and driver_radius: {name} is read at the driver's mean speed"
            raise InputError("speed_rpm", None, why)


def drive_by(values: Facts, name: str, amplitude: float) -> Facts:
    """Values of gears, driven by another amplitude: that of a name in `DRIVES`."""
    others = {n: v for n, v in values.items() if n not in DRIVES}
    if name != "amplitude_rad" and not {*SPEEDS, "wheels"} & set(others):
        others.pop("driver_radius", None)  # it was for an amplitude in rad
    return {name: amplitude} | others


def _mean_density(frequencies: Sequence[float], densities: Sequence[float]) -> float:
    """The mean of a spectral density over its frequencies, by the trapezoidal rule."""
    if len(frequencies) != len(densities) or len(frequencies) < 2:
        raise InputError(
            "spectrum", len(frequencies), "give two or more frequencies, and a density at each"
        )
    power = 0.0
    for i in range(1, len(frequencies)):
        width = positive("spectrum: step of the frequencies", frequencies[i] - frequencies[i - 1])
        power += (
            0.5
            * width
            * sum(non_negative("spectrum: density", d) for d in densities[i - 1 : i + 1])
        )
    return power / (frequencies[-1] - non_negative("spectrum: frequency", frequencies[0]))


DAT21 = Gears(
    alpha=1.5,
    epsilon=0.9,
    omega=300.0,
    inertia1=4000.0,
    inertia2=2500.0,
    radius1=41.0,
    radius2=26.4,
    backlash1=0.2,
    backlash2=0.2,
    damping1=100.0,
    damping2=100.0,
    torque1=100.0,
    torque2=50.0,
)
"""The paper's example (section 4)."""
