"""Judges predicted moments by samples of any simulation."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
from scipy.special import ndtri

from rattle.compare.judge.predictions import (
    PredictedMoments,
    check_labels,
    check_values,
    find_moments,
    read_predictions,
)
from rattle.compare.judge.reference import (
    FAR_SDS,
    complete_rows,
    correct_steps,
    reduce_samples,
)
from rattle.compare.judge.result import Judgement
from rattle.compare.judge.rows import (
    NamedSection,
    compare_rows,
    judge_errors,
    largest_unseen,
    split_column,
    waits_for_branch,
)
from rattle.compare.judge.samples import PathSamples, SampleReader
from rattle.compare.judge.verdict import Tolerances
from rattle.montecarlo.statistics.intervals import CONFIDENCE, half_width, tail_of, widest
from rattle.scene import InputError, count, finite, positive
from rattle.scene.numpy_errors import numpy_defaults
from rattle.scene.text import percent

KINDS = {"impact": "section", "time": "fixed time"}
"""The kind of the rows by what numbers them, as `rattle.validate` calls it; others are called by
their label."""

DIGITS_OF_LEVEL = 12
"""Digits of one less the level: 1 - 0.95 is 0.05, and not what doubles make of it."""

SHARE_FOUND = 0.98
"""Probability, of a normal estimate, with which an error of twice the tolerance is found where
there are enough paths: of a skewed one it is then still 95 %."""

UNSEEN_OF_TOLERANCE = 0.25
"""Share of a tolerance that unseen paths may change at most, for so many to be called enough."""

COLUMNS_BEFORE = ("closure", "kind")
COLUMNS_AFTER = (
    "quantity",
    "moment",
    "predicted",
    "simulated",
    "se",
    "bias",
    "error",
    "low",
    "high",
    "unit",
    "tolerance",
    "verdict",
    "paths",
    "paths_needed",
    "enough_paths",
    "agreement",
    "remark",
)


@numpy_defaults
def judge(
    predicted: Any,
    samples: Any,
    *,
    coarser: Any = None,
    tolerances: Tolerances | None = None,
    level: float = CONFIDENCE,
    names: Sequence[str] | None = None,
    units: Mapping[str, str] | None = None,
    groups: Any = None,
    checks: int | None = None,
) -> Judgement:
    """Judge predicted moments by samples of any simulation.

    Parameters
    ----------
    predicted : DataFrame, mapping, MeanMap or callable
        Moments of each row (an impact, a time, a dose: the index): columns ``x``, ``sd_x``,
        ``skew_x``, ``kurt_x`` (excess) and ``rho_x_y`` of quantities of any names; NaN where
        nothing is predicted.  Several closures as a mapping of names to such tables; or a function
        that returns one, which is called once.
    samples : array, mapping, DataFrame, Dataset, path or iterator
        An array (paths, rows, quantities); a mapping of names to arrays (paths, rows); a table with
        columns ``path``, row and quantities; an xarray Dataset with a dimension ``path``, or
        ``chain`` and ``draw``; a CSV or Parquet file, or a folder of which each file holds whole
        paths; an iterator of blocks of paths in any of these forms, of which one at a time is in
        memory.  Or a table that is reduced already, with columns ``x, se_x, sd_x, se_sd_x, ...,
        paths``; standard errors of 0 are those of an exact reference.  A path that ends has no
        values, NaN, from there on.
    coarser : optional
        Samples at twice the step, on the same noise or another: the bias of the step is estimated
        from the change, and widens the intervals.
    tolerances : Tolerances, optional
        What counts as accurate: 5 % of an sd for means, 10 % for sds, 0.05 for correlations.
    level : float
        Probability with which all intervals of the table hold together.
    names : sequence of str, optional
        Names of the quantities of arrays that have none; of tables, which columns are meant.
    units : mapping of str to str, optional
        Unit of each quantity, for tables and figures.
    groups : str or array-like, optional
        A label for each path, or the column that has it: paths of one group may depend on each
        other, and errors come from the groups.  Shape (paths,).
    checks : int, optional
        Statements that hold together, where the same samples serve for more than this table; by
        default the rows of the table.

    Returns
    -------
    Judgement
        A verdict on every moment; ``answer`` says them in sentences.

    Raises
    ------
    InputError
        For predictions and samples that do not fit together, and values that are none.

    Notes
    -----
    Intervals are those of ``validate``: Student's t, longer on the side to which the sampling
    distribution is skewed (Hall 1992), simultaneous over all rows (Bonferroni).  Without a model,
    rare branches cannot be searched for: n paths exclude with 95 % probability only what more than
    3 / n of all paths do, and the intervals hold for such a share ten sds away from the mean.

    Examples
    --------
    >>> import numpy as np
    >>> rng = np.random.default_rng(7)
    >>> samples = {"x": rng.normal(1.0, 2.0, (20_000, 1))}
    >>> found = judge({"x": 1.0, "sd_x": 3.0}, samples)
    >>> found.table[["moment", "verdict"]].values.tolist()
    [['mean', 'accurate'], ['sd', 'inaccurate']]
    """
    predictions = read_predictions(predicted)
    limits = _check_tolerances(tolerances)
    if not 0.0 < finite("level", level) < 1.0:
        raise InputError("level", level, "must lie between 0 and 1, both excluded")
    label = str(predictions[0].section.index.name or "row")
    given_names = tuple(names) if names is not None else _names_for(samples, predictions)
    read = SampleReader(given_names, label, "samples").read(samples)
    moments = find_moments(predictions, read.names, read.columns)
    check_values(predictions, moments.columns)
    coarse = _read_coarser(coarser, read, label)
    _check_units(units, read, predictions)
    reference = _make_reference(read, coarse, moments, groups, predictions, label)
    statements = len(reference) * len(predictions) if checks is None else count("checks", checks)
    family_error = round(1.0 - level, DIGITS_OF_LEVEL)
    z = widest(statements, family_error)
    given = () if read.reduced is None else read.reduced.columns
    searched = "unseen_low" in given
    table = compare_rows(predictions, reference, limits, label)
    if not searched:
        table["unseen_paths"] = _paths_for_unseen(table)
    table = judge_errors(table, z)
    if not searched:
        waits = waits_for_branch(table)
        table["remark"] = table["remark"].where(~waits, _unseen_remarks(table))
        table["paths_needed"] = table["paths_needed"].where(~waits, _paths_for_room(table))
    table["enough_paths"] = _has_enough(table, tail_of(statements, family_error))
    table["kind"] = KINDS.get(label, label)
    units_of_all = {**read.units, **(units or {})}
    return Judgement(
        table=table[[*COLUMNS_BEFORE, label, *COLUMNS_AFTER]],
        label=label,
        closures=tuple(name for name, _ in predictions),
        z=z,
        level=level,
        tolerances=limits,
        units={name: units_of_all.get(name, "") for name in moments.quantities},
        searched=searched,
        exact=bool((reference["noise"] == 0.0).all()),
        bias_measured=coarse is not None or "bias" in given,
        not_compared=tuple(moments.others),
        unpredicted=tuple(name for name in read.names if name not in moments.quantities),
    )


def _check_tolerances(given: Any) -> Tolerances:
    """The tolerances, each above zero."""
    if given is None:
        return Tolerances()
    if not isinstance(given, Tolerances):
        raise InputError("tolerances", given, "give Tolerances(mean=0.05, sd=0.1)")
    for moment, error in given._asdict().items():
        positive(f"tolerances.{moment}", error)
    return given


def _make_reference(
    read: PathSamples,
    coarse: PathSamples | None,
    moments: PredictedMoments,
    groups: Any,
    predictions: Sequence[NamedSection],
    label: str,
) -> pd.DataFrame:
    """The rows of the samples, of the moments that are predicted."""
    if read.reduced is None:
        places = [(read.names.index(a), read.names.index(b)) for a, b in moments.pairs]
        of_path = _read_groups(groups, read)
        rows = reduce_samples(read, coarse, moments.moments, places, of_path)
        own_labels = _labels_for(predictions, read, rows["row"].max() + 1)
        rows = rows.assign(row=own_labels[rows["row"].to_numpy()]).rename(columns={"row": label})
    else:
        if groups is not None:
            raise InputError("groups", "given", "needs the paths themselves, not a reduced table")
        rows = read.reduced.rename(columns={read.label: label})
        rows = _correct_reduced(rows, coarse, label)
    check_labels(predictions, rows[label].unique().tolist(), label)
    reference = complete_rows(rows, label)
    correlations = [f"rho_{a}_{b}" for a, b in moments.pairs]
    keep = reference["moment"].isin([*moments.moments, "rho"])
    keep &= reference["quantity"].isin([*moments.quantities, *correlations])
    return reference[keep].reset_index(drop=True)


def _names_for(samples: Any, predictions: Sequence[NamedSection]) -> tuple[str, ...] | None:
    """Names of the quantities of an array, in the order of the predicted means; None where they do
    not say."""
    if not isinstance(samples, np.ndarray) or samples.ndim != 3:
        return None
    columns = map(str, predictions[0].section.columns)
    means = [name for name in columns if split_column(name)[0] == "mean"]
    return tuple(means) if len(means) == samples.shape[2] else None


def _read_coarser(coarser: Any, read: PathSamples, label: str) -> PathSamples | None:
    """The samples at twice the step, of the same quantities and rows."""
    if coarser is None:
        return None
    coarse = SampleReader(read.names, label, "coarser").read(coarser)
    if coarse.names != read.names:
        why = f"has other quantities than samples, which are {read.names}"
        raise InputError("coarser", coarse.names, why)
    if (coarse.reduced is None) != (read.reduced is None):
        raise InputError("coarser", "another form", "give it in the form of samples")
    if coarse.array is not None and read.array is not None:
        rows = coarse.array.shape[1]
        wanted = read.array.shape[1]
        if rows != wanted:
            raise InputError("coarser", f"{rows} rows", f"samples have {wanted}")
    return coarse


def _correct_reduced(rows: pd.DataFrame, coarse: PathSamples | None, label: str) -> pd.DataFrame:
    """Reduced rows with the bias of the step, from reduced rows at twice the step."""
    if coarse is None or coarse.reduced is None:
        return rows
    keys = [label, "quantity", "moment"]
    other = coarse.reduced.rename(columns={coarse.label: label}).set_index(keys)
    at = pd.MultiIndex.from_frame(rows[keys])
    bias = other["simulated"].reindex(at).to_numpy(float) - rows["simulated"].to_numpy(float)
    se = np.hypot(2.0 * rows["se"].to_numpy(float), other["se"].reindex(at).to_numpy(float))
    return correct_steps(rows.assign(noise=rows["se"], remark=""), bias, se)


def _read_groups(groups: Any, read: PathSamples) -> Any:
    """The group of each path."""
    if groups is None:
        return None
    if read.array is None:
        why = "needs all paths in memory: read the blocks or files into one array or table first"
        raise InputError("groups", "given", why)
    if isinstance(groups, str):
        if groups not in read.columns:
            raise InputError("groups", groups, "no such column of samples")
        return read.columns[groups]
    values = np.asarray(groups)
    if values.shape != (len(read.array),):
        why = f"give a label for each of the {len(read.array)} paths"
        raise InputError("groups", f"array of shape {values.shape}", why)
    return values


def _check_units(
    units: Mapping[str, str] | None, read: PathSamples, predictions: Sequence[NamedSection]
) -> None:
    """Refuse units in which predictions and samples differ."""
    sides = {"units": dict(units or {}), "samples": read.units}
    sides |= {name: dict(table.attrs.get("units", {})) for name, table in predictions}
    known: dict[str, tuple[str, str]] = {}
    for side, of_side in sides.items():
        for quantity, unit in of_side.items():
            if quantity not in read.names:
                continue
            first, before = known.setdefault(quantity, (side, unit))
            if before != unit:
                why = f"{first} has {before!r}; convert one of them"
                raise InputError(f"unit of {quantity} in {side}", unit, why)


def _labels_for(
    predictions: Sequence[NamedSection], read: PathSamples, rows: int
) -> "np.ndarray[Any, Any]":
    """Labels of the rows of samples: their own, or by their order those of the predictions."""
    if read.labels is not None:
        return np.asarray(read.labels)
    longest = max((table.index for _, table in predictions), key=len)
    if len(longest) != rows:
        why = f"the samples have {rows} rows without labels, and {len(longest)} are predicted"
        raise InputError("samples", f"{rows} rows", why)
    return longest.to_numpy()


def _paths_for_unseen(table: pd.DataFrame) -> pd.Series:
    """Paths of which so small a share is unseen that it changes little of a tolerance."""
    largest = UNSEEN_OF_TOLERANCE * table["tolerance"]
    needed = table["paths"].fillna(0.0) * largest_unseen(table) / largest
    return needed.map(math.ceil, na_action="ignore")


def _paths_for_room(table: pd.DataFrame) -> pd.Series:
    """Paths of which the unseen share leaves a row decided, where what was seen decides it; else as
    many as were counted."""
    seen_low = (table["low"] + table["unseen_low"]).abs()
    seen_high = (table["high"] - table["unseen_high"]).abs()
    room = table["tolerance"] - np.maximum(seen_low, seen_high)
    needed = table["paths"] * largest_unseen(table) / room.where(room > 0.0)
    return needed.map(math.ceil, na_action="ignore").fillna(table["paths_needed"])


def _unseen_remarks(table: pd.DataFrame) -> list[str]:
    """What an unseen share of the paths could change, in words."""
    shift = largest_unseen(table) / table["unit"]
    return [
        f"fewer than {percent(share)} of the paths may be missing from these samples:"
        f" {FAR_SDS:g} sds away they could change this {moment} by {change:.2g}"
        for share, moment, change in zip(table["unseen_share"], table["moment"], shift, strict=True)
    ]


def _has_enough(table: pd.DataFrame, tail: float) -> pd.Series:
    """Whether an error of twice the tolerance would be found with probability `SHARE_FOUND`."""
    z = -ndtri(tail)
    se = table["noise"] / z
    skewed = 1.0 + table["lean"].abs() * (2.0 * z**2 + 1.0) / (6.0 * z)
    half = half_width(table["paths"].fillna(np.inf), tail) * skewed * se
    beside = largest_unseen(table) + table["rest"]
    enough: pd.Series = half + ndtri(SHARE_FOUND) * se + beside <= table["tolerance"]
    return enough
