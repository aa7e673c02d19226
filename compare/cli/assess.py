"""The command that answers an engineer: does it rattle, how hard, what helps."""

from typing import Any

import click

from rattle.compare.cli import shared
from rattle.compare.cli.shared import EXIT_NOT_MET, Begin, say, say_lines
from rattle.scene import Scene

ASSESS_BUDGET_HELP = "Processor seconds, all threads together; compiling is not counted."
REQUIRE_HELP = "Exit 3 unless it holds: a limit such as 'rate_above < 50', in the page's units."


@click.command()
@shared.SCENE_AND_SIGMA
@shared.real("budget", ASSESS_BUDGET_HELP, 60.0)
@click.option("--require", metavar="LIMIT", help=REQUIRE_HELP)
@shared.real("slow", "Speed below which an impact is slow.", 0.1)
@shared.SEED_AND_WORKERS
@shared.report("reports/NAME-assess", "assess.page", shared.JSON_ALONE)
def assess(base: Scene, begin: Begin, seed: int, **settings: Any) -> None:
    """Say whether gears rattle, how hard, and what helps.

    And whether a closure can be used on them. A first answer after some seconds, then a better one
    within the budget; the page has the pictures. SCENE is a TOML file, DAT21 if none is given.

    Exit codes: 0 answered; 2 bad input; 3 --require is not met, or not decided.
    """
    from rattle.compare.assess.assess import REFINED_FROM, assess_in_rounds
    from rattle.compare.assess.requirement import Fulfilment

    rounds = assess_in_rounds(base, **settings, rng=seed, progress="assess")
    results = begin()
    told: list[str] = []
    for assessment in rounds:
        results.write(assessment, **settings, seed=seed)
        results.overwrite = True  # from now on the page is this command's own
        refines = not told and settings["budget"] >= REFINED_FROM and not results.as_json
        if refines:
            told = assessment.answer
            say_lines(told)
            say("A first answer; its page is written. Now the same with more runs.", err=True)
    results.say([text for text in assessment.answer if text not in told], assessment.to_dict)
    if assessment.fulfilment not in (None, Fulfilment.MET):
        raise click.exceptions.Exit(EXIT_NOT_MET)
