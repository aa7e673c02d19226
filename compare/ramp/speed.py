"""The speed of a run-up: the scene at each speed, and the motion while the speed changes.

docs/guide/run-up.md derives what a change of speed does to the dimensionless motion.
"""

import math
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from rattle.montecarlo.long_run.ramp import RampStretch
from rattle.scene import Constants, Floats, InputError, Scene, check_scene, positive
from rattle.scene.gears import KG_MM_PER_S2_PER_N, SPEEDS, Gears
from rattle.scene.threshold import least_drags
from rattle.scene.wheel import complete_wheels

THRESHOLD_HALVINGS = 40  # of the interval in which a threshold lies
TURN = 2.0 * math.pi  # rad of a turn of the driver


@dataclass(frozen=True)
class SpeedRamp:
    """A driver whose mean speed goes from one value to another at a constant rate; 1/min, s."""

    scene: Scene  # at the speed of its file
    first: float
    last: float
    seconds: float
    slow: float = 0.1  # speed below which an impact is slow, dimensionless at the file's speed

    @cached_property
    def gears(self) -> Gears:
        """The gears at the speed of the file."""
        assert self.scene.gears is not None
        return self.scene.gears

    @cached_property
    def name(self) -> str:
        """The name of the driver's mean speed in the file."""
        return next(name for name in SPEEDS if name in self.gears.values)

    @cached_property
    def file_rpm(self) -> float:
        """The speed at which the file's `omega` holds."""
        return float(self.gears.values[self.name]) * (SPEEDS[self.name] / SPEEDS["speed_rpm"])

    @cached_property
    def rates(self) -> tuple[float, float, float]:
        """Excitation frequency at the start and the end, rad/s, and its rate of change, rad/s^2."""
        ratio = self.gears.omega / self.file_rpm
        first = ratio * self.first
        last = ratio * self.last
        return first, last, (last - first) / self.seconds

    @property
    def periods(self) -> int:
        """Whole periods of the excitation in the ramp."""
        first, last, _ = self.rates
        return int(0.5 * (first + last) * self.seconds / TURN)

    def rpm_at(self, periods: Floats) -> Floats:
        """The speed after so many periods: its square changes linearly with the phase."""
        first, _, rate = self.rates
        omega = np.sqrt(first**2 + 2.0 * rate * TURN * periods)
        return omega * (self.first / first)

    def omega_at(self, rpm: Floats) -> Floats:
        """The excitation frequency at a speed, rad/s."""
        return self.gears.omega / self.file_rpm * rpm

    def scene_at(self, rpm: float) -> Scene:
        """The scene at a constant speed: all else as typed, the order of the excitation too."""
        speed = rpm * (SPEEDS["speed_rpm"] / SPEEDS[self.name])
        omega = float(self.omega_at(np.array(rpm)))
        return self.scene.with_gears(**{self.name: speed, "omega": omega})

    @cached_property
    def rim_acceleration(self) -> float:
        """Acceleration of the driver's pitch circle in the ramp, mm/s^2."""
        rad_s2 = SPEEDS["speed_rpm"] * (self.last - self.first) / self.seconds
        # gears of any number of wheels may have it with the first of them
        radius = self.gears.values.get("driver_radius") or self.gears.tree[0].parent_radius
        assert radius is not None  # no mean speed is taken without it
        return float(radius) * rad_s2

    def added_torque(self, wheel: int) -> float:
        """What the acceleration of the mean rotation adds to the drag of a wheel, N mm, at any
        speed."""
        at = self.gears.tree[wheel - 1]
        turn = float(self.scene.constants.wheels["turn"][wheel - 1])
        return at.inertia * turn * self.rim_acceleration / at.radius / KG_MM_PER_S2_PER_N

    def constants_at(self, rpm: float) -> Constants:
        """The constants of the motion in the ramp while it passes a speed."""
        scene = self.scene_at(rpm)
        assert scene.gears is not None
        c = scene.constants
        omega = scene.gears.omega
        drag = self.rim_acceleration / (scene.gears.units.length * omega**2)
        wheels = c.wheels.copy()
        wheels["beta"] += self.rates[2] / omega**2
        # the turn is the ratio of the speeds of its rim and the driver's
        wheels["gamma"] += wheels["turn"] * drag
        complete_wheels(wheels, c.drive)
        for name, gamma in zip(scene.wheel_names, wheels["gamma"], strict=True):
            if gamma < 0.0:
                why = (
                    f"is too short: at {rpm:.4g} 1/min wheel {name} would be slowed down by"
                    " more than its drag does, and overtake the driver; give more"
                )
                raise InputError("seconds", self.seconds, why)
        return c._replace(wheels=wheels)

    def stretches(self, periods: int) -> tuple[list[RampStretch], Floats]:
        """The ramp in stretches of so many periods, each at the speed in its middle, and these."""
        number = self.periods // periods
        rpm = self.rpm_at(periods * np.arange(0.5, number))
        parts = [
            RampStretch(self.constants_at(speed), self.slow_at(speed), periods)
            for speed in rpm.tolist()
        ]
        return parts, rpm

    def slow_at(self, rpm: float) -> float:
        """Below which an impact is slow at another speed of the driver: the same in mm/s."""
        return self.slow * self.file_rpm / rpm

    def opens(self, wheel: int, rpm: float, ramp: bool) -> bool:
        """Whether closed teeth of a wheel open at a speed, constant or in the ramp."""
        c = self.constants_at(rpm) if ramp else self.scene_at(rpm).constants
        return bool((c.wheels["gamma"] < least_drags(c))[wheel - 1])

    def openings(self, wheel: int, speeds: list[float], ramp: bool) -> list[tuple[float, bool]]:
        """Where closed teeth of a wheel begin to open, or cease to: the speed, and whether they
        open at higher ones."""

        known = [(rpm, self.opens(wheel, rpm, ramp)) for rpm in speeds]
        crossings = []
        for (low, before), (high, after) in pairwise(known):
            if before == after:
                continue
            for _ in range(THRESHOLD_HALVINGS):
                middle = 0.5 * (low + high)
                if self.opens(wheel, middle, ramp) == before:
                    low = middle
                else:
                    high = middle
            crossings.append((0.5 * (low + high), after))
        return crossings


def read_ramp(
    scene: Scene, rpm: tuple[float, float], seconds: float, slow: float = 0.1
) -> SpeedRamp:
    """A ramp of a scene, checked."""
    check_scene(scene)
    gears = scene.gears
    if gears is None:
        why = "a run-up needs gears: inertia, radius and drag of the wheels, and the driver's speed"
        raise InputError("scene", "without gears", why)
    names = [name for name in SPEEDS if name in gears.values]
    if not names:
        why = "give the driver's mean speed at which omega holds, and driver_radius"
        raise InputError("gears.speed_rpm", None, why)
    positive(f"gears.{names[0]}", gears.values[names[0]])
    first, last = (float(positive("rpm", value)) for value in rpm)
    if first == last:
        raise InputError("rpm", rpm, "give two different speeds")
    ramp = SpeedRamp(
        scene, first, last, float(positive("seconds", seconds)), positive("slow", slow)
    )
    for speed in (first, last):  # what cannot be there is refused before any work
        ramp.constants_at(speed)
    return ramp
