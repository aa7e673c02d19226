"""The tables of a study of impacts, computed from its stored cells."""

from collections.abc import Mapping
from itertools import pairwise
from typing import Any

import numpy as np
import pandas as pd

from rattle.compare.study.cells import Predicted, Sampled
from rattle.compare.study.design import Point, Study, list_reasons, with_coordinates
from rattle.compare.study.paired import compare_paired
from rattle.compare.study.tables import Tables
from rattle.compare.validation.section_errors import section_errors, to_absolute_time
from rattle.compare.validation.validity_range import is_accurate, is_wrong, unbroken
from rattle.compare.validation.verdict import widest
from rattle.scene.moments import SECTION, STATE

Triple = tuple[Point, Sampled, list[Predicted]]


def combine(study: Study, found: Mapping[str, Any]) -> Tables:
    """Compute the tables of a study from the results of its cells, by key."""
    predictions = sum(cell.key in found for point in study.points for cell in point.predictions)
    z = widest(predictions * 2 * len(SECTION) * study.impacts)  # 95 % simultaneous coverage over the study (Bonferroni)
    points = [
        (point, found[point.sample.key], [found[cell.key] for cell in point.predictions if cell.key in found])
        for point in study.points
        if point.sample and point.sample.key in found
    ]
    errors = _errors(study, points, z)
    return Tables(
        study,
        {"z": z},
        errors=errors,
        sections=_sections(points),
        correlation=_correlation(study, points),
        validity=find_validity(study, errors),
        paired=_pair_neighbours(study, points),
        cost=_cost(study, found),
        reasons=list_reasons(study),
    )


def _errors(study: Study, points: list[Triple], z: float) -> pd.DataFrame:
    """Every section mean and sd of every closure at every point: error, interval, verdict.

    Columns: the fields that vary, then those of `rattle.compare.validation.section_errors.section_errors`.
    """
    parts = []
    for point, run, predictions in points:
        for prediction in predictions:
            table = section_errors(prediction, run, z, study.within)
            parts.append(with_coordinates(point, to_absolute_time(table, run.scene)))
    none = pd.DataFrame({"closure": [], "moment": [], "verdict": [], "judged": np.empty(0, bool)})
    return pd.concat(parts, ignore_index=True) if parts else none


def _sections(points: list[Triple]) -> pd.DataFrame:
    """Section moments of the simulation: a row for each point, impact, quantity and moment.

    Moments ``mean, sd, skew`` of the quantities at each path's k-th impact (the Poincaré section at the impacts),
    and the means of ``energy`` (lost at the impact) and of ``rate`` (impacts so far over their mean time).
    Columns: the fields that vary, ``impact, quantity, moment, value, se, paths`` (that reached the impact),
    ``followed`` (all simulated paths) and ``agreement`` (share of all paths on the noise-free itinerary).
    """
    parts = []
    for point, run, _ in points:
        s = run.section
        since = s["tau"] - run.scene.phase  # stored times are counted from the phase of the start
        rate = s.index.to_numpy() / since
        columns = [
            ("rate", "mean", rate, rate * s["se_tau"] / since),
            ("energy", "mean", s["energy"], s["se_energy"]),
        ]
        columns += [
            (q, moment, s[prefix + q], s["se_" + prefix + q])
            for moment, prefix in (("mean", ""), ("sd", "sd_"), ("skew", "skew_"))
            for q in SECTION
            if run.scene.stages == 2 or q not in STATE[2:]
        ]
        for quantity, moment, value, se in columns:
            late = quantity == "tau" and moment == "mean"
            table = pd.DataFrame(
                {
                    "impact": s.index,
                    "quantity": quantity,
                    "moment": moment,
                    "value": run.scene.to_absolute_time(np.asarray(value)) if late else value,
                    "se": np.asarray(se),
                    "paths": s["paths"].to_numpy(),
                    "followed": run.paths,
                    "agreement": s["agreement"].to_numpy(),
                }
            )
            parts.append(with_coordinates(point, table))
    none = pd.DataFrame(columns=["impact", "quantity", "moment", "value", "se", "paths", "followed", "agreement"])
    return pd.concat(parts, ignore_index=True) if parts else none


def _correlation(study: Study, points: list[Triple]) -> pd.DataFrame:
    """Validity of each closure's correlations: how many of the impacts that it reaches have an invalid one.

    Columns: the fields that vary, ``closure, impacts, reached, invalid`` (impacts whose second moments are not
    realizable), ``beyond`` (those of them with ``|rho| > 1``), ``largest`` (|rho|).  ``branching`` has no rows:
    it predicts no correlations before impacts.
    """
    rows = []
    for point, prediction in ((p, c) for p, _, predictions in points for c in predictions):
        reached = int(prediction.facts["found"])
        s = prediction.section.iloc[:reached]
        rho = s[["rho1", "rho2"]].abs()
        if rho.isna().all(axis=None) and bool(s["realizable"].all()) and prediction.closure == "branching":
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

    Columns: the other fields that vary, ``closure, impact`` (k), ``accurate`` (the largest value up to which every
    judged moment of the first k impacts is accurate), ``not_inaccurate`` (the largest value up to which none is
    shown to be inaccurate), both NaN if the smallest value fails already, and ``ended``: whether at the next value
    the closure is not shown to be inaccurate but predicts fewer than k impacts.
    """
    if not study.along or errors.empty:
        return pd.DataFrame()
    first, keys = study.along, [*study.others, "closure"]
    verdicts = errors.groupby([*keys, first, "impact"], sort=True)["verdict"].agg(set).reset_index()
    found = []
    for key, group in verdicts.groupby(keys, sort=False):
        said = group.pivot(index=first, columns="impact", values="verdict").sort_index()
        inaccurate, wrong, inexact = (  # at one of the first k impacts
            said.map(what).astype(bool).cummax(axis=1)
            for what in ({"inaccurate"}.issubset, is_wrong, lambda v: not is_accurate(v))
        )
        for impact in said:
            found.append(
                {
                    **dict(zip(keys, key, strict=True)),
                    "impact": impact,
                    "accurate": unbroken(said.index, ~inexact[impact]),
                    "not_inaccurate": unbroken(said.index, ~wrong[impact]),
                    "ended": bool((~inaccurate[impact][wrong[impact]][:1]).any()),
                }
            )
    return pd.DataFrame(found).astype({"accurate": float, "not_inaccurate": float})


def _pair_neighbours(study: Study, points: list[Triple]) -> pd.DataFrame:
    """Differences between neighbours along `along`, with standard errors that use the common random numbers.

    Columns: the other fields, ``from, to`` and those of `rattle.compare.study.paired.compare_paired`.  Empty
    if every point has random numbers of its own, or too few paths for a standard error.
    """
    if not study.common_noise or not study.along:
        return pd.DataFrame()
    first, others = study.along, study.others
    groups: dict[tuple[Any, ...], list[tuple[float, Sampled]]] = {}
    for point, run, _ in points:
        key = tuple(point.coordinates[name] for name in others)
        groups.setdefault(key, []).append((point.coordinates[first], run))
    parts = []
    for key, runs in groups.items():
        ordered = sorted(runs, key=lambda pair: pair[0])
        for (low, one), (high, other) in pairwise(ordered):
            table = compare_paired(one, other)
            if table["se"].isna().all():
                continue
            table.insert(0, "to", high)
            table.insert(0, "from", low)
            for name, value in zip(others, key, strict=True):
                table.insert(0, name, value)
            parts.append(table)
    return pd.concat(parts, ignore_index=True) if parts else pd.DataFrame()


def _cost(study: Study, found: Mapping[str, Any]) -> pd.DataFrame:
    """Seconds of each cell on the machine that computed it; not reproducible."""
    rows = []
    for point in study.points:
        if point.sample and (run := found.get(point.sample.key)):
            facts = {name: run.facts[name] for name in ("paths", "path_steps", "sticking_steps", "unfinished")}
            rows.append({**point.coordinates, "what": "monte carlo", "seconds": run.facts["seconds"], **facts})
        for cell in point.predictions:
            if cell.key in found:
                seconds = found[cell.key].facts["seconds"]
                rows.append({**point.coordinates, "what": cell.closure, "seconds": seconds})
    return pd.DataFrame(rows)
