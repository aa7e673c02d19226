"""The compiled kernel against both Euler-Maruyama schemes written a second time, path by path.

The dynamics are those of `oracle`, the schemes those of docs/model.md section 4, the random numbers
those of the kernel.
"""

import math
from functools import partial
from itertools import count

import numpy as np
import pytest
from mc_checks import bridge_normal, key_of, step_normals
from oracle import gearbox
from scenes import UNEQUAL, dat21
from settings import EULER, LOCATED

from rattle import Record, Scene, Start, simulate
from rattle.montecarlo import largest_step

FLIGHT = 1  # column of a row that the oracle does not have
KERNEL_IMPACTS = 8
KERNEL_SEED = 5

# tiny gaps, a light wheel thrown about by a heavy one, the longest step: several impacts in a step,
# at both meshes
TIGHT = Scene(
    alpha=0.9,
    epsilon=0.95,
    beta1=0.08,
    beta2=0.5,
    gamma1=0.057,
    gamma2=0.2,
    mu=0.9,
    gap1=0.05,
    gap2=0.05,
    sigma=1.0,
    start=Start(0.3, 0.05, 2.0, 0.0, -2.0, mesh=1),
)
KERNEL_CASES = {
    "rough": (UNEQUAL.with_sigma(0.8), 5e-3),
    "tight": (TIGHT, 0.99 * largest_step(TIGHT)[0]),
    "single": (dat21(0.7, stages=1), 1e-2),
}
FAULTS = {"phase at step end": EULER, "bridge without mean": LOCATED, "later wall first": LOCATED}
"""Errors that may be planted in a path of a scheme."""


class Path:
    """One path: `impacts` holds (tau, x1, y1, x2, y2, mesh * side) just before each.

    In a step whose straight line ends beyond a wall, the located scheme takes one bridge normal
    for each leg, to the next wall or to the end of the step; `fault` plants one error.
    """

    def __init__(self, scene, dt, fault):
        start = scene.start
        self.scene = scene
        self.dt = dt
        self.fault = fault
        self.box = gearbox(scene.constants)
        self.gaps = np.array(self.box.gaps)
        state = np.array(start.values[: 2 * scene.stages])
        self.x = state[::2]
        self.y = state[1::2]
        self.impacts = []
        if start.mesh:
            self.collide(start.mesh - 1)

    def collide(self, i):
        self.y = self.y - (1.0 + self.scene.epsilon) * self.y[i] * self.box.effect[:, i]

    def drift(self, tau, dw, h):
        """Eq. 5 over a time h that brings the Brownian increment dw."""
        if self.fault == "phase at step end":
            tau += h
        kick = self.scene.sigma * dw * self.box.modulation(tau)
        self.x = self.x + h * self.y
        self.y = self.y + h * self.box.acceleration(tau, self.y) + kick

    def strike(self, tau, i, side):
        self.x[i] = side * self.gaps[i]
        if side * self.y[i] > 0.0:
            state = np.column_stack([self.x, self.y]).ravel()
            self.impacts.append((tau, *state, side * (i + 1)))
            self.collide(i)

    def step(self, begin, dw, bridge):
        """A step; with a function that gives bridge normals, by the located scheme."""
        beyond = np.abs(self.x + self.dt * self.y) > self.gaps
        if bridge and beyond.any():
            self.step_located(begin, dw, bridge)
            return
        self.drift(begin, dw, self.dt)
        for i in np.flatnonzero(beyond):
            if self.x[i] * self.y[i] > 0.0:
                self.strike(begin + self.dt, i, np.sign(self.x[i]))

    def step_located(self, tau, dw, bridge):
        left = self.dt
        for leg in count():
            side = np.sign(self.y)
            times = np.maximum(self.gaps - side * self.x, 0.0) / np.abs(self.y)
            i = np.argmin(times)
            if self.fault == "later wall first" and times.max() < left:
                i = np.argmax(times)
            t = times[i]
            if t >= left:
                self.drift(tau, dw, left)
                return
            part = math.sqrt(t * (1.0 - t / left)) * bridge(leg)
            if self.fault != "bridge without mean":
                part += dw * t / left
            self.drift(tau, part, t)
            tau += t
            left -= t
            dw -= part
            self.strike(tau, i, side[i])


def follow_oracle(case, scheme, number, fault):
    """An oracle path on the random numbers of a path of a run, until it has had its impacts."""
    scene, dt = KERNEL_CASES[case]
    key = key_of(np.random.SeedSequence(KERNEL_SEED))
    path = Path(scene, dt, fault)
    for n, z in enumerate(step_normals(key, number, 4000).tolist()):
        bridge = partial(bridge_normal, key, number, n) if scheme == LOCATED else None
        path.step(scene.start.tau + n * dt, z * math.sqrt(dt), bridge)
        if len(path.impacts) >= KERNEL_IMPACTS:
            break
    return np.array(path.impacts[:KERNEL_IMPACTS])


def furthest(case, scheme, fault=None):
    """Largest difference of an impact's time and state between kernel and oracle over what rounding
    allows.

    Rounding grows at each impact (measured: to 4e-15 at the first, ten-fold at each in the worst of
    200 paths with located impacts), and by more in a path that all but grazes: of the worst tenth
    of the paths only meshes and sides count.  Infinite if one of these differs.
    """
    scene, dt = KERNEL_CASES[case]
    allowed = 1e-13 * 8.0 ** np.arange(1, KERNEL_IMPACTS + 1)
    given = {"paths": 10, "impacts": KERNEL_IMPACTS, "dt": dt, "scheme": scheme}
    run = simulate(scene, record=Record(raw=True), rng=KERNEL_SEED, **given)
    worst = []
    for number, raw in enumerate(np.delete(run.raw, FLIGHT, axis=2)):
        impacts = follow_oracle(case, scheme, number, fault)
        if impacts.shape != raw.shape or (impacts[:, -1] != raw[:, -1]).any():
            return np.inf
        worst.append((np.abs(impacts - raw).max(axis=1) / allowed).max())
    return np.quantile(worst, 0.9)


@pytest.mark.parametrize("scheme", [EULER, LOCATED])
@pytest.mark.parametrize("case", KERNEL_CASES)
def test_kernel_follows_oracle(case, scheme):
    assert furthest(case, scheme) < 1.0


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_is_seen(fault):
    assert furthest("tight", FAULTS[fault], fault) > 1e6
