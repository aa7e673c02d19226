"""Cost model of a scheme: number of paths, step and time for an accuracy, fitted to pilot runs and measured runs."""

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

from rattle.montecarlo import SCHEMES, Ensemble, Record
from rattle.montecarlo.accuracy.cost import LOOKS, cost_of, expect_paths
from rattle.montecarlo.accuracy.pilots import pilot
from rattle.montecarlo.accuracy.step_error import step_error
from rattle.montecarlo.diagnostics.accuracy import LEAST, sampling_error, share_of_look
from rattle.montecarlo.kernel.block import BLOCK
from rattle.scene.scene import Scene

FINER = 8.0  # ratio of the steps of both pilot runs, which separates the time of steps from that of impacts
REPEATS = 3  # timings of a pilot run, of which the least counts


class CostPoint(NamedTuple):
    """Error and cost of a method at a requested accuracy; errors are in units of each quantity's sd.

    An accuracy is that of `rattle.montecarlo.simulate_to`: with 95 % probability no section mean or sd is off by more.
    """

    method: str  # name of a scheme, of a closure, or ``multilevel`` and a scheme
    kind: str  # ``scheme``, ``multilevel`` (section means only) or ``closure``
    accuracy: float  # as requested; NaN for a closure
    dt: float
    paths: int
    core_seconds: float  # processor time, pilot runs included
    # sampling_error, step_error: worst standard error and worst step bias; of a closure the half width of the worst
    # row's interval, and 0
    sampling_error: float
    step_error: float
    # as drawn: the bound that was reached if measured, the accuracy if extrapolated, ``actual_error`` if ``missed``;
    # of a closure its worst error
    error: float
    measured: bool  # whether it was run, rather than extrapolated
    median_error: float = math.nan  # of a closure
    # whether the worst error of a closure is larger than its interval; if not, ``error`` is an upper bound
    resolved: bool = True
    rows: int = 0  # number of section means and sds to which the errors refer
    actual_error: float = math.nan  # worst difference of a measured run from the reference simulation
    missed: bool = False  # whether that is more than the accuracy and the error of the reference explain
    # nominal core-seconds of the counted work: what decides which method is cheapest.  NaN for multilevel methods
    work: float = math.nan


@dataclass
class CostModel:
    """Cost model of a scheme: paths as its runs foresee them, error ``bias * dt``, time linear in paths and steps."""

    scheme: str
    first: Ensemble  # the pilot run
    # path_seconds, step_seconds: seconds of a path without its steps, and of each step (counting those of dt, 2 dt
    # and 4 dt)
    path_seconds: float
    step_seconds: float
    pilot_seconds: float  # seconds of the pilot run, which are part of every cost
    bias: float  # worst step bias over dt, in sds; 0 for a scheme without step bias
    best: Ensemble  # the run with most paths
    # A run of another scheme that foresees the paths if it has more: heavy tails show only in many
    shared: Ensemble | None = None

    @classmethod
    def from_pilots(cls, scene: Scene, scheme: str, again: Callable[..., Ensemble]) -> "CostModel":
        """Fit the model to pilot runs: one for a scheme without step bias, else a second one with a shorter step."""
        first, seconds = _least(lambda: pilot(scene, scheme, again))
        if not SCHEMES[scheme].has_step_bias:
            return cls(scheme, first, 0.0, seconds / first.path_steps, seconds, 0.0, first)
        finer, more = _least(
            lambda: again(paths=first.paths, scheme=scheme, dt=first.dt / FINER, record=Record(step_bias=True))
        )
        step = (more - seconds) / (finer.path_steps - first.path_steps)
        path = max(0.0, seconds - step * first.path_steps) / first.paths
        model = cls(scheme, first, path, step, seconds, step_error(first)[0] / first.dt, first)
        model.learn(finer)
        return model

    def learn(self, run: Ensemble) -> None:
        """Update the model: what foresees the paths from a run with more, the bias where it is significant."""
        if run.paths >= self.best.paths:
            self.best = run
        if self.bias:
            step, se = step_error(run)
            if step > 3.0 * se:
                self.bias = step / run.dt

    def steps(self, dt: float) -> float:
        """Number of steps of a path, summed over the step sizes dt, 2 dt and 4 dt that run in parallel."""
        return self.first.path_steps / self.first.paths * self.first.dt / dt

    def at(self, accuracy: float) -> CostPoint:
        """Extrapolate to an accuracy, half of which is left to the bias of a scheme that has one.

        `accuracy`: Error that with 95 % probability no section mean or sd exceeds, in sds.
        """
        room = 0.5 * accuracy if self.bias else accuracy
        run = max((self.best, self.shared or self.best), key=lambda found: found.paths)
        wanted = max(expect_paths(run, room, share_of_look(LOOKS)).paths, LEAST)
        paths = math.ceil(wanted / BLOCK) * BLOCK
        dt = min(self.first.dt, room / self.bias) if self.bias else self.first.dt
        seconds = self.pilot_seconds + paths * (self.path_seconds + self.step_seconds * self.steps(dt))
        sampling = sampling_error(run)[0] * math.sqrt(run.paths / paths)
        return CostPoint(
            self.scheme,
            "scheme",
            accuracy,
            dt,
            paths,
            seconds,
            sampling,
            self.bias * dt,
            accuracy,
            False,
            work=self.work(self.first, paths, dt),
        )

    def work(self, run: Ensemble, paths: int, dt: float) -> float:
        """Nominal core-seconds of the pilot run and of paths like those of a run."""
        return cost_of(self.first, self.first.paths).core_seconds + cost_of(run, paths, dt).core_seconds

    def path_alone(self, accuracy: float, step_ns: float | None = None) -> float:
        """Seconds of a path at an accuracy, without the steps of 2 dt and 4 dt that measure the bias.

        `step_ns`: Nanoseconds of a step, in place of the measured times; impacts are then free.
        """
        share = 4.0 / 7.0 if self.bias else 1.0  # 1 : 1/2 : 1/4 steps of dt, 2 dt and 4 dt
        steps = self.steps(self.at(accuracy).dt) * share
        return 1e-9 * step_ns * steps if step_ns else self.path_seconds * share + self.step_seconds * steps


def time_run(call: Callable[[], Ensemble]) -> tuple[Ensemble, float]:
    """Time a simulation."""
    began = time.process_time()
    run = call()
    return run, time.process_time() - began


def _least(call: Callable[[], Ensemble]) -> tuple[Ensemble, float]:
    """A run and the shortest of several timings, after a first call that compiles."""
    run = call()
    return run, min(time_run(call)[1] for _ in range(REPEATS))
