"""One path over as many impacts as wanted, a stretch at a time, with the tangent growth of the drift along it.

Under white noise the distance of two paths is not proportional to their initial distance, however small
(docs/model.md section 8), so a path has no Jacobian.  What grows here is a frame under the **linearisation of the
drift**: the exact Jacobian of the flight, and the saltation matrix with the drift's rates at the path's own impacts.
Its determinant obeys the orbit's formula: the damping between impacts, and ``epsilon^2`` at each.
"""

import numpy as np

from rattle.montecarlo.coupling.dyadic import HIT, Tree, new_room, put, tree_of, walk_step
from rattle.montecarlo.noise.philox import STEP, Word, normals
from rattle.montecarlo.schemes.short_flight import first_state
from rattle.montecarlo.schemes.step_state import MOST_IN_A_STEP
from rattle.scene.compiled import jit
from rattle.scene.scene import Scene
from rattle.scene.tangent import Stretch, carry_frame, strike_frame
from rattle.scene.types import Floats

DEPTH = 12  # of the tree: leaves are 1.2e-5 long; noise changes a velocity by 3.5e-3 sigma in one


@jit
def _stretch(
    tree: Tree, path: Word, tangent: bool, step: int, most: int, at: Floats, frame: Floats, s: Stretch, velocity: Floats
) -> tuple[int, int, int]:
    """Fill the arrays from ``at = (x1, y1, x2, y2, time since last impact)`` on; returns impacts, steps, sticking."""
    c, w, hits, room = tree.c, tree.clock, np.empty((MOST_IN_A_STEP, HIT)), new_room(tree.clock.depth)
    state = at[:4]
    n, taken, sticking = 0, 0, 0
    z0, z1, z2, z3 = 0.0, 0.0, 0.0, 0.0
    while taken < most and n + MOST_IN_A_STEP <= s.flight.size:
        if len(velocity) > 0:
            velocity[taken, 0], velocity[taken, 1] = state[1], state[3]
        if c.sigma > 0.0:
            if taken == 0 or step % 2 == 0:
                z0, z1, z2, z3 = normals(tree.key, path, Word(step // 2), Word(STEP))
            z = (z0, z1) if step % 2 == 0 else (z2, z3)
        else:
            z = (0.0, 0.0)
        found, full = walk_step(tree, room, path, step, z, state, hits)
        sticking += full
        last = 0.0
        for i in range(found):
            flight = at[4] + hits[i, 0] - last
            code = int(hits[i, 1])
            tau = (step % len(w.forcing)) * w.h + hits[i, 0]
            s.flight[n], s.phase[n], s.code[n] = flight, tau, code
            put(hits[i, 2:], s.before[n])
            if tangent:
                carry_frame(c, flight, frame)
                strike_frame(c, abs(code), tau, hits[i, 3], hits[i, 5], frame, s.growth[n])
            at[4], last = 0.0, hits[i, 0]
            n += 1
        at[4] += w.h - last
        step += 1
        taken += 1
    return n, taken, sticking


class LongPath:
    """One path of a scene, to be followed a stretch at a time.

    `step`: time between the velocities that `stretch` returns. `steps`: number of the next step, counted from
    time 0 (modulo the period at the start). `sticking_steps`: steps with more impacts than there is space for;
    the path stays as it is to their end.

    Examples
    --------
    >>> from rattle.scene import DAT21, Scene
    >>> path = LongPath(Scene.from_gears(DAT21, sigma=0.01), seed=7)
    >>> s, velocity = path.stretch(5000)
    >>> s.code[:3].tolist(), velocity.shape[1]
    ([-1, 2, -1], 2)
    """

    def __init__(self, scene: Scene, seed: int, path: int = 0, depth: int = DEPTH) -> None:
        self.tree, self.path, self.sticking_steps = tree_of(scene, seed, depth), Word(path), 0
        self.step = self.tree.clock.h
        self.steps = round(scene.phase % (2.0 * np.pi) / self.step)
        self.at, self.frame = np.array([*first_state(scene), 0.0]), np.eye(4)

    def stretch(self, steps: int, tangent: bool = True, velocities: bool = True) -> tuple[Stretch, Floats]:
        """The impacts of the next steps.

        A path that has more impacts than there is space for (one in two steps) ends its stretch early.

        Shapes: `velocity` (steps taken, 2).
        """
        s, velocity = Stretch.empty(steps // 2 + MOST_IN_A_STEP), np.empty((steps if velocities else 0, 2))
        n, taken, sticking = _stretch(
            self.tree, self.path, tangent, self.steps, steps, self.at, self.frame, s, velocity
        )
        self.steps += taken
        self.sticking_steps += sticking
        return s.first(n), velocity[:taken]
