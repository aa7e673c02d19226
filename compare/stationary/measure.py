"""The public entry: the stationary motion of a scene, simulated or, where nothing is random,
exact."""

import math
from collections.abc import Sequence
from dataclasses import replace

import pandas as pd

from rattle.compare.report.render import render_text
from rattle.compare.stationary.result import Stationary
from rattle.compare.stationary.verdicts import (
    choose_closures,
    default_closures,
    law_of,
    values_of,
)
from rattle.montecarlo.long_run import AtRest, BurnInError, long_run
from rattle.montecarlo.long_run.estimates import groups, most_unseen
from rattle.montecarlo.long_run.run import ASKED, refuse_burn_in, usual_paths
from rattle.montecarlo.seed import Rng, read_seed
from rattle.montecarlo.settings import is_random
from rattle.scene import Scene, check_scene, compile_ahead, line
from rattle.scene.long_orbit import IRREGULAR, PERIODIC, Attractor, attractor
from rattle.scene.numpy_errors import numpy_defaults
from rattle.scene.progress import do

ATTRACTOR_STARTS = 12  # orbits that are followed to find the attractors of a scene without noise
ESTIMATE_COLUMNS = [
    "value",
    "se",
    "low",
    "high",
    "autocorrelation",
    "se_batches",
    "effective_paths",
]


@numpy_defaults
def stationary(
    scene: Scene,
    *,
    accuracy: float | None = None,
    periods: int | None = None,
    quantities: Sequence[str] = ASKED,
    paths: int | None = None,
    burn_in: int | None = None,
    slow: float = 0.1,
    resolve: float | None = None,
    budget: float | None = None,
    closures: Sequence[str] | None = None,
    rng: Rng = 0,
    workers: int = 1,
    progress: str | None = None,
) -> Stationary:
    """The stationary motion of a scene, with errors.

    Rates, speeds, energies, and the share of slow impacts.
    Where teeth chatter, most impacts are too slow to matter: ``rate_above`` and ``speed_above`` are
    of impacts that are not slow.

    Parameters
    ----------
    scene : Scene
        What is modelled.
    accuracy : float, optional
        Largest half width of the 95 % intervals of `quantities`, over their value; 0.01 by default.
    periods : int, optional
        Periods of the excitation on each path after the burn-in, in place of an accuracy.
    quantities : sequence of str
        Quantities that the accuracy is for.
    paths : int, optional
        Independent paths, 16 or more; 64 by default, and 80 where each is a gear set with
        backlashes of its own.
    burn_in : int, optional
        Periods to leave out before; found by tests by default.
    slow : float
        Speed below which an impact counts as slow.
    resolve : float, optional
        Speed down to which impacts at a mesh that is pressed shut are followed one by one; an
        eighth of `slow` by default, 0 for all of them.  Slower ones change ``rate``, ``flight``,
        ``speed`` and ``slow_share``, which are of the impacts that are followed; the energy that
        they lose is known, and counted.
    budget : float, optional
        Seconds of processor time that the simulation may take, all threads together; compiling is
        not counted.  When it ends, what there is is returned, with wider intervals.  Without it,
        what is expected to take more than an hour is refused.
    closures : sequence of str, optional
        Closures that ``verdicts`` of the result judges, by default all that apply to the scene;
        computed when that is asked for.
    rng : int, SeedSequence, Generator or BitGenerator
        Seed.  The result is the same bit for bit for any number of workers.  A generator of numpy
        gives a child of its seed sequence, another one each time that it is passed.
    workers : int
        Threads.
    progress : str, optional
        Label of a progress bar on a terminal or in a notebook; with it the expected time is logged
        first.

    Returns
    -------
    Stationary
        Exact values where nothing is random and the motion comes to rest or is periodic.

    Raises
    ------
    InputError
        For a setting that cannot be run.
    BurnInError
        If the motion does not forget its start, and there is no budget, or all that the paths say
        of a rate, speed or energy is that it may be 0, because they stay on several attractors:
        says how long the burn-in must be, and which attractors there are without noise.

    Examples
    --------
    >>> from rattle.scene import DAT21
    >>> found = stationary(Scene.from_gears(DAT21, sigma=0.5), periods=64, paths=64)
    >>> found.kind, bool(found.table.loc["rate", "se"] < 0.02)
    ('simulated', True)
    """
    check_scene(scene)
    compile_ahead.expect("stationary", len(scene.drive))
    chosen = default_closures(scene) if closures is None else closures
    named = choose_closures("closures", chosen, scene)
    rng = read_seed(rng)
    do("stationary: the motion without noise")
    orbit = attractor(scene)
    if not is_random(scene) and (exact := _exact(scene, orbit, slow, named)) is not None:
        return exact
    try:
        run = long_run(
            scene,
            accuracy=accuracy,
            periods=periods,
            quantities=quantities,
            paths=usual_paths(scene) if paths is None else paths,
            burn_in=burn_in,
            slow=slow,
            resolve=resolve,
            budget=budget,
            rng=rng,
            workers=workers,
            progress=progress,
        )
    except AtRest as rest:
        resting = _resting(scene, orbit, slow, named)
        return resting if scene.sigma == 0.0 else _seen_at_rest(resting, rest)
    except BurnInError as refused:
        kinds = _attractors(scene, orbit)
        if len(kinds) == 1:
            raise
        raise _name_attractors(refused, kinds, scene) from refused
    do("stationary: the errors of all quantities")
    table = pd.DataFrame(run.estimates, index=ESTIMATE_COLUMNS).T.rename_axis("quantity")
    if run.is_scattered:  # the variance of the estimate is that between gear sets
        table["autocorrelation"] = math.nan
    settled = run.burn_in
    kinds = [] if settled.reached else _attractors(scene, orbit)
    says_something = (table["low"].reindex(ASKED) > 0.0).all()
    if len(kinds) > 1 and settled.keeps_apart and not says_something:
        never_met = refuse_burn_in(settled.periods, settled.drift, settled.apart)
        raise _name_attractors(never_met, kinds, scene)
    attractors = _describe(kinds, scene) if len(kinds) > 1 else ""
    sentence = line(render_text("stationary/said.j2", run=run, orbit=orbit, attractors=attractors))
    return Stationary(scene, "simulated", sentence, table, run, orbit, slow, named)


def _exact_table(values: dict[str, float]) -> pd.DataFrame:
    """A table of values without errors; NaN where there is none."""
    value = pd.Series(values, name="value").rename_axis("quantity")
    table = value.to_frame().assign(se=0.0 * value, low=value, high=value)
    return table.reindex(columns=ESTIMATE_COLUMNS)


def _resting(scene: Scene, a: Attractor, slow: float, closures: tuple[str, ...]) -> Stationary:
    """A motion without impacts."""
    none = ("rate_above", "rate", "energy_per_period", "power")
    values = {f"{name}{s}": 0.0 for name in none for _, s in groups(scene.stages)}
    meshes = range(1, scene.stages + 1)
    values |= {f"contact_share_mesh{mesh}": a.contact[mesh - 1] for mesh in meshes}
    values |= {f"open_share_mesh{mesh}": 0.0 for mesh in meshes}
    sentence = f"At rest: the motion {a.reason}; there are no impacts and no energy is lost."
    return Stationary(scene, "rest", sentence, _exact_table(values), None, a, slow, closures)


def _seen_at_rest(found: Stationary, rest: AtRest) -> Stationary:
    """A noisy motion of which no impact was seen: bounds in place of exact values."""
    paths, periods = rest.watched
    most = most_unseen(2.0 * math.pi * periods * paths) + rest.left_out
    table = found.table.assign(se=math.nan, low=math.nan, high=math.nan)
    table.loc[table.index.str.startswith("rate"), ["low", "high"]] = 0.0, most
    sentence = render_text(
        "stationary/said.j2",
        orbit=found.orbit,
        paths=paths,
        periods=periods,
        most=most,
        memory=found.scene.correlation_time,
    )
    return replace(found, said=line(sentence), table=table)


def _exact(
    scene: Scene, orbit: Attractor, slow: float, closures: tuple[str, ...]
) -> Stationary | None:
    """The exact values of a scene in which nothing is random; None if it is irregular from every
    start."""
    kinds = _attractors(scene, orbit)
    if len(kinds) > 1:
        why = (
            "several attractors without noise, so that there is no one stationary motion:"
            f" {_describe(kinds, scene)}; that of the scene's own start is the first. Give noise"
            " that connects them"
        )
        raise BurnInError("sigma", scene.sigma, why)
    if orbit.kind == IRREGULAR:
        return None
    if orbit.kind != PERIODIC:
        return _resting(scene, orbit, slow, closures)
    values = values_of(law_of(orbit), scene, slow, orbit.contact)
    sentence = f"Exact: without noise the motion {orbit.reason}."
    if orbit.sticks:
        sentence += (
            " Completed chatter has infinitely many impacts; those are counted up to which it is"
            " followed."
        )
    return Stationary(
        scene, "periodic", sentence, _exact_table(values), None, orbit, slow, closures
    )


def _attractors(scene: Scene, orbit: Attractor) -> list[list[Attractor]]:
    """The attractors without noise, each as found from some of the starts, that of the scene's own
    start first."""
    kinds: list[list[Attractor]] = []
    for end in (orbit, *(attractor(scene, n) for n in range(1, ATTRACTOR_STARTS))):
        if same := [kind for kind in kinds if kind[0].same(end)]:
            same[0].append(end)
        else:
            kinds.append([end])
    return kinds


def _name_attractors(
    refused: BurnInError, kinds: list[list[Attractor]], scene: Scene
) -> BurnInError:
    """A burn-in that was refused, and which attractors there are without noise."""
    why = scene.words.put_into(f"{refused.remedy}. Without noise, {_describe(kinds, scene)}")
    return BurnInError("burn_in", refused.value, why)


def _describe(kinds: list[list[Attractor]], scene: Scene) -> str:
    """Attractors in words, with the share of the starts that lead to each."""
    text = render_text(
        "stationary/attractors.j2",
        kinds=kinds,
        starts=ATTRACTOR_STARTS,
        periodic=PERIODIC,
        values_of=lambda orbit: values_of(law_of(orbit), scene, 0.1),
    )
    return line(text)
