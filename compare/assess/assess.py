"""The public entry: the four answers of an engineer, first roughly, then as well as a budget
allows."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any, NamedTuple

from rattle.compare.assess.assessment import ASSESSED_IMPACTS, LOUDNESS, Assessment
from rattle.compare.assess.requirement import read_requirement
from rattle.compare.parameters.boundary import boundary
from rattle.compare.parameters.sensitivity import sensitivity
from rattle.compare.stationary.measure import stationary
from rattle.compare.study.parameters import find_parameters
from rattle.montecarlo.kernel.blocks import clock
from rattle.montecarlo.seed import Rng, read_whole_seed
from rattle.scene import Gears, InputError, Scene, check_scene, count, positive
from rattle.scene.numpy_errors import numpy_defaults
from rattle.scene.progress import do
from rattle.scene.threshold import rattle_threshold

ASSESSMENT_BUDGET = 60.0  # processor seconds, by default
FIRST_BUDGET = 12.0  # of the first, rough answer: ten seconds on two cores
REFINED_FROM = 2.0 * FIRST_BUDGET  # budget from which on a second answer is better
LEAST_ASSESS_BUDGET = 5.0
CLOSURES_ASSESSED = ("saltation", "branching")  # README: which closure, when
# a closure is judged at the scene's noise, and where it is wrong there at a tenth of it and between
SEARCHED_DOWN = 10.0
ASSESSED_POINTS = 2
ASSESSED_WIDTH = 0.5
LONG_RUN = "the long run"
LEVERS = "the levers"
NOT_LEVERS = ("sigma", "correlation_time")  # parameters of the noise, which no one can turn


# shares of a budget; the levers take nine scenes or more, each as long as the motion itself
MOTION_SHARE = 0.25
LEVERS_SHARE = 0.5
RANGES_SHARE = 0.25 / len(CLOSURES_ASSESSED)


class _Work(NamedTuple):
    """What all parts of an assessment are given."""

    slow: float
    seed: int
    workers: int
    progress: str | None  # label of the bars


@numpy_defaults
def assess(
    scene: Scene | Gears,
    *,
    budget: float = ASSESSMENT_BUDGET,
    require: str | None = None,
    slow: float = 0.1,
    rng: Rng = 0,
    workers: int = 1,
    progress: str | None = None,
) -> Assessment:
    """Answer what an engineer asks of gears: do they rattle, how hard, what helps.

    And can a closure be used on them.  Each part gets a share of the budget, and its intervals say
    how well it is known; what cannot be known is said in a sentence.

    Parameters
    ----------
    scene : Scene or Gears
        What is modelled; of gears the scene without noise.
    budget : float
        Processor seconds that all of it may take, all threads together, 5 or more; compiling is not
        counted.
    require : str, optional
        A limit, ``"rate_above < 50"``: of a quantity of `stationary`, in the units of the answer.
    slow : float
        Speed below which an impact is slow, dimensionless.
    rng : int, SeedSequence, Generator or BitGenerator
        Seed; a generator of numpy gives a child of its seed sequence, another one each time.
    workers : int
        Threads.
    progress : str, optional
        Label of a progress bar on a terminal or in a notebook.

    Returns
    -------
    Assessment

    Raises
    ------
    InputError
        For a setting that cannot be run; names the field, the value and the remedy.

    Examples
    --------
    >>> from rattle import DAT21, Scene
    >>> found = assess(Scene.from_gears(DAT21, sigma=0.5), budget=5.0, require="power < 1e9")
    >>> str(found.fulfilment)
    'met'
    """
    *_, last = assess_in_rounds(
        scene,
        budget=budget,
        require=require,
        slow=slow,
        rng=rng,
        workers=workers,
        progress=progress,
    )
    return last


def assess_in_rounds(
    scene: Scene | Gears,
    *,
    budget: float,
    require: str | None,
    slow: float,
    rng: Rng,
    workers: int,
    progress: str | None,
) -> Iterator[Assessment]:
    """Check the settings; then give the first, rough assessment, and the one of the whole
    budget."""
    if isinstance(scene, Gears):
        scene = Scene.from_gears(scene, stages=len(scene.tree))
    check_scene(scene)
    if positive("budget", budget) < LEAST_ASSESS_BUDGET:
        raise InputError(
            "budget", budget, f"give {LEAST_ASSESS_BUDGET:g} processor seconds or more"
        )
    positive("slow", slow)
    count("workers", workers, least=1)
    requirement = None if require is None else read_requirement(require, scene.stages)
    work = _Work(slow, read_whole_seed(rng), workers, progress)
    blank = Assessment(scene, rattle_threshold(scene), budget=budget, requirement=requirement)

    def rounds() -> Iterator[Assessment]:
        """A first assessment within `FIRST_BUDGET`, and one of what is left of a larger budget."""
        began = clock()
        rough = _assess_within(blank, work, min(FIRST_BUDGET, budget))
        yield replace(rough, spent=clock() - began)
        left = budget - (clock() - began)
        if budget >= REFINED_FROM and left > 0.0:
            yield replace(_assess_within(rough, work, left), spent=clock() - began)

    return rounds()


def _assess_within(known: Assessment, work: _Work, budget: float) -> Assessment:
    """The assessment with every part measured within its share of a budget; a long run that is
    exact, or as well known as is asked for, is kept."""
    scene = known.scene
    missing: dict[str, str] = {}

    def measure(
        part: str, question: Callable[..., Any], share: float, shown: str = "", **settings: Any
    ) -> Any:
        """A part of the answer; None, and the reason, where it cannot be known.

        `shown`: What its bar says in place of the part.
        """
        do(f"assess: {part}")
        try:
            return question(
                scene,
                budget=share * budget,
                rng=work.seed,
                workers=work.workers,
                progress=work.progress and f"{work.progress}: {shown or part}",
                **settings,
            )
        except InputError as error:
            missing[part] = f"{error.field}: {error.remedy}"
            return None

    motion = known.motion
    run = motion.run if motion else None
    if motion is None or (run is not None and run.reach is not None and not run.reach.reached):
        motion = measure(LONG_RUN, stationary, MOTION_SHARE, slow=work.slow, closures=())
    levers = None
    if motion is not None and motion.kind != "rest":
        levers = measure(
            LEVERS,
            sensitivity,
            LEVERS_SHARE,
            slow=work.slow,
            quantities=[LOUDNESS, "rate_above"],
            parameters=[name for name in find_parameters(scene) if name not in NOT_LEVERS],
        )
    closures = [
        measure(
            f"`{closure}`",
            boundary,
            RANGES_SHARE,
            f"the range of {closure}",
            closure=closure,
            impacts=ASSESSED_IMPACTS,
            between=(scene.sigma / SEARCHED_DOWN, scene.sigma) if scene.sigma else None,
            points=ASSESSED_POINTS,
            width=ASSESSED_WIDTH,
        )
        for closure in CLOSURES_ASSESSED
    ]
    return replace(
        known,
        motion=motion,
        levers=levers,
        closures=tuple(edge for edge in closures if edge is not None),
        missing=missing,
    )
