"""The stationary motion of a scene, and of the same scene with one parameter changed, in
independent groups of paths that share their random numbers.

Each scene is followed by paths of its own, which go on where they stopped: the burn-in is left out
once, and a longer run costs only what it adds.
"""

import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field

import numpy as np

from rattle.compare.stationary.measure import stationary
from rattle.compare.stationary.result import unit_of
from rattle.montecarlo.kernel.blocks import Budget
from rattle.montecarlo.long_run import AtRest
from rattle.montecarlo.long_run.estimates import estimates
from rattle.montecarlo.long_run.paths import LongPaths, warm_up
from rattle.montecarlo.long_run.run import settle
from rattle.montecarlo.long_run.sums import NUMBER, Sums, scales_of_pilot
from rattle.montecarlo.schemes.quiet import quiet_of
from rattle.montecarlo.settings import is_random
from rattle.scene import Floats, InputError, Scene
from rattle.scene.changes import same_speed
from rattle.scene.progress import ProgressBar

PATHS_OF_A_GROUP = 2  # the fewest of which a quantity has a value
GROUP_NUMBERS = (16, 8, 4)
"""Independent groups, as many as the budget allows: Student's t with three degrees of freedom is
half as wide again as with fifteen."""
SCALE_PERIODS = 8  # periods of the unchanged scene that set the scales for all scenes
PROBED_PERIODS = 2
QUIET_SECONDS = 2e-6  # nominal processor time of a period of a path without impacts: its steps


@dataclass
class Shared:
    """What all the scenes share: random numbers, groups, burn-in and scales.

    `burn_in`: periods that are left out. `base`: the paths of the unchanged scene. `work`: nominal
    processor time of a period of one of them.
    """

    scene: Scene
    slow: float
    seed: int
    groups: int
    limit: Budget
    pool: ThreadPoolExecutor
    bar: ProgressBar

    def __post_init__(self) -> None:
        """Find the burn-in and the scales on the unchanged scene.

        Changes of a few per cent leave the memory of a motion as it is, and all scenes begin in the
        same states, so that what the start leaves behind is the same in all of them.
        """
        base = self.begin(self.scene)
        self.base = base
        try:
            settled = settle(base, None)
        except AtRest as rest:
            why = f"{rest.remedy}. Give a larger drive or less drag"
            raise InputError("scene", "at rest", why) from None
        base.reserve = 0.0
        base.begin()
        seen: list[Floats] = []
        base.follow(SCALE_PERIODS, seen)
        self.work = max(base.nominal / self.paths, QUIET_SECONDS)
        self.scales = scales_of_pilot(self.scene.stages, np.concatenate(seen), self.slow)
        base.begin(self.scales)
        # its second quarter agrees with its second half; twice, for what the test cannot see
        self.burn_in = 2 * max(settled.periods // 4, 1)

    @property
    def paths(self) -> int:
        """Paths of each scene."""
        return PATHS_OF_A_GROUP * self.groups

    def begin(self, scene: Scene) -> LongPaths:
        """New paths of a scene, with the random numbers that all share."""
        stream = np.random.SeedSequence(self.seed)
        slow = same_speed(self.slow, self.scene, scene)
        quiet = quiet_of(scene, slow, None)
        return LongPaths(scene, self.paths, stream, slow, quiet, self.limit, self.pool, self.bar)


def count_work(scene: Scene, slow: float) -> float:
    """Nominal processor time of a period of one path, from the impacts of a few paths."""
    warm_up(scene, slow)
    with ThreadPoolExecutor(1) as pool, ProgressBar() as bar:
        few = GROUP_NUMBERS[-1]
        seed = np.random.SeedSequence(0)
        quiet = quiet_of(scene, slow, None)
        paths = LongPaths(scene, few, seed, slow, quiet, Budget(math.inf), pool, bar)
        paths.follow(PROBED_PERIODS)
        paths.begin()
        paths.follow(PROBED_PERIODS)
        return max(paths.nominal / few, QUIET_SECONDS)


@dataclass
class ChangedMotion:
    """The motion with one parameter changed, or the motion as it is."""

    scene: Scene
    name: str = ""  # of the parameter
    factor: float = 1.0  # what it is multiplied by
    why: str = ""  # why there are no values
    exact: dict[str, float] = field(default_factory=dict)  # quantities, where nothing is sampled
    _paths: LongPaths | None = None
    _logs: tuple[int, Floats] = (0, np.empty(0))

    @property
    def periods(self) -> int:
        """Periods after the burn-in; 0 before any, and where the motion is exact."""
        return self._paths.periods if self._paths else 0

    def find_exact(self, slow: float) -> bool:
        """Whether nothing is random and the motion has exact values, which are kept."""
        if is_random(self.scene):
            return False
        try:
            motion = stationary(self.scene, periods=64, paths=16, slow=slow, closures=())
        except InputError as error:  # no stationary motion is reached
            if not self.name:
                raise
            self.why = str(error)
            return True
        if motion.kind == "rest":
            self._rest(motion.said.removeprefix("At rest: "))
            return True
        if motion.kind == "simulated":  # irregular without noise
            return False
        self.exact = {str(name): value for name, value in motion.table["value"].items()}
        return True

    def follow(self, shared: Shared, until: int) -> None:
        """Follow the paths until so many periods after the burn-in, as far as the budget goes."""
        if self.exact or self.why:
            return
        if self._paths is None:
            paths = shared.base if not self.name else shared.begin(self.scene)
            if self.name:
                paths.follow(shared.burn_in)
                if paths.periods < shared.burn_in:
                    return
                paths.begin(shared.scales._replace(slow=paths.slow))
            self._paths = paths
        self._paths.follow(until)

    def note_rest(self) -> None:
        """Note that the motion has come to rest, where no path has an impact any longer."""
        if self.exact or self.why or self._paths is None or not self._paths.periods:
            return
        if not self._paths.main[:, :, NUMBER].any() and self._paths.at_rest():
            self._rest(f"it stays closed for {self.periods} periods.")

    def _rest(self, how: str) -> None:
        if not self.name:
            raise InputError("scene", "at rest", f"{how} Give a larger drive or less drag")
        self.why = f"comes to rest at {self.factor - 1.0:+.0%}"

    def logs(self, names: list[str], groups: int) -> Floats:
        """Logarithms of quantities in physical units, by group; -inf where one is 0, and NaN where
        there are none.

        Shapes: result (groups, quantities).
        """
        periods, logs = self._logs
        if self.exact or self.why or not self.periods:
            missing = 0.0 if self.exact else math.nan
            with np.errstate(divide="ignore"):
                value = np.log([self.exact.get(name, missing) for name in names])
            return np.tile(value + self._units(names), (groups, 1))
        if periods != self.periods:
            assert self._paths is not None
            parts = _split(self._paths.collect(), groups)
            estimated = [estimates(part, tuple(names)) for part in parts]
            values = [[of[n].value if n in of else 0.0 for n in names] for of in estimated]
            with np.errstate(divide="ignore"):
                logs = np.log(values) + self._units(names)
            self._logs = self.periods, logs
        return logs

    def _units(self, names: list[str]) -> Floats:
        """Logarithms of the units."""
        return np.log([unit_of(name, self.scene.gears, "physical")[1] for name in names])


def _split(c: Sums, groups: int) -> list[Sums]:
    """The sums of each group of paths."""
    fields = ("main", "power", "products", "histogram", "section")
    parts = zip(*(np.split(getattr(c, name), groups) for name in fields), strict=True)
    return [c._replace(**dict(zip(fields, part, strict=True))) for part in parts]
