"""Loose gears in physical units (mm, kg, N, s), and the only conversion of units (Eqs. 1-3)."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import InitVar, dataclass, fields
from typing import Any, ClassVar

from rattle.scene.drag import DRAG_TABLES, DragLaw, drag_at, read_drag
from rattle.scene.errors import (
    InputError,
    check_keys,
    check_range,
    finite,
    non_negative,
    positive,
    suggesting,
    unit_interval,
)
from rattle.scene.text import as_call
from rattle.scene.units import Units

KG_MM_PER_S2_PER_N = 1000.0  # 1 N = 1000 kg mm / s^2
SIZES = (1e-12, 1e12)  # admissible range of every dimensional value, in the units below
DRIVES = ("alpha", "amplitude", "amplitude_rad")
"""The ways to give the drive; just one of them."""
SPEEDS = {"speed_rpm": 2.0 * math.pi / 60.0, "speed_rad_s": 1.0}
"""The ways to give the mean speed of the driver, at most one of them, and their units in rad/s."""
WHEEL2 = ("inertia2", "radius2")
"""What a second wheel must have."""


@suggesting
@dataclass(frozen=True, kw_only=True)
class Gears:
    """Physical data of the driver and its one or two loose wheels.

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
        Restitution of both meshes (dimensionless, 0 to 1).
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
    """

    alpha: float
    epsilon: float
    omega: float
    inertia1: float
    inertia2: float = None  # type: ignore[assignment]  # None without a second wheel
    radius1: float
    radius2: float = None  # type: ignore[assignment]
    backlash1: float
    backlash2: float = None  # type: ignore[assignment]  # these of a wheel 2 are those of wheel 1, filled in below
    damping1: float = 0.0
    damping2: float = None  # type: ignore[assignment]
    torque1: float = 0.0
    torque2: float = None  # type: ignore[assignment]
    origin: InitVar["Gears | None"] = None

    # of an instance what `driven` was given in place of a field's value
    _typed: ClassVar[dict[str, Any]] = {}
    ELSEWHERE = dict.fromkeys(
        (*DRIVES[1:], "driver_radius", *SPEEDS, *DRAG_TABLES), "give it to Gears.driven"
    )

    def __post_init__(self, origin: "Gears | None") -> None:
        given = [name for name in WHEEL2 if getattr(self, name) is not None]
        if len(given) == 1:
            other = WHEEL2[1 - WHEEL2.index(given[0])]
            raise InputError(
                other, None, f"goes with {given[0]}; leave out both where there is no wheel 2"
            )
        for name in ("backlash", "damping", "torque"):
            if given and getattr(self, f"{name}2") is None:
                object.__setattr__(self, f"{name}2", getattr(self, f"{name}1"))
        for f in fields(self):
            if given or f.name[-1] != "2" or getattr(self, f.name) is not None:
                object.__setattr__(self, f.name, finite(f.name, getattr(self, f.name)))
        for name, value in self.values.items():
            if name.startswith(("omega", "inertia", "radius", "backlash")):
                check_range(name, positive(name, value), *SIZES)
            if name.startswith(("damping", "torque")):
                check_range(name, non_negative(name, value), 0.0, SIZES[1])
        non_negative("alpha", self.alpha)
        unit_interval("epsilon", self.epsilon)
        if origin is not None:
            self._keep_typed(origin)
        object.__setattr__(self, "origin", self)

    def _keep_typed(self, origin: "Gears") -> None:
        """Derive again what was derived in the gears that these are a changed copy of."""
        changed = {
            f.name: v
            for f in fields(self)
            if (v := getattr(self, f.name)) != getattr(origin, f.name)
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
    def values(self) -> dict[str, Any]:
        """The values as they were typed, by name, without those of a wheel that does not exist."""
        values = {f.name: getattr(self, f.name) for f in fields(self)}
        if set(DRIVES) & set(self._typed):
            del values["alpha"]
        values |= self._typed
        names = (*DRIVES, *values)
        return {name: values[name] for name in dict.fromkeys(names) if values.get(name) is not None}

    @property
    def wheels(self) -> int:
        """How many loose wheels there are: 1 or 2."""
        return 1 if self.inertia2 is None else 2

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
            Unless the drive is given in just one way, or if a value has no physical meaning, or a
            speed comes without `driver_radius`, or drag over speed without a speed or for
            another one.

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
        drives = {
            "alpha": values.get("alpha"),
            "amplitude": amplitude,
            "amplitude_rad": amplitude_rad,
        }
        given = [name for name in DRIVES if drives[name] is not None]
        if len(given) != 1:
            raise InputError(
                "gears",
                given,
                "give the drive once: " + ", ".join(DRIVES[:-1]) + f" or {DRIVES[-1]}",
            )
        speeds = {
            name: v
            for name, v in {"speed_rpm": speed_rpm, "speed_rad_s": speed_rad_s}.items()
            if v is not None
        }
        if len(speeds) == 2:
            raise InputError("gears", list(speeds), "give the mean speed of the driver once")
        if speeds and driver_radius is None:
            why = (
                "give the driver's base radius in mm, for the wheels' speeds; or wheel 1's, with"
                " wheel 1's speed"
            )
            raise InputError("driver_radius", None, why)
        if (driver_radius is None) != (amplitude_rad is None and not speeds):
            why = "goes with amplitude_rad or a speed, in mm, and with nothing else"
            raise InputError("driver_radius", driver_radius, why)
        radius = 0.0
        if driver_radius is not None:
            radius = check_range("driver_radius", positive("driver_radius", driver_radius), *SIZES)
        if amplitude_rad is not None:
            amplitude = radius * non_negative("amplitude_rad", amplitude_rad)
        if amplitude is not None:
            non_negative("amplitude", amplitude)
            backlash = values.get("backlash1", 1.0)  # one that is missing is refused below
            values["alpha"] = amplitude / check_range(
                "backlash1", positive("backlash1", backlash), *SIZES
            )
        tables = _drag_tables(torque1_over_rpm, torque2_over_rpm, values, bool(speeds))
        gears = cls(**values)
        typed: dict[str, Any] = dict(tables)
        typed |= {name: v for name, v in drives.items() if v is not None and name != "alpha"}
        torques = {}
        if speeds:
            ((name, speed),) = speeds.items()
            # mean speed of all pitch circles, mm/s
            rim = radius * SPEEDS[name] * non_negative(name, speed)
            rpm = speed * (SPEEDS[name] / SPEEDS["speed_rpm"])
            for i in range(1, gears.wheels + 1):
                damping, _, torque, own = gears._wheel(i)
                table = f"torque{i}_over_rpm"
                typed[f"torque{i}"] = torque
                if table in tables:
                    torque = drag_at(table, tables[table], rpm)
                    typed[f"torque{i}"] = None  # the table says it
                torques[f"torque{i}"] = torque + damping * rim / own
            gears = cls(**values | torques)
        typed |= speeds | ({} if driver_radius is None else {"driver_radius": driver_radius})
        object.__setattr__(gears, "_typed", typed)
        return gears

    def sigma_from(
        self,
        *,
        rms: float | None = None,
        bandwidth: float | None = None,
        spectrum: tuple[Sequence[float], Sequence[float]] | None = None,
    ) -> float:
        """Noise intensity `sigma` of a scene from a measured modulation of the driver's motion.

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

        Returns
        -------
        float
            `sigma`, dimensionless.

        Raises
        ------
        InputError
            Unless the modulation is given in just one way, by numbers that are not negative.

        Examples
        --------
        >>> round(DAT21.sigma_from(rms=0.03, bandwidth=50.0), 4)
        0.0779
        >>> round(DAT21.sigma_from(spectrum=([0.0, 50.0], [1.8e-5, 1.8e-5])), 4)
        0.0779
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
        return self.alpha * math.sqrt(0.5 * self.omega * density)

    @property
    def amplitude(self) -> float:
        """Amplitude of the motion on the driver's pitch circle, ``alpha backlash1``, in mm."""
        return float(self._typed.get("amplitude", self.alpha * self.backlash1))

    @property
    def units(self) -> Units:
        """What one dimensionless unit of time, length, speed and energy is, in ms, mm, mm/s and
        mJ."""
        # mm/s, kg
        speed = self.backlash1 * self.omega
        rim_mass = self.inertia1 / self.radius1**2
        return Units(1000.0 / self.omega, self.backlash1, speed, 1e-3 * rim_mass * speed**2)

    @property
    def mu(self) -> float:
        """Wheel 1's share of the change of the relative velocity at an impact of both wheels
        (dimensionless, Eq. 2)."""
        self._wheel(2)
        a = self.inertia1 * self.radius2**2
        b = self.inertia2 * self.radius1**2
        return b / (a + b)

    @property
    def gap2(self) -> float:
        """Half gap of mesh 2 in units of ``backlash1`` (docs/model.md section 1)."""
        return self.backlash2 / (2.0 * self.backlash1)

    def beta(self, wheel: int) -> float:
        """Damping ratio of a wheel, ``d / (I omega)`` (below Eq. 2, dimensionless).

        Parameters
        ----------
        wheel : {1, 2}
            Which wheel.

        Returns
        -------
        float
            ``beta_1`` or ``beta_2``.

        Raises
        ------
        InputError
            If there is no such wheel.
        """
        damping, inertia, _, _ = self._wheel(wheel)
        return KG_MM_PER_S2_PER_N * damping / (inertia * self.omega)

    def gamma(self, wheel: int) -> float:
        """Drag of a wheel, ``T R / (I nu_1 omega^2)`` (below Eq. 2, dimensionless).

        Both wheels are divided by ``nu_1``: the only choice that leaves Eq. 3 free of ratios of
        backlashes.

        Parameters
        ----------
        wheel : {1, 2}
            Which wheel.

        Returns
        -------
        float
            ``gamma_1`` or ``gamma_2``.

        Raises
        ------
        InputError
            If there is no such wheel.
        """
        _, inertia, torque, radius = self._wheel(wheel)
        return KG_MM_PER_S2_PER_N * torque * radius / (inertia * self.backlash1 * self.omega**2)

    def _wheel(self, wheel: int) -> tuple[float, float, float, float]:
        if wheel == 1:
            return self.damping1, self.inertia1, self.torque1, self.radius1
        if wheel == 2 and self.wheels == 2:
            return self.damping2, self.inertia2, self.torque2, self.radius2
        known = (
            "the loose wheels are 1 and 2" if self.wheels == 2 else "there is one loose wheel, 1"
        )
        raise InputError("wheel", wheel, known)


def values_of(gears: Gears) -> dict[str, float]:
    """The values of gears that can be others: those that were typed, and the drive in mm and as
    `alpha`."""
    typed = {name: value for name, value in gears.values.items() if name not in DRAG_TABLES}
    return {"alpha": gears.alpha, "amplitude": gears.amplitude} | typed


def check_typed(gears: Gears, name: str, asked: str) -> None:
    """Refuse a value of other gears, which these were given without."""
    if name not in values_of(gears) and name in (
        *Gears.ELSEWHERE,
        *(f.name for f in fields(Gears)),
    ):
        why = "these gears were given without it; give it to Gears.driven, or in [gears], first"
        raise InputError(asked, name, why)


def change_gears(gears: Gears, changes: Mapping[str, Any]) -> Gears:
    """Gears with other values; all others stay as they were typed, and the driver's motion as it
    is."""
    for name in changes:
        check_typed(gears, name, "gears")
    check_keys("gears", changes, values_of(gears))
    drives = [name for name in DRIVES if name in changes]
    if len(drives) > 1:
        raise InputError("gears", drives, "give the drive once")
    values = gears.values | {n: value for n, value in changes.items() if n not in DRIVES}
    if drives:
        values = drive_by(values, drives[0], changes[drives[0]])
    elif "alpha" in values and "backlash1" in changes:
        backlash = positive("backlash1", values["backlash1"])
        values["alpha"] = gears.amplitude / backlash
    return Gears.driven(**values)


def _drag_tables(
    first: object, second: object, values: dict[str, Any], has_speed: bool
) -> dict[str, DragLaw]:
    """The tables of drag over speed by name; of wheel 2 that of wheel 1 where it has no drag of its
    own."""
    given = dict(zip(DRAG_TABLES, (first, second), strict=True))
    tables = {name: read_drag(name, points) for name, points in given.items() if points is not None}
    has_wheel2 = values.get("inertia2") is not None
    for name in tables:
        torque = DRAG_TABLES[name]
        if not has_speed:
            why = f"give it, and driver_radius: {name} is read at the driver's mean speed"
            raise InputError("speed_rpm", None, why)
        if values.get(torque) is not None:
            raise InputError(torque, values[torque], f"{name} is given too; keep one of them")
        if torque == "torque2" and not has_wheel2:
            why = "belongs to wheel 2, which these gears do not have"
            raise InputError(name, tables[name], why)
    name1, name2 = DRAG_TABLES
    if name1 in tables and name2 not in tables and has_wheel2 and values.get("torque2") is None:
        tables[name2] = tables[name1]
    return tables


def drive_by(values: dict[str, Any], name: str, amplitude: float) -> dict[str, Any]:
    """Values of gears, driven by another amplitude: that of a name in `DRIVES`."""
    others = {n: v for n, v in values.items() if n not in DRIVES}
    if name != "amplitude_rad" and not set(SPEEDS) & set(others):
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
