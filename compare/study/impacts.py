"""Studies of the impacts: closures against ensembles, at each point of a grid; the kind ``impacts``
and its tables."""

import hashlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import pairwise
from operator import itemgetter
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from rattle.closure import CLOSURES
from rattle.closure.mean_map import ORDER_RANGE, closures_for, find_closures
from rattle.compare.engine.store import Facts
from rattle.compare.judge.rows import judge_errors
from rattle.compare.judge.verdict import (
    Tolerances,
    Verdict,
    is_accurate,
    is_inaccurate,
    judge,
    unbroken,
)
from rattle.compare.study.cells import (
    BATCH,
    FACTS_STORED,
    Predicted,
    Prediction,
    Sample,
    Sampled,
    check_sample,
)
from rattle.compare.study.design import (
    SETTING_NAMES,
    Placed,
    Point,
    Study,
    join_points,
    list_reasons,
)
from rattle.compare.validation.errors import (
    ON_ITINERARY,
    follower_errors,
    list_errors,
    to_absolute_time,
)
from rattle.montecarlo.statistics.intervals import widest
from rattle.scene import (
    Floats,
    InputError,
    Scene,
    check_keys,
    choice,
    count,
    positive,
    section_names,
)
from rattle.scene.numpy_errors import numpy_defaults
from rattle.scene.text import as_html
from rattle.scene.units import with_units

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure

TABLES = ("errors", "sections", "correlation", "validity", "paired", "cost", "reasons")
"""Tables of a study of impacts, each a Parquet file."""
SMALL = ("correlation", "validity", "cost", "reasons")  # those of them that are written as CSV too
FLAGS = {"common_noise": True, "on_itinerary": False, "near_branches": False}
"""Those of the fields of `Study` that are true or false, with their defaults."""
BESIDE = ("rate", "energy")
"""Rows of ``sections`` that are no section quantities."""
KEYS = ("impacts", "closures", "order", *SETTING_NAMES, *FLAGS, "within")
TITLE = "study"
PAGE = "rattle.compare.study.impacts_page"


@numpy_defaults
@dataclass(frozen=True)
class Tables:
    """The tables of a study of impacts, from `load_study`.

    Attributes
    ----------
    study : Study
        What was asked for.
    record : dict
        The manifest.
    errors, sections, correlation, validity, paired, cost, reasons : DataFrame
        Errors of the closures with verdicts; section moments; correlation coefficients; range of
        validity; differences of neighbours; times; why a cell could not be computed.

    Examples
    --------
    >>> from rattle import load_study
    >>> sorted(load_study("reports/studies/noise").errors["closure"].unique())
    ['branching', 'corrected', 'published', 'saltation']
    """

    study: Study
    record: Facts
    errors: pd.DataFrame
    sections: pd.DataFrame
    correlation: pd.DataFrame
    validity: pd.DataFrame
    paired: pd.DataFrame
    cost: pd.DataFrame
    reasons: pd.DataFrame

    def __repr__(self) -> str:
        """Of which study, and how long its tables are."""
        lengths = ", ".join(f"{name} {len(getattr(self, name)):,}" for name in TABLES)
        return f"{self.study!r}\n  rows: {lengths}"

    def _repr_html_(self) -> str:
        return as_html(repr(self), self.validity.to_html(max_rows=12))

    @property
    def of_all_paths(self) -> pd.DataFrame:
        """The rows of ``errors`` that are about all paths."""
        return self.errors[self.errors["kind"] != ON_ITINERARY]

    @property
    def empty(self) -> bool:
        """Whether there is nothing to compare."""
        return self.errors.empty

    def judged(self, within: Tolerances) -> pd.DataFrame:
        """Judge the errors by other tolerances."""
        share = self.errors["moment"].map({"mean": within.mean, "sd": within.sd})
        tolerance = np.maximum(share * self.errors["unit"], self.errors["still"])
        return judge(self.errors.assign(tolerance=tolerance))

    def to_xarray(self) -> "xr.Dataset":
        """Convert the errors of the closures and the moments of the simulation to a dataset.

        Needs the optional dependency ``xarray`` (``pip install rattle[xarray]``).

        Returns: Dimensions: the first field of each axis, ``impact, quantity, moment`` and, for the
        errors, ``closure``; ``["quantity"].attrs`` holds the unit of each quantity.
        """
        index = [*(axis.names[0] for axis in self.study.axes), "impact", "quantity", "moment"]
        errors = self.of_all_paths.set_index([*index, "closure"])
        columns = ["predicted", "error", "low", "high", "tolerance", "verdict"]
        sections = self.sections[~self.sections["quantity"].isin(BESIDE)].set_index(index)
        simulated = sections[["value", "se"]].rename(columns={"value": "simulated"}).to_xarray()
        return with_units(errors[columns].to_xarray().merge(simulated, join="outer"))

    def plot(self, kind: str = "validity", **at: Any) -> "Figure":
        """Draw a figure of the study's page.

        Keywords are values of the fields that vary besides the first; the table's first where one
        is left out.
        """
        from rattle.compare.study.figures import STUDY_FIGURES, panels

        plot = STUDY_FIGURES[choice("kind", kind, STUDY_FIGURES)]
        rows = getattr(self, plot.table)
        for fixed, part in panels(self.study, rows, len(rows)):
            if at.items() <= fixed.items():
                return plot.figure(self, part)
        raise InputError(
            "kind", kind, f"there is nothing to draw{f' at {at}' if at else ''} in this study"
        )


RESULT = Tables


def compare_paired(one: Sampled, other: Sampled) -> pd.DataFrame:
    """Differences of section means and sds between two runs on common random numbers, with their
    standard errors.

    The standard error is that of the mean of the batches' differences.  For means, the differences
    are first regressed on the batches of the control variate, whose expectation is zero.

    Returns: Columns ``impact, quantity, moment, difference`` (`other` less `one`), ``se`` and
    ``se_independent``, the standard error that independent runs without a control variate would
    have.
    """
    tables = []
    for quantity in section_names(one.scene.stages):
        for moment, prefix in (("mean", ""), ("sd", "sd_")):
            first = _batches(one, moment, quantity)
            second = _batches(other, moment, quantity)
            batches = min(first.shape[1], second.shape[1])
            first = first[:, :batches]
            second = second[:, :batches]
            left = _centre(second - first)
            freedom = batches - 1
            if moment == "mean":
                control = _centre(_batches(other, "control", quantity)[:, :batches])
                product = (left * control).sum(axis=1, keepdims=True)
                square = (control * control).sum(axis=1, keepdims=True)
                slope = np.divide(product, square, out=np.zeros_like(square), where=square > 0.0)
                left = left - slope * control
                freedom -= 1
            # a standard error needs at least one degree of freedom
            se = np.sqrt((left**2).sum(axis=1) / freedom / batches) if freedom > 0 else np.nan
            alone: Floats | float = np.nan
            if batches > 1:
                variances = first.var(axis=1, ddof=1) + second.var(axis=1, ddof=1)
                alone = np.sqrt(variances / batches)
            difference = other.section[prefix + quantity] - one.section[prefix + quantity]
            columns = {"difference": difference, "se": se, "se_independent": alone}
            table = pd.DataFrame({"quantity": quantity, "moment": moment, **columns})
            tables.append(table.reset_index())
    return pd.concat(tables, ignore_index=True)


def _batches(run: Sampled, moment: str, quantity: str) -> Floats:
    """Statistics of the batches of a run, shape (impacts, batches)."""
    return np.stack(list(run.batches[BATCH.format(moment, quantity)]))


def _centre(values: Floats) -> Floats:
    """Deviations from the mean of each row; a run may be too short for any batch."""
    if values.shape[1] == 0:
        return values
    return np.asarray(values - values.mean(axis=1, keepdims=True))


Triple = tuple[Point, Sampled, list[Predicted]]


def combine(study: Study, results: Mapping[str, Any]) -> Tables:
    """Compute the tables of a study from the results of its cells, by key."""
    rows = sum(
        2 * len(section_names(cell.scene.stages)) * study.impacts
        for point in study.points
        for cell in point.predictions
        if cell.key in results
    )
    # 95 % simultaneous coverage over the study (Bonferroni)
    z = widest(rows)
    points = [
        (
            point,
            results[point.sample.key],
            [results[cell.key] for cell in point.predictions if cell.key in results],
        )
        for point in study.points
        if point.sample and point.sample.key in results
    ]
    errors = join_points(
        _judge_points(study, points, z), ("closure", "kind", "moment", "verdict", "judged")
    )
    sections = join_points((point.coordinates, _list_moments(run)) for point, run, _ in points)
    return Tables(
        study,
        {"errors_sha256": _digest(errors), "sections_sha256": _digest(sections), "z": z},
        errors=errors,
        sections=sections,
        correlation=_correlation(study, points),
        validity=find_validity(study, errors[errors["kind"] != ON_ITINERARY]),
        paired=join_points(_pair_neighbours(study, points)),
        cost=_cost(study, results),
        reasons=list_reasons(study),
    )


def _digest(table: pd.DataFrame) -> str:
    """Compute a digest of the values of a table."""
    return hashlib.sha256(
        pd.util.hash_pandas_object(table, index=False).to_numpy().tobytes()
    ).hexdigest()


def _judge_points(study: Study, points: list[Triple], z: float) -> Iterator[Placed]:
    """Every section mean and sd of every closure at every point: error, interval, verdict.

    Columns: those of `rattle.compare.validation.errors.section_errors`.
    """
    for point, run, predictions in points:
        for prediction in predictions:
            tables = [list_errors([prediction], run, study.within)]
            if prediction.followers and run.followers:
                codes = [
                    np.nan_to_num(s["mesh"] * s["side"])
                    for s in (prediction.section, run.followers.section)
                ]
                tables.append(
                    follower_errors([prediction.followers], run.followers, study.within, *codes)
                )
            for table in tables:
                yield point.coordinates, to_absolute_time(judge_errors(table, z), run.scene)


def _list_moments(run: Sampled) -> pd.DataFrame:
    """Section moments of a simulation: a row for each impact, quantity and moment.

    Moments ``mean, sd, skew`` of the quantities at each path's k-th impact (the Poincaré section at
    the impacts), and the means of ``energy`` (lost at the impact) and of ``rate`` (impacts so far
    over their mean time). Columns: ``impact, quantity, moment, value, se, paths`` (that reached the
    impact), ``followed`` (all simulated paths) and ``agreement`` (share of all paths on the
    noise-free itinerary).
    """
    s = run.section
    since = s["tau"] - run.scene.phase  # stored times are counted from the phase of the start
    rate = s.index.to_numpy() / since
    moments = {
        ("rate", "mean"): (rate, rate * s["se_tau"] / since),
        ("energy", "mean"): (s["energy"], s["se_energy"]),
    }
    absolute = s.assign(tau=run.scene.to_absolute_time(s["tau"].to_numpy()))
    for moment, prefix in (("mean", ""), ("sd", "sd_"), ("skew", "skew_")):
        for q in section_names(run.scene.stages):
            moments[q, moment] = (absolute[prefix + q], s["se_" + prefix + q])
    tables = [
        pd.DataFrame(
            {
                "quantity": quantity,
                "moment": moment,
                "value": value,
                "se": se,
                "paths": s["paths"],
                "followed": run.paths,
                "agreement": s["agreement"],
            }
        )
        for (quantity, moment), (value, se) in moments.items()
    ]
    return pd.concat(tables).reset_index()


def _correlation(study: Study, points: list[Triple]) -> pd.DataFrame:
    """Validity of each closure's correlations: how many of the impacts that it reaches have an
    invalid one.

    Columns: the fields that vary, ``closure, impacts, reached, invalid`` (impacts whose second
    moments are not realizable), ``beyond`` (those of them with ``|rho| > 1``), ``largest`` (|rho|).
    ``branching`` has no rows, nor has a closure of one's own without ``rho1, rho2, ...``: it
    predicts no correlations before impacts.
    """
    rows = []
    for point, prediction in ((p, c) for p, _, predictions in points for c in predictions):
        reached = int(prediction.facts["found"])
        s = prediction.section.iloc[:reached]
        rho = s.filter(regex=r"^rho\d+$").abs()
        none = "agreement" in s or prediction.closure not in CLOSURES
        if none and rho.isna().all(axis=None) and bool(s["realizable"].all()):
            continue
        rows.append(
            {
                **point.coordinates,
                "closure": prediction.closure,
                "impacts": study.impacts,
                "reached": reached,
                "invalid": int((~s["realizable"]).sum()),
                "beyond": int((rho > 1.0).any(axis=1).sum()),
                "largest": float(np.nan_to_num(rho.to_numpy(float)).max(initial=0.0)),
            }
        )
    return pd.DataFrame(rows)


def find_validity(study: Study, errors: pd.DataFrame) -> pd.DataFrame:
    """Range of validity of each closure along the field `along`, for the first k impacts.

    Columns: the other fields that vary, ``closure, impact`` (k), ``accurate`` (the largest value up
    to which every judged moment of the first k impacts is accurate), ``not_inaccurate`` (the
    largest value up to which none is shown to be inaccurate), both NaN if the smallest value fails
    already, and ``ended``: whether at the next value the closure is not shown to be inaccurate but
    predicts fewer than k impacts.
    """
    if not study.along or errors.empty:
        return pd.DataFrame()
    first = study.along
    keys = [*study.others, "closure"]
    verdicts = errors.groupby([*keys, first, "impact"], sort=True)["verdict"].agg(set).reset_index()
    rows = []
    for key, group in verdicts.groupby(keys, sort=False):
        at = group.pivot(index=first, columns="impact", values="verdict").sort_index()
        inaccurate, wrong, inexact = (  # at one of the first k impacts
            at.map(what).astype(bool).cummax(axis=1)
            for what in ({Verdict.INACCURATE}.issubset, is_inaccurate, lambda v: not is_accurate(v))
        )
        for impact in at:
            limits = {
                "impact": impact,
                "accurate": unbroken(at.index, ~inexact[impact]),
                "not_inaccurate": unbroken(at.index, ~wrong[impact]),
                "ended": bool((~inaccurate[impact][wrong[impact]][:1]).any()),
            }
            rows.append(dict(zip(keys, key, strict=True)) | limits)
    return pd.DataFrame(rows).astype({"accurate": float, "not_inaccurate": float})


def _pair_neighbours(study: Study, points: list[Triple]) -> Iterator[Placed]:
    """Differences between neighbours along `along`, with standard errors that use the common random
    numbers.

    Columns: the other fields, ``from, to`` and those of
    `rattle.compare.study.impacts.compare_paired`.  Empty if every point has random numbers of its
    own, or too few paths for a standard error.
    """
    if not study.common_noise or not study.along:
        return
    groups: dict[tuple[Any, ...], list[tuple[float, Sampled]]] = {}
    for point, run, _ in points:
        key = tuple(point.coordinates[name] for name in study.others)
        groups.setdefault(key, []).append((point.coordinates[study.along], run))
    for key, runs in groups.items():
        for (low, one), (high, other) in pairwise(sorted(runs, key=itemgetter(0))):
            table = compare_paired(one, other)
            if table["se"].notna().any():
                at = dict(zip(study.others, key, strict=True))
                yield at | {"from": low, "to": high}, table


def _cost(study: Study, results: Mapping[str, Any]) -> pd.DataFrame:
    """Seconds of each cell on the machine that computed it; not reproducible."""
    rows = [
        {
            **results[cell.key].facts,
            **point.coordinates,
            "what": getattr(cell, "closure", "monte carlo"),
        }
        for point in study.points
        for cell in point.cells
        if cell.key in results
    ]
    columns = dict.fromkeys([*study.names, "what", "seconds", *FACTS_STORED])
    return pd.DataFrame(rows, columns=[*columns])


def read(given: Mapping[str, Any], varying: set[str], scene: Scene) -> Facts:
    """Read the fields of `Study` that ``[study]`` gives; closures that are not named are those that
    the scene of the file can have."""
    settings = {name: given[name] for name in SETTING_NAMES if name in given}
    for name, value in settings.items():
        if name in varying:
            raise InputError(f"study.{name}", value, "varies along an axis too; keep one")
    known = settings.keys() | varying
    if ("paths" in known) == ("accuracy" in known):
        raise InputError("study.paths", settings.get("paths"), "give either paths or accuracy")
    if {"accuracy", "dt"} <= known:
        raise InputError(
            "study.dt", settings.get("dt"), "accuracy chooses the step itself; leave it out"
        )
    closures = given.get("closures", closures_for(scene))
    if not isinstance(closures, list | tuple) or not closures:
        why = f"give a list of {', '.join(CLOSURES)}, or package.module:function of your own"
        raise InputError("study.closures", closures, why)
    names = [r if ":" in str(r) else choice("study.closures", r, CLOSURES) for r in closures]
    within = given.get("within", {})
    if not isinstance(within, Mapping):
        raise InputError(
            "study.within", within, "write it as a table: within = { mean = 0.05, sd = 0.10 }"
        )
    check_keys("study.within", within, Tolerances._fields)
    limits = {name: positive(f"study.within.{name}", value) for name, value in within.items()}
    flags = {name: given.get(name, flag) for name, flag in FLAGS.items()}
    for name, flag in flags.items():
        if not isinstance(flag, bool):
            raise InputError(f"study.{name}", flag, "give true or false")
    return {
        "closures": tuple(dict.fromkeys(names)),
        "impacts": count("study.impacts", given.get("impacts", 12)),
        "order": count("study.order", given.get("order", 4), *ORDER_RANGE),
        "settings": settings,
        "within": Tolerances(**limits),
        **flags,
    }


def cells(
    study: Study, scene: Scene, settings: Facts
) -> tuple[Sample | None, tuple[Prediction, ...], dict[str, str]]:
    """The ensemble of a point, the predictions of the closures that cover its scene, and what
    cannot be computed.

    Without common noise the seed is a digest of the point.
    """
    seed = settings.pop("seed", 0)
    reasons: dict[str, str] = {}
    sample = None
    predictions = []
    try:
        settings |= {"on_itinerary": study.on_itinerary, "near_branches": study.near_branches}
        sample = check_sample(Sample(scene, study.impacts, seed, **settings))
        if not study.common_noise:
            digest = hashlib.sha256(f"{sample.key} {seed}".encode()).digest()
            sample = replace(sample, seed=int.from_bytes(digest[:8], "little"))
    except InputError as error:
        reasons["sample"] = str(error)
    for method in find_closures("study.closures", study.closures):
        own = method if method.own else None
        try:
            method.check(scene)
            predictions.append(
                Prediction(scene, study.impacts, method.name, study.order, own, study.on_itinerary)
            )
        except InputError as error:
            reasons[method.name] = str(error)
    return sample, tuple(predictions), reasons
