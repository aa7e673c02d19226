"""A pair of loose gears in physical units (mm, kg, N, s), and the only conversion of units (Eqs. 1-3)."""

from dataclasses import dataclass, fields

from rattle.scene.errors import InputError
from rattle.scene.keywords import suggesting
from rattle.scene.units import Units
from rattle.scene.validate import finite, non_negative, positive, ranged, unit_interval

__all__ = ["DAT21", "Gears"]

KG_MM_PER_S2_PER_N = 1000.0  # 1 N = 1000 kg mm / s^2
SIZES = (1e-12, 1e12)  # admissible range of every dimensional value, in the units below
DRIVES = ("alpha", "amplitude", "amplitude_rad")
"""The ways to give the drive; just one of them."""


@suggesting
@dataclass(frozen=True, kw_only=True)
class Gears:
    """Physical data of the driver and the two loose wheels.

    `driven` takes the amplitude of the driver's motion in place of `alpha`.  All dimensional values are at most 1e12 in
    the units below; frequency, inertias, radii and backlashes are at least 1e-12.

    Parameters
    ----------
    alpha : float
        Excitation amplitude ``R_e a / backlash1`` (dimensionless).
    epsilon : float
        Restitution of both meshes (dimensionless, 0 to 1).
    omega : float
        Excitation frequency in rad/s.
    inertia1, inertia2 : float
        Moments of inertia of the wheels in kg mm^2.
    radius1, radius2 : float
        Base radii in mm.
    backlash1, backlash2 : float
        Full backlashes (nu_1, nu_2) in mm; both meshes have the same if the second is left out.
    damping1, damping2 : float
        Rotational damping in N mm s; left out, none, and of wheel 2 that of wheel 1.
    torque1, torque2 : float
        Drag torques in N mm; left out, none, and on wheel 2 that on wheel 1.

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
    """

    alpha: float
    epsilon: float
    omega: float
    inertia1: float
    inertia2: float
    radius1: float
    radius2: float
    backlash1: float
    backlash2: float = None  # type: ignore[assignment]  # these of wheel 2 are those of wheel 1, filled in below
    damping1: float = 0.0
    damping2: float = None  # type: ignore[assignment]
    torque1: float = 0.0
    torque2: float = None  # type: ignore[assignment]

    ELSEWHERE = dict.fromkeys((*DRIVES[1:], "driver_radius"), "give it to Gears.driven, in place of alpha")

    def __post_init__(self) -> None:
        for name in ("backlash", "damping", "torque"):
            if getattr(self, f"{name}2") is None:
                object.__setattr__(self, f"{name}2", getattr(self, f"{name}1"))
        for f in fields(self):
            object.__setattr__(self, f.name, finite(f.name, getattr(self, f.name)))
        for name in ("omega", "inertia1", "inertia2", "radius1", "radius2", "backlash1", "backlash2"):
            ranged(name, positive(name, getattr(self, name)), *SIZES)
        for name in ("damping1", "damping2", "torque1", "torque2"):
            ranged(name, non_negative(name, getattr(self, name)), 0.0, SIZES[1])
        non_negative("alpha", self.alpha)
        unit_interval("epsilon", self.epsilon)

    @classmethod
    def driven(
        cls,
        *,
        amplitude: float | None = None,
        amplitude_rad: float | None = None,
        driver_radius: float | None = None,
        **values: float,
    ) -> "Gears":
        """Gears whose drive is given as the amplitude of the driver's motion, in place of `alpha`.

        Parameters
        ----------
        amplitude : float, optional
            Amplitude ``R_e a`` of the motion on the driver's pitch circle, in mm.
        amplitude_rad : float, optional
            Amplitude ``a`` of the driver's rotation in rad, in place of `amplitude`; with `driver_radius`.
        driver_radius : float, optional
            Base radius ``R_e`` of the driver in mm.
        **values : float
            All other fields of Gears.

        Returns
        -------
        Gears
            With ``alpha = R_e a / backlash1`` (Eqs. 1-3).

        Raises
        ------
        InputError
            Unless the drive is given in just one way, or if a value has no physical meaning.

        Examples
        --------
        >>> others = {k: v for k, v in vars(DAT21).items() if k != "alpha"}
        >>> Gears.driven(amplitude=0.3, **others) == Gears.driven(amplitude_rad=0.01, driver_radius=30.0, **others)
        True
        """
        drives = {"alpha": values.get("alpha"), "amplitude": amplitude, "amplitude_rad": amplitude_rad}
        given = [name for name in DRIVES if drives[name] is not None]
        if len(given) != 1:
            raise InputError("gears", given, "give the drive once: " + ", ".join(DRIVES[:-1]) + f" or {DRIVES[-1]}")
        if (driver_radius is None) != (amplitude_rad is None):
            raise InputError("driver_radius", driver_radius, "goes with amplitude_rad, in mm, and with nothing else")
        if amplitude_rad is not None:
            radius = ranged("driver_radius", positive("driver_radius", finite("driver_radius", driver_radius)), *SIZES)
            amplitude = radius * non_negative("amplitude_rad", amplitude_rad)
        if amplitude is not None:
            non_negative("amplitude", amplitude)
            backlash = values.get("backlash1", 1.0)  # one that is missing is refused below
            values["alpha"] = amplitude / ranged("backlash1", positive("backlash1", backlash), *SIZES)
        return cls(**values)

    @property
    def amplitude(self) -> float:
        """Amplitude of the motion on the driver's pitch circle, ``alpha backlash1``, in mm."""
        return self.alpha * self.backlash1

    @property
    def units(self) -> Units:
        """What one dimensionless unit of time, length, speed and energy is, in ms, mm, mm/s and mJ."""
        speed, rim_mass = self.backlash1 * self.omega, self.inertia1 / self.radius1**2  # mm/s, kg
        return Units(1000.0 / self.omega, self.backlash1, speed, 1e-3 * rim_mass * speed**2)

    @property
    def mu(self) -> float:
        """Share of the mesh-2 impulse that wheel 1 takes (dimensionless, Eq. 2)."""
        a, b = self.inertia1 * self.radius2**2, self.inertia2 * self.radius1**2
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

        Both wheels are divided by ``nu_1``: the only choice that leaves Eq. 3 free of ratios of backlashes.

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
        if wheel == 2:
            return self.damping2, self.inertia2, self.torque2, self.radius2
        raise InputError("wheel", wheel, "the loose wheels are 1 and 2")


DAT21 = Gears(
    alpha=1.5, epsilon=0.9, omega=300.0,
    inertia1=4000.0, inertia2=2500.0, radius1=41.0, radius2=26.4,
    backlash1=0.2, backlash2=0.2, damping1=100.0, damping2=100.0, torque1=100.0, torque2=50.0,
)  # fmt: skip
"""The paper's example (section 4)."""
