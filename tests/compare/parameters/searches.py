"""Searches that are soon done, and judges of known functions."""

from scenes import dat21

from rattle import boundary, boundary_map, crossing
from rattle.compare.judge.verdict import DECIDED, Verdict
from rattle.compare.parameters.page import make_report
from rattle.compare.parameters.search import JudgedValue, find_changes
from rattle.compare.report.save import save

QUIET = dat21()
LOUD = QUIET.with_sigma(0.5)
WEAK = QUIET.with_sigma(0.01)
QUICK_SEARCH = {"points": 4, "width": 0.3, "tolerances": (0.1, 0.2, 1.0), "rng": 3}
SEARCHES = {
    "boundary": (boundary, QUIET, {"impacts": 3, **QUICK_SEARCH}),
    "crossing": (
        crossing,
        LOUD,
        {
            "quantity": "power",
            "level": 1000.0,
            "over": "amplitude",
            "between": (0.1, 0.6),
            "points": 3,
            "width": 0.2,
            "rng": 3,
        },
    ),
    "map": (
        boundary_map,
        QUIET,
        {"along": "alpha", "reach": (0.4, 1.5), "values": 2, "impacts": 2, **QUICK_SEARCH},
    ),
}


def run(name, **changes):
    """The result of one of the searches, with some settings changed."""
    function, scene, settings = SEARCHES[name]
    return function(**{"scene": scene, **settings, **changes})


def page_of(result, folder):
    """The page of a result as Markdown, from the folder that is written."""
    facts = {"name": "DAT21", "command": "", "commit": "", "versions": {}, "wall_seconds": 1.0}
    save(
        folder / "report",
        make_report(result, facts | {"scene": result.scene.to_dict()}),
        overwrite=False,
    )
    return next((folder / "report").glob("*.md")).read_text()


def verdicts(*changes, doubt=1.0):
    """A judge: accurate up to the first change, wrong up to the next, and so on; undecided within a
    factor of each."""

    def judge(value):
        near = any(c / doubt < value < c * doubt for c in changes)
        verdict = Verdict.UNDECIDED if near else DECIDED[sum(value > c for c in changes) % 2]
        return JudgedValue(value, verdict, 1, 0.0, 0.0, 0.0, "", "")

    return judge


def search(judge, points, width, near=()):
    """The edges from 0.001 to 2, as pairs of the accurate and the wrong value, and how many values
    were judged."""
    changes, judged = find_changes(
        judge, 1e-3, 2.0, points, width, first=Verdict.ACCURATE, near=near
    )
    return [(good.value, bad.value) for good, bad in changes], len(judged)
