"""What a scheme costs at an accuracy, as models of paths and step that pilots and runs have shown."""

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

from rattle.montecarlo import SCHEMES, Ensemble, Record
from rattle.montecarlo.accuracy import sampling_error, step_error
from rattle.montecarlo.kernel.block import BLOCK
from rattle.montecarlo.pilots import pilot
from rattle.scene.scene import Scene

__all__ = ["CostModel", "Point", "timed"]

FINER = 8.0  # by which a second pilot's step is shorter, to tell the time of steps from that of impacts
REPEATS = 3


class Point(NamedTuple):
    """A method at an accuracy.

    ``kind`` is ``scheme``, ``multilevel`` (section means alone) or ``closure``.  ``error`` is what is drawn: the larger
    of ``sampling_error`` and ``step_error`` where measured, else what was asked; of a closure the worst error, an upper
    bound unless ``resolved``, with ``median_error``, and ``sampling_error`` the half width of the worst row's interval.
    ``rows`` counts the section means and sds that it speaks of, and ``actual_error`` is the worst difference of a
    measured run from the best simulation at hand; it ``missed`` where that is beyond what its errors allow, for too few
    paths know nothing of rare ones, and is then the ``error``.
    """

    method: str
    kind: str
    accuracy: float
    dt: float
    paths: int
    core_seconds: float
    sampling_error: float
    step_error: float
    error: float
    measured: bool
    median_error: float = math.nan
    resolved: bool = True
    rows: int = 0
    actual_error: float = math.nan
    missed: bool = False


@dataclass
class CostModel:
    """What a scheme's pilots and runs have shown, as models of paths and step.

    Attributes
    ----------
    scheme : str
    first : Ensemble
        The pilot.
    path_seconds, step_seconds : float
        Time of a path is the first, and the second for each of its steps (of all step sizes).
    pilot_seconds : float
        Time of the pilot, which every answer takes.
    spread : float
        Worst standard error times the root of the paths.
    bias : float
        Worst bias of the step over the step; 0 where there is none.
    best : Ensemble
        The run with most paths.
    shared : float
        Least spread to believe in, from a run of another scheme: heavy tails show only in many paths.
    """

    scheme: str
    first: Ensemble
    path_seconds: float
    step_seconds: float
    pilot_seconds: float
    spread: float
    bias: float
    best: Ensemble
    shared: float = 0.0

    @classmethod
    def from_pilots(cls, scene: Scene, scheme: str, again: Callable[..., Ensemble]) -> "CostModel":
        """Measure a scheme by pilots: one for a scheme without step bias, else a second with a shorter step."""
        first, seconds = _least(lambda: pilot(scene, scheme, again))
        spread = sampling_error(first)[0] * math.sqrt(first.paths)
        if not SCHEMES[scheme].has_step_bias:
            return cls(scheme, first, 0.0, seconds / first.path_steps, seconds, spread, 0.0, first)
        finer, more = _least(
            lambda: again(paths=first.paths, scheme=scheme, dt=first.dt / FINER, record=Record(step_bias=True))
        )
        step = (more - seconds) / (finer.path_steps - first.path_steps)
        path = max(0.0, seconds - step * first.path_steps) / first.paths
        model = cls(scheme, first, path, step, seconds, spread, step_error(first)[0] / first.dt, first)
        model.learn(finer)
        return model

    def learn(self, run: Ensemble) -> None:
        """Take over what a run with more paths, or a bias that stands clear of noise at a shorter step, has shown."""
        if run.paths >= self.best.paths:
            self.spread, self.best = max(self.shared, sampling_error(run)[0] * math.sqrt(run.paths)), run
        if self.bias:
            step, se = step_error(run)
            if step > 3.0 * se:
                self.bias = step / run.dt

    def steps(self, dt: float) -> float:
        """Steps of a path, of all step sizes that run side by side."""
        return self.first.path_steps / self.first.paths * self.first.dt / dt

    def at(self, accuracy: float) -> Point:
        """The point extrapolated to an accuracy."""
        paths = max(1, math.ceil((self.spread / accuracy) ** 2 / BLOCK)) * BLOCK
        dt = min(self.first.dt, accuracy / self.bias) if self.bias else self.first.dt
        seconds = self.pilot_seconds + paths * (self.path_seconds + self.step_seconds * self.steps(dt))
        return Point(
            self.scheme, "scheme", accuracy, dt, paths, seconds, self.spread / math.sqrt(paths), self.bias * dt,
            accuracy, False,
        )  # fmt: skip

    def path_alone(self, accuracy: float, step_ns: float | None = None) -> float:
        """Seconds of a path at an accuracy without the longer steps beside it that measure the bias.

        With `step_ns`, at so many ns for a step, and impacts for nothing.
        """
        share = 4.0 / 7.0 if self.bias else 1.0  # of the steps dt + dt/2 + dt/4
        steps = self.steps(self.at(accuracy).dt) * share
        return 1e-9 * step_ns * steps if step_ns else self.path_seconds * share + self.step_seconds * steps


def timed(call: Callable[[], Ensemble]) -> tuple[Ensemble, float]:
    """A run and its processor time."""
    began = time.process_time()
    run = call()
    return run, time.process_time() - began


def _least(call: Callable[[], Ensemble]) -> tuple[Ensemble, float]:
    """A run and the least of its times, after a call that compiles."""
    run = call()
    return run, min(timed(call)[1] for _ in range(REPEATS))
