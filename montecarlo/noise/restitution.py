"""Random restitution: what each impact of a path draws, or each path for all of its impacts."""

from typing import NamedTuple

import numpy as np

from rattle.montecarlo.noise.philox import RESTITUTION, Key, Word, normals
from rattle.scene import Bools, Floats, Scene
from rattle.scene.compiled import lean_internal, not_inlined

ATTEMPTS = Word(64)  # rejection sampling; of a normal that is cut at 3 sds one in 370 is rejected


class RandomRestitution(NamedTuple):
    """The normal distributions of the restitution of slow impacts, by wheel, for compiled code."""

    random: bool  # whether any restitution is
    mean: Floats  # before they are cut; (wheels,)
    sd: Floats  # 0 for one that is not random; (wheels,)
    # where they are cut; (wheels,)
    least: Floats
    most: Floats
    by_path: Bools  # whether a path draws once for all of its impacts; (wheels,)


def restitution_of(scene: Scene) -> RandomRestitution:
    """The distributions of a scene."""
    laws = [wheel.law for wheel in scene.tree]
    sd, mean, least, most = np.array([(a.sd, a.value, *a.ends) for a in laws]).T.copy()
    by_path = np.array([law.draw == "path" for law in laws])
    return RandomRestitution(bool(sd.any()), mean, sd, least, most, by_path)


@lean_internal
def draw_restitution(r: RandomRestitution, key: Key, path: Word, impact: int, mesh: int) -> float:
    """The restitution of slow impacts that a path has at an impact."""
    not_inlined()
    i = mesh - 1
    mean: float = r.mean[i]
    if r.sd[i] == 0.0:
        return mean
    # draws of a path come before those of its impacts
    draw = i if r.by_path[i] else impact + r.sd.size
    first = Word(draw) * ATTEMPTS
    for attempt in range(ATTEMPTS):
        z = normals(key, path, first + Word(attempt), Word(RESTITUTION))[0]
        epsilon: float = mean + r.sd[i] * z
        if r.least[i] <= epsilon <= r.most[i]:
            return epsilon
    return mean
