"""What a sample cannot have seen: how far branches with few or no sampled paths could move its
means and sds."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from rattle.montecarlo.branches.search import SMALLEST, RareEvents, search_of
from rattle.montecarlo.kernel.mixture import BranchMixture
from rattle.montecarlo.settings import is_random
from rattle.montecarlo.statistics.section_statistics import (
    SectionColumns,
    quantity_at,
    stack_section,
)
from rattle.scene import Floats, Scene

SEEN = 10.0
"""Expected number of sampled paths from which on a branch is in the sample; below, it may be
missing."""


class Unseen(NamedTuple):
    """How far the true means and sds could lie beyond the sampled ones for want of paths on rare
    branches.

    All arrays have the shape (impacts, section quantities).
    """

    # mean_up, mean_down, sd_up, sd_down: largest shifts of the mean and of the sd, upwards and
    # downwards; not negative
    mean_up: Floats
    mean_down: Floats
    sd_up: Floats
    sd_down: Floats
    # of the branches that make the shift of the sd, the most influential first: its own probability
    probability: Floats
    # paths of which `SEEN` are expected on each branch that matters; 0 where there is none
    needed: Floats
    # impacts up to which branches were searched for; beyond, one of up to `SEEN` paths with the
    # motion's whole range is assumed
    known: int

    def either_way(self) -> tuple[Floats, Floats]:
        """Shifts of the mean and of the sd, whichever way is further."""
        return np.maximum(self.mean_up, self.mean_down), np.maximum(self.sd_up, self.sd_down)


PARTS = ("", "sd_", "share_", "paths_")
"""Prefixes of the columns that hold the unseen of a run."""
# share of the largest influence on a row from which on a branch counts for the paths needed
MATTERS = 0.1


def unseen(scene: Scene, columns: SectionColumns, paths: int) -> Unseen:
    """Bound what branches with fewer than `SEEN` expected paths could change.

    A run that samples rare branches has it among its columns already.

    Shapes: `columns` (impacts,).
    """
    if "unseen_tau" not in columns:
        return find_unseen(scene, columns, paths)
    mean, sd, share, needed = (stack_section(columns, f"unseen_{part}").T for part in PARTS)
    return Unseen(mean, mean, sd, sd, share, needed, len(mean))


def unseen_columns(hidden: Unseen) -> dict[str, Floats]:
    """The columns from which `unseen` restores it, whichever way a moment may be off further."""
    values = np.stack([*hidden.either_way(), hidden.probability, hidden.needed])
    return {
        f"unseen_{part}{quantity_at(i)}": values[n, :, i]
        for n, part in enumerate(PARTS)
        for i in range(values.shape[2])
    }


def find_unseen(
    scene: Scene,
    columns: SectionColumns,
    paths: int,
    mixture: BranchMixture | None = None,
    dt: float | None = None,
    itinerary: Sequence[int] | None = None,
) -> Unseen:
    """Bound what branches with fewer than `SEEN` expected paths could change, by a search.

    `mixture`, `dt`: From which the paths are drawn, if not plainly; and its step. `itinerary`: Of
    the paths alone that `columns` are about. Shapes: `columns` (impacts,).
    """
    impacts = len(columns["tau"])
    sd = stack_section(columns, "sd_").T
    nil = np.zeros_like(sd)
    if not is_random(scene) or scene.sigma == 0.0 or paths == 0:
        return Unseen(nil, nil, nil, nil, nil, nil, impacts)
    branches = _branches(scene, impacts, paths, mixture, dt)
    often = branches.probabilities * _boosts(branches, mixture)
    expected = often * paths
    rare = (expected < SEEN) & (expected >= 1e-6)
    added = branches.additions if itinerary is None else branches.additions_on(itinerary)
    often = often[rare]
    probability = branches.probabilities[rare]
    mean, square, _ = added[:, rare]
    up, down, more, less = np.maximum([mean, -mean, square, -square], 0.0).sum(axis=1)
    influence = np.abs(square)
    largest = influence.max(axis=0, initial=0.0)
    counts = (influence > 0.0) & (influence >= MATTERS * largest)
    needed = np.where(counts, (SEEN / often)[:, None, None], 0.0).max(axis=0, initial=0.0)
    chance = nil
    if len(influence):
        chance = np.where(largest > 0.0, probability[influence.argmax(axis=0)], 0.0)
    beyond = slice(branches.known, None)
    share = SEEN / (paths if mixture is None else paths * mixture.plain)
    widest = _range(scene, columns)
    for shift, most in ((up, widest), (down, widest), (more, widest**2)):
        shift[beyond] = np.maximum(shift[beyond], share * most)
    chance[beyond] = share
    needed[beyond] = np.inf
    sd_up = np.sqrt(sd**2 + more) - sd
    sd_down = sd - np.sqrt(np.maximum(sd**2 - less, 0.0))
    return Unseen(
        up, down, np.nan_to_num(sd_up), np.nan_to_num(sd_down), chance, needed, branches.known
    )


def _branches(
    scene: Scene, impacts: int, paths: int, mixture: BranchMixture | None, dt: float | None
) -> RareEvents:
    """Branches of the orbit, and of those branches of which about `SEEN` paths are expected."""
    if mixture is not None:
        return search_of(scene.phase_reduced, impacts, dt).until(SMALLEST)
    return search_of(scene.phase_reduced, impacts).until(
        float(2.0 ** np.ceil(np.log2(SEEN / paths)))
    )


def _boosts(branches: RareEvents, mixture: BranchMixture | None) -> Floats:
    """How many times as often as by plain paths each branch is drawn."""
    return np.array([1.0 if mixture is None else mixture.boost(b.shift) for b in branches.branches])


class Added(NamedTuple):
    """What branches add to the moments of the section that more paths will see and fewer cannot
    have seen."""

    square: Floats  # added to the mean squared deviation from the orbit; not negative;
    # (impacts, quantities)
    # noise, fourth: added to the variance of a path's deviation and of its square as the paths are
    # drawn: to the mean square and fourth power, less where branches are sampled on purpose;
    # (impacts, quantities)
    noise: Floats
    fourth: Floats
    probabilities: Floats  # of these branches


def branches_between(
    scene: Scene,
    columns: SectionColumns,
    fewer: int,
    more: int,
    mixture: BranchMixture | None = None,
    dt: float | None = None,
) -> Added:
    """What branches add of which `more` paths see enough, and `fewer` do not.

    Shapes: `columns` (impacts,).
    """
    impacts = len(columns["tau"])
    if not is_random(scene) or scene.sigma == 0.0:
        nil = np.zeros((impacts, 2 + 2 * scene.stages))
        return Added(nil, nil, nil, np.zeros(0))
    branches = _branches(scene, impacts, more, mixture, dt)
    boosts = _boosts(branches, mixture)
    often = branches.probabilities * boosts
    between = (often >= SEEN / more) & (often < SEEN / fewer)
    added = np.maximum(branches.additions[1:, between], 0.0)
    noise, fourth = (added / boosts[between, None, None]).sum(axis=1)
    return Added(added[0].sum(axis=0), noise, fourth, branches.probabilities[between])


def _range(scene: Scene, columns: SectionColumns) -> Floats:
    """Largest deviation of each quantity that the motion as a whole suggests."""
    size = np.abs(stack_section(columns))
    size[0] = size[1]  # of times, that of a flight
    size += 3.0 * np.nan_to_num(stack_section(columns, "sd_"))
    reach = np.max(size, axis=1, where=np.isfinite(size), initial=0.0)
    reach[2::2] = 2.0 * scene.constants.wheels["wall"]
    return np.asarray(reach)
