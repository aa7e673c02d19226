"""From impact to impact: the mixture's flight, the restitution map, and the merging of components after it."""

import numpy as np

from rattle.closure.branching.mixture import Mixture, empty, reduce
from rattle.closure.branching.propagate import Image
from rattle.closure.branching.refine import Level, add_noise, buffers, fly
from rattle.closure.flanks import PLAIN, column, forget, random_tolerance, start_pieces
from rattle.closure.orbit import Floats, Orbit
from rattle.closure.section_map import hit_matrix
from rattle.scene.compiled import jit
from rattle.scene.constants import Constants
from rattle.scene.scene import Scene
from rattle.scene.small_matrices import apply, congruence, put
from rattle.scene.small_vectors import put_row

ON_ORBIT = 10  # added to the label of a component whose itinerary is the orbit's


@jit
def _strike(
    c: Constants, redrawn: Floats, start: Mixture, image: Image, count: int, own: int, after: Mixture
) -> tuple[int, float]:
    """Apply the restitution map to all images, packed to the front; returns their number and the weight without impact.

    The labels of `after` are the impact, ``mesh * side``, plus `ON_ORBIT` if the itinerary is still the orbit's, whose
    impact is `own`.  `redrawn` has the variances of the deviations of +1, -1, +2, -2 that contacts draw anew; it is
    empty if none are.
    """
    section, flight = image.section, image.flight
    kept, discarded = 0, 0.0
    for i in range(2 * count):
        w, code = section.weight[i], section.label[i]
        if w == 0.0:
            continue
        if code == 0:
            discarded += w
            continue
        hit = hit_matrix(c, abs(code), section.mean.shape[1])
        section.weight[kept], section.label[kept] = w, code
        put_row(flight[kept], flight[i])
        put_row(section.mean[kept], section.mean[i])
        put(section.covariance[kept], section.covariance[i])
        after.weight[kept] = w
        put_row(after.mean[kept], apply(hit, section.mean[i]))
        put(after.covariance[kept], congruence(hit, section.covariance[i]))
        if redrawn.size > 0:
            flank = column(abs(code), -code)
            forget(flank, after.mean[kept], after.covariance[kept])
            after.covariance[kept, flank, flank] = redrawn[flank - PLAIN]
        after.label[kept] = code + (ON_ORBIT if start.label[i // 2] > 2 and code == own else 0)
        kept += 1
    return kept, discarded


class Advance:
    """The mixture on its way; each impact is a call of `fly`, one of `strike`, and one of `merge`.

    `buffers`: components in flight, and their images. `after`: components after the impact, not merged yet.
    `live, flown, kept`: number of components after merging, after splitting, and after the impact. `struck,
    merged`: number of impacts so far, and of those after which components were merged. `discarded`: probability
    discarded so far.
    """

    def __init__(self, scene: Scene, orbit: Orbit, level: Level) -> None:
        """Begin at the start of an orbit."""
        self.constants, self.level, self.discarded = scene.constants, level, 0.0
        tolerance = random_tolerance(scene)
        drawn_anew = tolerance is not None and tolerance.draw == "contact"
        self.redrawn = np.repeat(tolerance.variances, 2) if tolerance and drawn_anew else np.zeros(0)
        first = start_pieces(scene)
        self.live, d = first.mean.shape
        self.flown = self.kept = self.struck = self.merged = 0
        size = max(level.cut, self.live)
        self.buffers, self.after = buffers(size, d), empty(2 * size, d)
        start = self.buffers.start
        start.weight[: self.live], start.label[: self.live] = first.weight, ON_ORBIT
        start.mean[: self.live] = first.mean
        start.mean[: self.live, :PLAIN] += np.array([orbit.tau[0], *orbit.after[0]])
        start.covariance[: self.live] = first.variance

    def fly(self) -> Mixture:
        """Fly to the next impact; returns the components before they were split, with the noise of the flight."""
        self.discarded += add_noise(self.constants, self.live, self.buffers)
        start, n = self.buffers.start, self.live
        whole = Mixture(
            start.weight[:n].copy(), start.mean[:n].copy(), start.covariance[:n].copy(), start.label[:n].copy()
        )
        self.flown = fly(self.constants, self.live, self.buffers, self.level)
        return whole

    def strike(self, own: int) -> None:
        """Apply the restitution map; `own` is the orbit's impact, ``mesh * side``."""
        b = self.buffers
        self.kept, endless = _strike(self.constants, self.redrawn, b.start, b.image, self.flown, own, self.after)
        self.discarded += endless
        self.struck += 1

    def merge(self) -> None:
        """Merge the components that lie together after the impact."""
        self.live = reduce(self.after, self.kept, self.level.components, self.buffers.start)
        self.merged += 1
