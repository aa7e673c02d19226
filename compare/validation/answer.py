"""The results of a validation in sentences: what to take, what it costs, how accurate it is; and
the paper's argument.

Accuracy decides, and where a closure is accurate the counted work of both sides; no time that a
clock measured.
"""

import math
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import pandas as pd

from rattle.closure import refusals
from rattle.compare.judge.rows import BY_SIZE
from rattle.compare.judge.verdict import JUDGED, in_words, unbroken
from rattle.compare.report.render import render_sentences
from rattle.compare.report.texts import join_words, name_all, name_wheels, span
from rattle.compare.validation import comparison
from rattle.compare.validation.comparison import Comparison, Sweep
from rattle.compare.validation.errors import HALF_OF_PATHS, SIMULATED, first_failure
from rattle.compare.validation.tables import duration_words, motion_sentence
from rattle.compare.validation.transient import describe_transient
from rattle.montecarlo.branches.search import SMALLEST
from rattle.montecarlo.diagnostics.diagnostics import UNSEARCHED
from rattle.montecarlo.diagnostics.reach import near_text
from rattle.scene import Scene

SECTION_EXPLAINED = " (Poincaré section at the impacts)"
"""Explains the word section at its first use on a page."""


def sigma_text(v: Comparison) -> str:
    """The noise intensity of a validation to four digits, as the report writes it."""
    return f"{v.scene.sigma:.4g}"


def _largest_rho(validations: Sequence[Comparison], closure: str) -> float:
    rows = pd.concat([v.correlation for v in validations])
    return float(np.fmax(rows[rows["closure"] == closure]["rho"].abs().max(), 0.0))


def advice(
    validity: pd.DataFrame, impacts: int, speed: pd.DataFrame, gears: str = "gear pair"
) -> str:
    """What to take for some gears at each noise intensity that was asked for, in one sentence."""
    takes = []
    for sigma, rows in validity.groupby("sigma", sort=False):
        whole = speed.query("sigma == @sigma and impacts == @impacts")
        timed = whole["speed_up"].isna()
        whole = whole.assign(timed=timed).sort_values(["timed", "closure_seconds"])
        slower = whole["resolved"] & (whole["speed_up"] < 1.0)
        takes.append(
            {
                "sigma": sigma,
                "worth": list(whole[~slower]["closure"]),
                "slower": list(whole[slower]["closure"]),
                "timed": timed.all(),
                "undecided": list(rows[rows["not_inaccurate"] == impacts]["closure"]),
                "best": rows.sort_values("accurate", ascending=False, kind="stable").iloc[0],
            }
        )
    (sentence,) = render_sentences(
        "validation/advice.j2", takes=takes, impacts=impacts, gears=gears
    )
    return sentence


def cost_sentence(
    simulation: pd.DataFrame,
    speed: pd.DataFrame,
    impacts: int,
    duration: str,
    over: pd.DataFrame | None,
) -> str:
    """What a simulation and the closures cost in counted work.

    `duration`: How long the motion is in physical units, as "the first 24 ms", if that is known.
    """
    at = speed["impacts"] == impacts
    longest = speed[at].groupby("closure", sort=False)["closure_seconds"].max()
    measured = longest.index.isin(speed[at & speed["speed_up"].isna()]["closure"])
    cheaper: dict[object, list[str]] = {}
    if over is not None:
        slower = over["resolved"] & (over["speed_up"] < 1.0) & (over["impacts"] == impacts)
        for closure, sigmas in over[slower].groupby("closure", sort=False)["sigma"]:
            cheaper[closure] = [f"{sigma:.4g}" for sigma in sigmas]
    (sentence,) = render_sentences(
        "validation/cost.j2",
        impacts=impacts,
        motion=duration,
        # exact flights are what `rattle simulate` takes
        schemes=sorted(set(simulation["scheme"]) - {"exact-flight"}),
        wanted=comparison.WANTED,
        simulations=simulation.to_dict("records"),
        near_text=near_text,
        counted=longest[~measured].to_dict(),
        measured=longest[measured].to_dict(),
        cheaper=cheaper,
    )
    return sentence


def validity_sentence(validity: pd.DataFrame, impacts: int) -> str:
    """Up to which noise intensity each closure is accurate at all impacts, in one sentence."""
    closures_by_phrase: dict[str, list[str]] = {}
    for closure, rows in validity.groupby("closure", sort=False):
        at = rows.sort_values("sigma").set_index("sigma")
        accurate, not_wrong = (
            unbroken(at.index, at[name] == impacts) or math.nan
            for name in ("accurate", "not_inaccurate")
        )
        ended = bool((at[at["not_inaccurate"] < impacts]["cause"][:1] == "ended").any())
        exact = at.index[at["accurate"] == impacts]
        phrase = in_words("σ", list(at.index), accurate, not_wrong, ended=ended, exact=exact)
        closures_by_phrase.setdefault(phrase, []).append(str(closure))
    shares = [f"{name_all(names)}: {phrase}" for phrase, names in closures_by_phrase.items()]
    sigmas = validity["sigma"]
    return (
        f"Range of validity, for every section mean and sd{SECTION_EXPLAINED}"
        f" of {impacts} impacts at"
        f" {sigmas.nunique()} noise intensities ({span(sigmas, '.4g')}) — {'; '.join(shares)}."
    )


def itinerary_sentence(validity: pd.DataFrame, impacts: int) -> list[str]:
    """What each closure is worth on its itinerary, and over all paths, in one sentence; and where
    there is no bulk."""
    reaches = {}
    for closure, rows in validity.groupby("closure", sort=False):
        at = rows.sort_values("sigma").set_index("sigma")
        on, all_paths = (
            unbroken(at.index, at[name] == impacts) for name in ("itinerary_accurate", "accurate")
        )
        if on is not None:
            leaving = at["leaving"].loc[on]
            reaches[closure] = {"sigma": on, "all_paths": all_paths, "leaving": leaving}
    least = validity.groupby("sigma")["leaving"].min()
    return render_sentences(
        "validation/itinerary.j2",
        reaches=reaches,
        lost=[f"{sigma:.4g}" for sigma in least.index[least > 1.0 - HALF_OF_PATHS]],
        alone=len(least) == 1,
        smallest=SMALLEST,
    )


UNFINISHED = (
    "The range of validity over σ is missing: it was still being measured when this page was"
    " written."
)


def describe_left_out(swept: Sweep, budget: float) -> list[str]:
    """How many noise intensities of a sweep its budget has left out, and what all of them would
    take."""
    return render_sentences("validation/left_out.j2", swept=swept, budget=budget)


def explain_missing(scene: Scene, shown: Iterable[str]) -> list[str]:
    """Which closures cannot be applied to a scene, and why."""
    missing = [f"`{name}` ({why})" for name, why in refusals(scene).items() if name not in shown]
    return [f"Left out: {join_words(missing)}."] if missing else []


def answer(validations: Sequence[Comparison], swept: Sweep | None = None) -> list[str]:
    """The result of validations of one scene in sentences.

    Advice at their own noise intensities, cost, accuracy, realizability, and agreement of
    itineraries.

    `swept`: Ranges of validity over the noise intensity; they add a second sentence, see
    `validity_sentence`. Returns: Four sentences; one before them where the first impacts are a
    transient; one more with `swept`, of a scene that was made from gears (the motion in physical
    units), where paths leave the itinerary, and where closures cannot be applied to the scene.
    """
    first = validations[0]
    impacts = first.run.impacts
    impossible = []
    possible = []
    for closure in first.predictions:
        failures = [
            (closure, sigma_text(v), failure)
            for v in validations
            if (failure := first_failure(v.correlation, closure))
        ]
        if failures:
            impossible.append(failures[-1])
        # a mixture always is, and not there
        elif any(closure in set(v.correlation["closure"]) for v in validations):
            possible.append(closure)
    shares = [max(v.run.agreement[name].iloc[-1] for name in v.predictions) for v in validations]
    raised: dict[str, list[str]] = {}
    for v in validations:
        for closure, why in v.failed.items():
            raised.setdefault(f"`{closure}` {why}", []).append(sigma_text(v))
    sentences = render_sentences(
        "validation/answer.j2",
        explained="" if swept else SECTION_EXPLAINED,
        impacts=impacts,
        within=first.tolerances,
        moments=[(sigma_text(v), _count_moments(v)) for v in validations],
        by_size=[(sigma_text(v), counts) for v in validations if (counts := _count_by_size(v))],
        BY_SIZE=BY_SIZE,
        impossible=impossible,
        possible=possible,
        largest_rho=_largest_rho(validations, SIMULATED),
        last=len(first.run.section),
        shares=[
            (sigma_text(v), share)
            for v, share in zip(validations, shares, strict=True)
            if share < 1.0
        ],
        raised=raised,
        scene=first.scene,
    )
    speed = comparison.measure_speeds(validations)
    over = swept.speed if swept else None
    validity = comparison.find_validities(validations)
    costs = comparison.simulation_costs(validations)
    transient = describe_transient(first.scene)
    return [
        *([transient] if transient else []),
        advice(validity, impacts, speed, first.scene.words.system),
        *([validity_sentence(swept.validity, impacts)] if swept else []),
        *itinerary_sentence(swept.validity if swept else validity, impacts),
        cost_sentence(costs, speed, impacts, duration_words(first), over),
        *motion_sentence(validations),
        *sentences,
        *explain_missing(first.scene, first.predictions),
        *name_wheels(first.scene),
        *([UNSEARCHED] if first.scene.correlation_time else []),
    ]


def _count_moments(v: Comparison) -> dict[str, dict[Any, int]]:
    """How many section moments of each closure have which verdict."""
    none: dict[Any, int] = dict.fromkeys(JUDGED, 0)
    verdicts = {closure: v.section_rows(closure)["verdict"] for closure in v.predictions}
    return {name: none | column.value_counts().to_dict() for name, column in verdicts.items()}


def _count_by_size(v: Comparison) -> dict[Any, int]:
    """How many verdicts of each closure rest on the size of what does not vary."""
    rows = v.of_all_paths.query("remark == @BY_SIZE")
    return rows["closure"].value_counts(sort=False).to_dict()


def correlation_claim(validations: Sequence[Comparison]) -> str:
    """The paper's argument that the density is not Gaussian because |rho| may exceed 1, compared
    with the evidence."""
    if not {"published", "corrected"} <= validations[0].predictions.keys():
        return ""
    (paragraph,) = render_sentences(
        "validation/claim.j2",
        evidence=[
            (sigma_text(v), v.correlation.query("closure == 'published' and not realizable"))
            for v in validations
        ],
        stages=validations[0].scene.stages,
        corrected=_largest_rho(validations, "corrected"),
        simulated=_largest_rho(validations, SIMULATED),
    )
    return paragraph
