"""A slow plain-Python oracle of both Euler-Maruyama schemes, written from docs/model.md sections 3
and 4 alone.

It takes its normals from the caller: one per step, and one per *event call*.  In a step whose
straight line ends beyond a wall, the located scheme asks for one bridge normal before each leg (to
the next wall or to the end of the step), used or not, and tells which leg of the step it is; every
other step asks for none.  `fault` plants one error, so that a comparison can be seen to fail.
"""

import math
import random
from collections.abc import Callable
from dataclasses import dataclass, field

FAULTS = (
    "mesh-1 leaves stage 2",
    "mesh-2 sign",
    "mesh-2 leaves stage 1",
    "mu swapped",
    "noise not shared",
    "sqrt dt forgotten",
    "noise without its cosine",
    "one wall only",
    "mesh 1 only",
    "coupling forgotten",
    "drag sign",
    "phase at step end",
)
"""Errors that either scheme can have."""

LOCATED_FAULTS = (
    "bridge without spread",
    "bridge without mean",
    "increment not split",
    "one impact per step",
    "later wall first",
)
"""Errors that only a scheme with located impacts can have."""

# impacts and turns within one step; one more, and the mesh stays closed to the end of the step
MOST = 64


@dataclass
class Path:
    """One path: `state` is [x1, y1, x2, y2]; `impacts` holds (tau, x1, y1, x2, y2, mesh * side)
    just before each."""

    scene: object
    dt: float
    located: bool
    walls: dict[int, float]
    state: list[float]
    tau0: float
    fault: str | None = None
    # by mesh: half gap that impact k gives to the opposite flank
    fresh: dict[int, list[float]] | None = None
    n: int = 0
    impacts: list[tuple[float, ...]] = field(default_factory=list)
    per_step: list[list[int]] = field(default_factory=list)
    sticking_steps: int = 0
    spare: random.Random = field(default_factory=lambda: random.Random(5))

    @classmethod
    def start(
        cls, scene, dt: float, located: bool, fault: str | None = None, tau0: float | None = None
    ) -> "Path":
        """A path at the scene's start, the impact of the start done."""
        s = scene.start
        walls = {1: scene.gap1, -1: scene.gap1, 2: scene.gap2, -2: scene.gap2}
        path = cls(
            scene,
            dt,
            located,
            walls,
            [s.x1, s.y1, s.x2, s.y2],
            s.tau if tau0 is None else tau0,
            fault,
        )
        if s.mesh:
            path._collide(s.mesh)
        return path

    def _collide(self, mesh: int) -> None:
        e = self.scene.epsilon
        mu = self.scene.mu
        _, y1, _, y2 = self.state
        if self.fault == "mu swapped":
            mu = 1.0 - mu
        if mesh == 1:
            self.state[1] = -e * y1
            if self.fault != "mesh-1 leaves stage 2":
                self.state[3] = y2 - (1.0 + e) * y1
        else:
            sign = {"mesh-2 sign": -1.0, "mesh-2 leaves stage 1": 0.0}.get(self.fault, 1.0)
            self.state[1] = y1 - sign * (1.0 + e) * mu * y2
            self.state[3] = -e * y2

    def _slope(self, tau: float, dw: float, h: float) -> tuple[float, float]:
        """Change of (y1, y2) over a time h that brings the Brownian increment dw (Eq. 5)."""
        s = self.scene
        _, y1, _, y2 = self.state
        if self.fault == "phase at step end":
            tau += h
        sine = math.sin(tau)
        cosine = math.cos(tau)
        m1 = -sine + s.beta1 * cosine
        m2 = (s.beta1 - s.beta2) * cosine
        n1 = -sine if self.fault == "noise without its cosine" else m1
        dw2 = self.spare.gauss(0.0, math.sqrt(h)) if self.fault == "noise not shared" else dw
        coupling = 0.0 if self.fault == "coupling forgotten" else s.beta2 - s.beta1
        drag = -1.0 if self.fault == "drag sign" else 1.0
        return (
            h * (-s.beta1 * y1 + drag * s.gamma1 + s.alpha * m1) + s.sigma * n1 * dw,
            h * (-s.beta2 * y2 + coupling * y1 + s.gamma1 - s.gamma2 + s.alpha * m2)
            + s.sigma * m2 * dw2,
        )

    def _drift(self, tau: float, dw: float, h: float) -> None:
        change1, change2 = self._slope(tau, dw, h)
        x1, y1, x2, y2 = self.state
        self.state = [x1 + h * y1, y1 + change1, x2 + h * y2, y2 + change2]

    def _record(self, tau: float, code: int) -> None:
        self.impacts.append((tau, *self.state, code))
        self.per_step[-1].append(code)
        if self.fresh is not None and len(self.impacts) <= len(self.fresh[1]):
            flank = code if self.fault == "redraws the flank struck" else -code
            self.walls[flank] = self.fresh[abs(code)][len(self.impacts) - 1]
        self._collide(abs(code))

    def _meshes(self) -> tuple[int, ...]:
        return (1,) if self.scene.stages == 1 or self.fault == "mesh 1 only" else (1, 2)

    def _sides(self) -> tuple[int, ...]:
        return (1,) if self.fault == "one wall only" else (1, -1)

    def step(self, z: float, bridge: Callable[[int], float]) -> None:
        """One step of dt with the standard normal `z`; bridge normals as the located scheme needs
        them."""
        self.per_step.append([])
        begin = self.tau0 + self.n * self.dt
        self.n += 1
        dw = z * (self.dt if self.fault == "sqrt dt forgotten" else math.sqrt(self.dt))
        ends = {m: self.state[2 * m - 2] + self.dt * self.state[2 * m - 1] for m in self._meshes()}
        leaves = any(s * x > self.walls[s * m] for m, x in ends.items() for s in self._sides())
        if not leaves:
            self._drift(begin, dw, self.dt)
        elif self.located:
            self._step_located(begin, dw, bridge)
        else:
            self._drift(begin, dw, self.dt)
            for m in self._meshes():
                for s in self._sides():
                    if (
                        s * self.state[2 * m - 2] > self.walls[s * m]
                        and s * self.state[2 * m - 1] > 0.0
                    ):
                        self.state[2 * m - 2] = s * self.walls[s * m]
                        self._record(begin + self.dt, s * m)
                        break

    def _rest(self, tau: float, dw: float, left: float, m: int) -> None:
        """Mesh m stays closed for the rest of the step: its contact gives both stages what keeps
        its speed at zero."""
        # (y1, y2) per unit of contact, docs/model.md section 3
        per_impulse = (
            1.0 if m == 1 else self.scene.mu,
            1.0,
        )
        parts = 50
        i = 2 * m - 1
        j = 2 * (3 - m) - 1
        self.state[j] -= per_impulse[2 - m] / per_impulse[m - 1] * self.state[i]
        self.state[i] = 0.0
        before = self.state[j]
        for k in range(parts):
            h = left / parts
            start = list(self.state)
            at = tau + k * h
            for share in (0.5, 1.0):  # the midpoint rule
                change = self._slope(
                    at if share == 0.5 else at + 0.5 * h, dw / parts * share, h * share
                )
                speed = self.state[j]
                self.state[j] = (
                    start[j]
                    + change[2 - m]
                    - per_impulse[2 - m] / per_impulse[m - 1] * change[m - 1]
                )
                self.state[j - 1] = start[j - 1] + h * share * speed
        for s in self._sides():
            wall = self.walls[s * (3 - m)]
            beyond = s * self.state[j - 1] - wall
            if beyond > 0.0:  # the speed that it had at the wall, by a constant acceleration
                gained = 2.0 * beyond * s * (self.state[j] - before) / left
                self.state[j - 1], self.state[j] = (
                    s * wall,
                    s * math.sqrt(max(self.state[j] ** 2 - gained, 0.0)),
                )

    def _step_located(self, tau: float, dw: float, bridge: Callable[[int], float]) -> None:
        left = self.dt
        for leg in range(MOST + 1):
            normal = bridge(leg)
            meetings = []
            for m in self._meshes():
                x = self.state[2 * m - 2]
                y = self.state[2 * m - 1]
                for s in self._sides():
                    if s * y > 0.0:
                        meetings.append((max(self.walls[s * m] - s * x, 0.0) / (s * y), m, s))
            meetings = [meeting for meeting in meetings if meeting[0] < left]
            if self.fault == "one impact per step" and self.per_step[-1]:
                meetings = []
            if not meetings:
                self._drift(tau, dw, left)
                return
            t, m, s = max(meetings) if self.fault == "later wall first" else min(meetings)
            share = t / left
            mean = 0.0 if self.fault == "bridge without mean" else dw * share
            spread = 0.0 if self.fault == "bridge without spread" else math.sqrt(t * (1.0 - share))
            part = mean + spread * normal
            if t > 0.0:
                self._drift(tau, part, t)
            tau = tau + t
            left = left - t
            if self.fault != "increment not split":
                dw -= part
            self.state[2 * m - 2] = s * self.walls[s * m]
            if s * self.state[2 * m - 1] > 0.0:
                if leg == MOST:
                    self.sticking_steps += 1
                    self._rest(tau, dw, left, m)
                    return
                self._record(tau, s * m)
