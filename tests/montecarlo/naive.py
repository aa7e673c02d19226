"""A slow plain-Python oracle of both Euler-Maruyama schemes, for the dynamics of `oracle` and the
scenes of docs/model.md section 4.

It takes its normals from the caller: one per step, and one per *event call*.  In a step whose
straight line ends beyond a wall, the located scheme asks for one bridge normal before each leg (to
the next wall or to the end of the step), used or not, and tells which leg of the step it is; every
other step asks for none.  `fault` plants one error, so that a comparison can be seen to fail.
"""

import math
import random
from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import count

import numpy as np
from oracle import Gearbox, two_stages


@dataclass
class Path:
    """One path: `state` is [x1, y1, x2, y2]; `impacts` holds (tau, x1, y1, x2, y2, mesh * side)
    just before each."""

    scene: object
    dt: float
    located: bool
    box: Gearbox
    walls: dict[int, float]
    state: list[float]
    tau0: float
    fault: str | None = None
    n: int = 0
    impacts: list[tuple[float, ...]] = field(default_factory=list)
    per_step: list[list[int]] = field(default_factory=list)
    spare: random.Random = field(default_factory=lambda: random.Random(5))

    @classmethod
    def start(cls, scene, dt: float, located: bool, fault: str | None = None) -> "Path":
        """A path at the scene's start, the impact of the start done."""
        s = scene.start
        box = two_stages(scene.constants)
        walls = {side * (i + 1): gap for i, gap in enumerate(box.gaps) for side in (1, -1)}
        path = cls(scene, dt, located, box, walls, [s.x1, s.y1, s.x2, s.y2], s.tau, fault)
        FAULTS.get(fault, lambda path: None)(path)
        if s.mesh:
            path._collide(s.mesh)
        return path

    def _collide(self, mesh: int) -> None:
        speed = self.state[2 * mesh - 1]
        for i, effect in enumerate(self.box.effect[:, mesh - 1].tolist()):
            self.state[2 * i + 1] -= (1.0 + self.scene.epsilon) * effect * speed

    def _change(self, tau: float, dw: float, h: float) -> list[float]:
        """Change of the rates over a time h that brings the Brownian increment dw (Eq. 5)."""
        if self.fault == "phase at step end":
            tau += h
        box = self.box
        first = math.cos(tau)
        second = -math.sin(tau)
        y = self.state[1::2]
        change = []
        for i, damping in enumerate(box.damping.tolist()):
            m = box.by_second[i] * second + box.by_first[i] * first
            if self.fault == "noise not shared" and i == 1:
                dw = self.spare.gauss(0.0, math.sqrt(h))
            drift = box.drag[i] - sum(d * v for d, v in zip(damping, y, strict=True))
            change.append(float(h * (drift + box.alpha * m) + self.scene.sigma * m * dw))
        return change

    def _drift(self, tau: float, dw: float, h: float) -> None:
        change = self._change(tau, dw, h)
        for i, gained in enumerate(change):
            self.state[2 * i] += h * self.state[2 * i + 1]
            self.state[2 * i + 1] += gained

    def _record(self, tau: float, code: int) -> None:
        self.impacts.append((tau, *self.state, code))
        self.per_step[-1].append(code)
        self._collide(abs(code))

    def step(self, z: float, bridge: Callable[[int], float]) -> None:
        """One step of dt with the standard normal `z`; bridge normals as the located scheme needs
        them."""
        self.per_step.append([])
        begin = self.tau0 + self.n * self.dt
        self.n += 1
        dw = z * math.sqrt(self.dt)
        ends = [x + self.dt * y for x, y in zip(self.state[::2], self.state[1::2], strict=True)]
        leaves = any(
            math.copysign(1, code) * ends[abs(code) - 1] > wall for code, wall in self.walls.items()
        )
        if leaves and self.located:
            self._step_located(begin, dw, bridge)
            return
        self._drift(begin, dw, self.dt)
        if not leaves:
            return
        for code, wall in self.walls.items():
            place = 2 * abs(code) - 2
            side = math.copysign(1, code)
            if side * self.state[place] > wall and side * self.state[place + 1] > 0.0:
                self.state[place] = side * wall
                self._record(begin + self.dt, code)

    def _meetings(self, left: float) -> list[tuple[float, int, int]]:
        """Times to the walls that the straight lines meet within the rest of a step, with mesh and
        side."""
        meetings = []
        for code, wall in self.walls.items():
            side = 1 if code > 0 else -1
            x, y = self.state[2 * abs(code) - 2 : 2 * abs(code)]
            if side * y > 0.0:
                t = max(wall - side * x, 0.0) / (side * y)
                if t < left:
                    meetings.append((t, abs(code), side))
        return meetings

    def _step_located(self, tau: float, dw: float, bridge: Callable[[int], float]) -> None:
        left = self.dt
        for leg in count():
            normal = bridge(leg)
            meetings = self._meetings(left)
            if not meetings:
                self._drift(tau, dw, left)
                return
            t, m, s = max(meetings) if self.fault == "later wall first" else min(meetings)
            share = t / left
            mean = 0.0 if self.fault == "bridge without mean" else dw * share
            part = mean + math.sqrt(t * (1.0 - share)) * normal
            if t > 0.0:
                self._drift(tau, part, t)
            tau = tau + t
            left = left - t
            if self.fault != "increment not split":
                dw -= part
            self.state[2 * m - 2] = s * self.walls[s * m]
            if s * self.state[2 * m - 1] > 0.0:
                self._record(tau, s * m)


FAULTS = {
    "mesh-2 sign": lambda path: np.negative(path.box.effect[0, 1:], out=path.box.effect[0, 1:]),
    "coupling forgotten": lambda path: path.box.damping[1].put(0, 0.0),
    "one wall only": lambda path: path.walls.update({-1: math.inf, -2: math.inf}),
}
"""Errors of the dynamics."""
IN_STEPS = ("noise not shared", "phase at step end")
"""Errors that a step makes."""
LOCATED_FAULTS = ("bridge without mean", "increment not split", "later wall first")
"""Errors that only a scheme with located impacts can have."""
