"""Decides a claim: its errors with their intervals, with more and more paths until all rows are
decided.

The sizes of all looks are fixed beforehand, and the intervals have simultaneous coverage over all
rows of the claim at all looks (`rattle.montecarlo.looks`).  Other claims do not widen them: a
verdict does not depend on which tests run beside it.
"""

import math
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import pytest

from rattle.closure import Closure, follow, mean_map
from rattle.closure.closure import name_of
from rattle.closure.mean_map import find_closure
from rattle.closure.stationary import Law
from rattle.compare.engine.store import Cell, Content, Store, open_store
from rattle.compare.judge.rows import NamedSection, judge_errors
from rattle.compare.judge.verdict import DECIDED, Tolerances, Verdict
from rattle.compare.stationary.result import plain_unit
from rattle.compare.stationary.study import LongCell
from rattle.compare.stationary.verdicts import CLOSURES_JUDGED, judge_rows, laws, values_of
from rattle.compare.study.cells import Sample
from rattle.compare.thresholds.claim import CLAIM_KINDS, Claim, Settings
from rattle.compare.validation import errors
from rattle.compare.validation.errors import ON_ITINERARY, RULE, TOO_FEW_FOLLOW
from rattle.montecarlo import SCHEMES
from rattle.montecarlo.diagnostics.reference import Simulated
from rattle.montecarlo.kernel.blocks import in_threads
from rattle.montecarlo.long_run.estimates import check_quantity
from rattle.montecarlo.looks import Looks
from rattle.montecarlo.settings import begins
from rattle.montecarlo.statistics.intervals import AGAIN, widest
from rattle.scene import InputError, Scene, choice, section_names
from rattle.scene.numpy_errors import call_users
from rattle.scene.progress import print_on_stderr

Model = str | Closure | Callable[[Scene, int], Any]
"""A closure's name, or a closure of one's own."""


def predict(model: Model, claim: Claim) -> NamedSection:
    """The section moments that a model, as `rattle.closure.mean_map` takes a closure, predicts for
    a claim."""
    method = find_closure("closure" if isinstance(model, str) else "model", model)
    if method.own:
        method = replace(method, predicts=claim.columns)
    # phase-reduced, so that a late start loses no digits
    prediction = mean_map(claim.scene, impacts=claim.impacts[-1], closure=method).phase_reduced
    if claim.kind == ON_ITINERARY:
        orbit = follow(prediction.scene, claim.impacts[-1])
        prediction = prediction.on_itinerary()
        if not begins(prediction.itinerary, (orbit.mesh * orbit.side)[1:].tolist()):
            why = (
                f"{prediction.closure} follows another itinerary than the noise-free path; claim"
                f" kind={CLAIM_KINDS[0]!r}"
            )
            raise InputError("kind", claim.kind, why)
    values = prediction.section.loc[list(claim.impacts), list(claim.columns)]
    for (i, j), value in np.ndenumerate(values.to_numpy(float)):
        if not np.isfinite(value):
            why = f" ({prediction.stopped})" if prediction.stopped else ""
            remedy = (
                "leave it out of the marker's quantities, moments or impacts, or correct the model"
            )
            where = f"{values.columns[j]} of {prediction.closure} at impact {values.index[i]}"
            raise InputError(where, value, f"is not a finite number{why}; {remedy}")
    return NamedSection(prediction.closure, values)


class TimedRun(NamedTuple):
    """A simulation with its cost."""

    run: Any
    computed: bool  # whether it was simulated now; false if it was stored
    seconds: float  # wall time of the simulation; 0 if it was stored


@dataclass
class Thresholds:
    """The settings of a session and the simulations that its tests share."""

    settings: Settings
    config: pytest.Config

    @cached_property
    def folder(self) -> Path | None:
        """Folder of the stored simulations; None if pytest's cache is off and no other folder is
        given."""
        if self.settings.cache is not None:
            return self.settings.cache
        cache = getattr(self.config, "cache", None)
        return None if cache is None else Path(cache.mkdir("rattle"))

    @cached_property
    def store(self) -> Store:
        """Store of the simulations, created when the first one is needed; in memory without a
        folder."""
        return open_store(self.folder)

    def simulate(self, cell: Cell) -> TimedRun:
        """Simulate, or read what an earlier test or session has simulated."""
        computed = []
        started = time.perf_counter()

        def compute(cell: Cell) -> Content:
            computed.append(cell.key)
            return cell.compute(in_threads(self.settings.workers))

        run = self.store.obtain(cell, compute, _past_capture(self.config))
        seconds = time.perf_counter() - started if computed else 0.0
        return TimedRun(run, bool(computed), seconds)


def _past_capture(config: pytest.Config) -> Callable[[str], None]:
    """A function that prints a line on the terminal although pytest captures output."""

    def say(text: str) -> None:
        capture = config.pluginmanager.getplugin("capturemanager")
        with capture.global_and_fixture_disabled() if capture else nullcontext():
            print_on_stderr(text)

    return say


NO_TOLERANCE = Tolerances(0.0, 0.0, 0.0)  # a claim has tolerances of its own


class Decision(NamedTuple):
    """The decision on a claim."""

    table: pd.DataFrame  # its rows, each as of the look that decided it
    runs: tuple[TimedRun, ...]  # the simulation of each look that was taken
    z: float  # half width of the intervals in standard errors


def errors_of(prediction: NamedSection, run: Simulated, claim: Claim) -> pd.DataFrame:
    """The error of every row of a claim that is judged, ``noise`` of one standard error, as
    `list_errors` has them.

    A tolerance in units of the sd has a sampling error as well: an error d is within w sds if ``d -
    w sd`` is negative, and the standard error of this difference is at most ``se(d) + w se(sd)``.
    """
    if claim.kind == ON_ITINERARY:
        same = np.ones(claim.impacts[-1])
        table = errors.follower_errors([prediction], run, NO_TOLERANCE, same, same)
        if (few := table["remark"] == TOO_FEW_FOLLOW).any():
            fewer = f"claim fewer impacts than {table['impact'][few].iloc[0]}"
            why = f"{TOO_FEW_FOLLOW}; {fewer}, or kind={CLAIM_KINDS[0]!r}"
            raise InputError("kind", claim.kind, why)
    else:
        table = errors.list_errors([prediction], run, NO_TOLERANCE)
    rows = pd.DataFrame(claim.rows).merge(table, how="left")[list(table)]
    rows = rows[rows["judged"]].reset_index(drop=True)
    if rows.empty:
        why = f"none of these rows has a verdict; add tau or y1. {RULE}"
        raise InputError("quantities", claim.quantities, why)
    allowed = pd.DataFrame([claim.allowed[moment] for moment in rows["moment"]])
    error = allowed["error"].astype(float)
    in_sd = allowed["in_sd"]
    rows["noise"] += np.where(in_sd, error * rows["se_unit"], 0.0)
    rows["tolerance"] = np.where(in_sd, np.maximum(error * rows["unit"], rows["still"]), error)
    rows["unit"] = rows["unit"].where(rows["still"] == 0.0, 1.0)
    rows["still"] = rows["still"].where(in_sd, 0.0)
    return rows


def merge_looks(before: pd.DataFrame, now: pd.DataFrame) -> pd.DataFrame:
    """Combine the rows of two looks: decided rows are kept, undecided ones are taken from the later
    look."""
    return before.where(before["verdict"].isin(DECIDED), now)


def look_until_decided(
    sizes: Sequence[int], look: Callable[[int], tuple[pd.DataFrame, TimedRun]]
) -> tuple[pd.DataFrame, tuple[TimedRun, ...]]:
    """The rows, each as of the look that decided it, and the simulation of each look that was
    taken."""
    runs = []
    table = None
    looks = Looks(sizes, use_all=True)
    for size in looks:
        now, run = look(size)
        runs.append(run)
        table = now if table is None else merge_looks(table, now)
        needed = table.loc[table["verdict"] == Verdict.UNDECIDED, "paths_needed"].max()
        # once a row is inaccurate the test fails as it is
        failed = (table["verdict"] == Verdict.INACCURATE).any()
        looks.expect(math.nan if failed else needed)
    assert table is not None
    return table, tuple(runs)


def decide(prediction: NamedSection, claim: Claim, session: Thresholds) -> Decision:
    """Compare a prediction with the simulation, with more paths while the claim is undecided.

    Rows that wait for a rare branch which the budget's paths would not show are decided by paths
    near it.
    """
    settings = session.settings
    apart = claim.kind == ON_ITINERARY
    given = claim.accuracy is not None
    # an accuracy has its own number of paths
    sizes = (0,) if given else settings.sizes(claim.paths, claim.budget)
    checks = len(claim.rows) * len(sizes)
    z = widest(checks, settings.false_alarm)
    # a true claim leaves its tolerance on one side only: half of the error is left for what is
    # looked at again
    z_again = widest(checks, AGAIN * settings.false_alarm)

    def look(paths: int) -> tuple[pd.DataFrame, TimedRun]:
        cell = Sample(
            claim.scene.phase_reduced,
            claim.impacts[-1],
            settings.seed,
            claim.scheme,
            None if given else paths,
            claim.accuracy,
            on_itinerary=apart,
        )
        run = session.simulate(cell)
        seconds = run.seconds

        def judge_near(_: pd.DataFrame) -> pd.DataFrame:
            nonlocal seconds
            near = session.simulate(replace(cell, near_branches=True))
            seconds += near.seconds
            return judge_errors(errors_of(prediction, near.run, claim), z_again)

        sampled = run.run.followers if apart else run.run
        table = judge_errors(errors_of(prediction, sampled, claim), z)
        if not (given or apart or SCHEMES[claim.scheme].has_step_bias):
            table = errors.decide_near_branches(table, claim.scene, judge_near, sizes[-1])
        return table, run._replace(seconds=seconds)

    return Decision(*look_until_decided(sizes, look), z)


CLAIM_PATHS = 256  # of a long run
FIRST_PERIODS = (64, 256, 1024)
"""Length of the simulation at the first looks; the later ones take more paths of the last."""


class LongPrediction(NamedTuple):
    """What a model says of the long run."""

    name: str  # of the model
    values: dict[str, float]  # of each quantity


def predict_long(model: Any, scene: Scene, quantities: str | Sequence[str]) -> LongPrediction:
    """What a closure, or a function ``(scene, quantities) -> mapping`` of names to values, says of
    the long run."""
    names = [quantities] if isinstance(quantities, str) else list(dict.fromkeys(quantities))
    if not names:
        why = "give a list, as in quantities=['rate', 'energy']"
        raise InputError("quantities", quantities, why)
    for name in names:
        if name in section_names(scene.stages):
            marker = f"@pytest.mark.rattle(quantities={name!r})"
            why = f"is a moment at each impact: name it in the marker, as in {marker}"
            long_run = "check takes those of the long run, such as 'rate'"
            raise InputError("quantities", name, f"{why}; {long_run}")
        check_quantity("quantities", name, scene.stages)
    if isinstance(model, str):
        label = model
        law = laws(scene, (choice("closure", model, CLOSURES_JUDGED),))[model]
        if not isinstance(law, Law):
            raise InputError("closure", model, f"says nothing of the long run: {law}")
        predicted: Mapping[str, Any] = values_of(law, scene, 0.1)
    elif callable(model):
        label = name_of(model)
        predicted = call_users(model, scene, tuple(names))
    else:
        why = "give a closure's name, or a function (scene, quantities) -> mapping"
        raise InputError("model", model, why)
    values = {}
    for name in names:
        try:
            values[name] = float(predicted[name])
        except (LookupError, TypeError, ValueError):
            why = "is missing or no number; return it, or leave it out"
            raise InputError(f"result of {label}", name, why) from None
        if not np.isfinite(values[name]):
            why = "is not predicted; leave it out of quantities"
            raise InputError(f"result of {label}", name, why)
    return LongPrediction(label, values)


def decide_long(prediction: LongPrediction, claim: Claim, session: Thresholds) -> Decision:
    """Compare a prediction with long runs that grow until every quantity is decided, first in
    length, then in paths.

    ``paths_needed`` are paths of the longest run.
    """
    settings = session.settings
    longest = FIRST_PERIODS[-1]
    paths_of_looks = settings.sizes(CLAIM_PATHS, claim.budget)
    looks = [(periods, CLAIM_PATHS) for periods in FIRST_PERIODS]
    looks += [(longest, paths) for paths in paths_of_looks]
    sizes = {periods * paths: (periods, paths) for periods, paths in looks}
    values = prediction.values
    z = widest(len(values) * len(sizes), settings.false_alarm)
    rows = pd.DataFrame(values.items(), columns=["quantity", "predicted"])
    rows.insert(1, "unit", rows["quantity"].map(plain_unit))
    rows["se_predicted"] = 0.0

    def look(size: int) -> tuple[pd.DataFrame, TimedRun]:
        periods, paths = sizes[size]
        scene = claim.scene.phase_reduced
        run = session.simulate(LongCell(scene, settings.seed, (), periods=periods, paths=paths))
        table = judge_rows(rows, run.run.table, z, size)
        table = table.rename(columns={"periods_needed": "paths_needed"})
        return table.assign(periods=periods, paths=paths), run

    table, runs = look_until_decided(tuple(sizes), look)
    return Decision(table.assign(paths_needed=np.ceil(table["paths_needed"] / longest)), runs, z)
