"""Reduces samples to the rows that predictions are compared with: every moment with its standard
error, the bias of the step, and what so few paths cannot have seen."""

import math
from collections.abc import Iterator, Sequence
from itertools import zip_longest
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from rattle.compare.judge.dependent import MomentErrors, errors_of_draws, errors_of_groups
from rattle.compare.judge.samples import PathSamples, check_block
from rattle.compare.judge.sums import SampleSums, standardised
from rattle.montecarlo.statistics.intervals import ABSOLUTE, FEWEST_FOR_SD, ROUNDED_SD
from rattle.montecarlo.statistics.section_statistics import (
    PAIR,
    SINGLE,
    pair_statistics,
    sd_influence,
    single_statistics,
)
from rattle.scene import Floats, InputError

UNSEEN_PATHS = 3.0
"""Paths of which none may be in a sample although their share is this over their number: with 95 %
probability one is (the rule of three)."""

FAR_SDS = 10.0
"""Distance from the mean, in sds, for which it is said what unseen paths could change."""

FEWEST_EFFECTIVE = 10.0
"""Least number of paths on which the error of a skewness or a kurtosis rests, for it to be judged:
the largest deviation alone makes at most a tenth of its variance."""

NO_BIAS_KNOWN = "no bias of the step was measured for this moment"
"""Remark on the rows of which the coarser samples say nothing."""

TAIL_TOO_FEW = "the few largest values make nearly all of its error: no interval can be had"
"""Remark on the rows of such moments."""

REST_OF_BIAS = 1.0 / (2.0**0.5 - 1.0) - 1.0
"""How far the value at step 0 lies from the one that is extrapolated at first order, at most, as a
share of the change from one step to twice the step: for every order from a half on, which is that
of impacts that a discrete path misses."""


def reduce_samples(
    samples: PathSamples,
    coarser: PathSamples | None,
    moments: Sequence[str],
    pairs: Sequence[tuple[int, int]],
    groups: NDArray[Any] | None,
) -> pd.DataFrame:
    """The rows of samples as `rattle.compare.judge.rows.compare_rows` takes them.

    `coarser`: The same at twice the step. `moments`: Which of mean, sd, skew and kurt. `pairs`:
    Numbers of the quantities whose correlations are asked for. `groups`: Of the paths that depend
    on each other; (paths,).
    """
    single, joint, both, coarse = _sum_all(samples, coarser, pairs)
    _check_spread(single, samples.names)
    errors = {}
    if groups is not None:
        errors = errors_of_groups(samples, single, joint, pairs, groups)
    elif samples.draws:
        errors = errors_of_draws(samples)
    values = single_statistics(single)
    parts = []
    for moment in moments:
        error = errors.get(moment) or _error_of(moment, values[f"se_{moment}"], single)
        part = _rows_of(moment, samples.names, values[moment], error, single.n)
        # quantity by quantity
        parts.append(part.iloc[np.arange(len(part)).reshape(-1, len(samples.names)).T.ravel()])
    if coarser is not None:
        steps = _step_changes(single, both, coarse)
        parts = [_corrected(part, steps) for part in parts]
    for (i, j), sums in zip(pairs, joint, strict=True):
        values = pair_statistics(sums)
        error = errors.get(f"rho{i, j}") or MomentErrors(values["se_rho"], 0.0 * sums.n, sums.n)
        names = (f"rho_{samples.names[i]}_{samples.names[j]}",)
        parts.append(_rows_of("rho", names, values["rho"], error, sums.n))
    return pd.concat(parts, ignore_index=True)


def _sum_all(
    samples: PathSamples, coarser: PathSamples | None, pairs: Sequence[tuple[int, int]]
) -> tuple[SampleSums, list[SampleSums], SampleSums | None, SampleSums | None]:
    """One pass through all blocks: single sums, those of each pair, those of both steps together
    where their paths go in pairs, and those of the coarser step alone where they do not."""
    totals: list[SampleSums] = []
    paired = coarser is not None and _same_paths(samples, coarser)
    partners: Iterator[Floats] = iter(coarser.blocks) if paired and coarser else iter(())
    count = 0
    for block, partner in zip_longest(samples.blocks, partners):
        check_block(block, count, samples.names, "samples")
        cells = _cells_of(block)
        with np.errstate(over="ignore", invalid="ignore"):  # what overflows is refused below
            parts = [SampleSums.of_block(cells, cells, SINGLE)]
            parts += [SampleSums.of_block(block[:, :, i], block[:, :, j], PAIR) for i, j in pairs]
        if partner is not None:
            check_block(partner, count, samples.names, "coarser")
            parts.append(SampleSums.of_block(cells, _cells_of(partner), PAIR))
        count += len(block)
        with np.errstate(over="ignore", invalid="ignore"):
            totals = list(map(SampleSums.merge, totals, parts)) if totals else parts
    if count < 2:
        raise InputError("samples", f"{count} paths", "one path has no spread; give more")
    single, *joint = totals
    both = joint.pop() if paired else None
    coarse = None
    if coarser is not None and not paired:
        for block in coarser.blocks:
            check_block(block, 0, samples.names, "coarser")
            cells = _cells_of(block)
            sums = SampleSums.of_block(cells, cells, SINGLE[:3])
            coarse = coarse.merge(sums) if coarse else sums
    return single, joint, both, coarse


def _cells_of(block: Floats) -> Floats:
    """A block with a column for each row and quantity."""
    return block.reshape(len(block), -1)


def _same_paths(samples: PathSamples, coarser: PathSamples) -> bool:
    """Whether the paths of both steps go in pairs, by their number: what pairs have in common is
    measured, so that it does not matter whether they have the same noise."""
    arrays = (samples.array, coarser.array)
    return all(array is not None for array in arrays) and len(arrays[0]) == len(arrays[1])


LEAST_SPREAD = 1e-35
LARGEST_SPREAD = 1e35
"""Range of the spread of a quantity whose eighth power is a double."""


def _check_spread(single: SampleSums, names: Sequence[str]) -> None:
    """Refuse samples of which no two paths differ, and those whose moments are no doubles."""
    spread = single.largest - single.least
    if not (spread > 0.0).any():
        why = "all paths are equal; give each its own noise, or a reduced table with se = 0"
        raise InputError("samples", f"{int(single.n.max()):,} paths", why)
    beyond = (spread > 0.0) & ~((spread >= LEAST_SPREAD) & (spread <= LARGEST_SPREAD))
    if beyond.any():
        cell = int(beyond.argmax())
        bounds = f"{LEAST_SPREAD:g} and {LARGEST_SPREAD:g}"
        why = f"give it in a unit in which its values spread between {bounds}"
        raise InputError(f"samples, spread of {names[cell % len(names)]}", spread[cell], why)


def _error_of(moment: str, se: Floats, single: SampleSums) -> MomentErrors:
    """What the error of a moment is where all paths are independent."""
    n = single.n
    lean = 0.0 * n
    effective = n
    z = standardised(single)
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        if moment == "mean":
            lean = z[3] / np.sqrt(n)
        elif moment == "sd":
            square = np.maximum(z[4] - 1.0, 1e-12)
            lean = (z[6] - 3.0 * z[4] + 2.0) / square**1.5 / np.sqrt(n)
        else:
            # the error of a third or fourth moment rests on the few largest deviations
            power = 6 if moment == "skew" else 8
            reach = np.maximum(single.largest - single.mean[0], single.mean[0] - single.least)
            effective = np.minimum(n, single.sums[power, 0] / reach**power)
    return MomentErrors(se, lean, effective)


def _rows_of(
    moment: str, names: Sequence[str], value: Floats, error: MomentErrors, n: Floats
) -> pd.DataFrame:
    """The rows of one moment of some quantities, row by row."""
    effective = np.nan_to_num(error.effective)
    known = n >= (2 if moment == "mean" else FEWEST_FOR_SD)
    few = known & (effective < FEWEST_EFFECTIVE) & (moment in ("skew", "kurt"))
    rows = len(n) // len(names)
    return pd.DataFrame(
        {
            "row": np.repeat(np.arange(rows), len(names)),
            "quantity": np.tile(names, rows),
            "moment": moment,
            "simulated": value,
            "se": error.se,
            "noise": np.where(known & ~few, error.se, np.nan),
            "paths": n,
            "effective_paths": effective,
            "lean": np.nan_to_num(error.lean),
            "remark": np.where(few, TAIL_TOO_FEW, ""),
        }
    )


def _unseen(moment: str, n: Floats) -> tuple[Floats, Floats]:
    """How much larger and how much smaller than its sampled value a moment may be, in sds.

    For `UNSEEN_PATHS` over n of the paths at `FAR_SDS` sds from the mean, none of them sampled.
    """
    with np.errstate(divide="ignore"):
        share = np.minimum(UNSEEN_PATHS / n, 1.0)
    nil = 0.0 * share
    both_ways = {"mean": share * FAR_SDS, "skew": share * FAR_SDS**3, "rho": share * FAR_SDS**2}
    if moment in both_ways:
        return both_ways[moment], both_ways[moment]
    upwards = np.sqrt(1.0 + share * FAR_SDS**2) - 1.0 if moment == "sd" else share * FAR_SDS**4
    return upwards, nil


def _step_changes(
    single: SampleSums, both: SampleSums | None, coarse: SampleSums | None
) -> dict[str, tuple[Floats, Floats]]:
    """Change of each mean and sd from the step to the coarser one, and the standard error of the
    value that is extrapolated from both."""
    if both is not None:
        v = {order: both.moment(*order) for order in PAIR}
        sd = np.sqrt(np.stack([v[2, 0], v[0, 2]]))
        spreads = {
            "mean": (both.mean, [v[2, 0], v[1, 1], v[0, 2]]),
            "sd": (sd, sd_influence(v, sd[0], sd[1])),
        }
        n = both.n
    else:
        assert coarse is not None
        fine_sd = np.sqrt(single.moment(2, 0))
        coarse_sd = np.sqrt(coarse.moment(2, 0))
        share = single.n / coarse.n  # the spread of a value is that of one path of the finer step
        nil = 0.0 * share
        means = np.stack([single.mean[0], coarse.mean[0]])
        sds = np.stack([fine_sd, coarse_sd])
        of_sd = [
            (sums.moment(4, 0) - sums.moment(2, 0) ** 2) / (4.0 * sums.moment(2, 0))
            for sums in (single, coarse)
        ]
        spreads = {
            "mean": (means, [fine_sd**2, nil, share * coarse_sd**2]),
            "sd": (sds, [of_sd[0], nil, share * of_sd[1]]),
        }
        n = single.n
    changes = {}
    for moment, (values, (fine, across, other)) in spreads.items():
        se = np.sqrt(np.maximum(4.0 * fine - 4.0 * across + other, 0.0) / n)
        changes[moment] = (values[1] - values[0], np.nan_to_num(se))
    return changes


def correct_steps(part: pd.DataFrame, bias: Floats, se: Floats) -> pd.DataFrame:
    """Rows with the measured bias of the step, where it is known; `se` is that of the extrapolated
    value."""
    known = np.isfinite(bias)
    change = np.where(known, bias, 0.0)
    return part.assign(
        bias=change,
        corrected=part["simulated"] - change,
        noise=part["noise"].where(part["noise"].isna() | ~known, se),
        rest=REST_OF_BIAS * np.abs(change),
        remark=part["remark"].where(known, NO_BIAS_KNOWN),
    )


def _corrected(part: pd.DataFrame, steps: dict[str, tuple[Floats, Floats]]) -> pd.DataFrame:
    """Rows with the bias of the step; of higher moments it is not measured."""
    unknown = np.full(len(part), np.nan)
    bias, se = steps.get(part["moment"].iloc[0], (unknown, unknown))
    return correct_steps(part, bias[part.index], se[part.index])


ROW_DEFAULTS: dict[str, Any] = {
    "paths": np.nan,
    "bias": 0.0,
    "rest": 0.0,
    "judged": True,
    "agreement": np.nan,
    "lean": 0.0,
    "remark": "",
}
"""What rows say of a moment if they do not say it."""


def complete_rows(rows: pd.DataFrame, label: str) -> pd.DataFrame:
    """Reduced rows with everything that `rattle.compare.judge.rows.compare_rows` takes."""
    table = rows.assign(**{n: value for n, value in ROW_DEFAULTS.items() if n not in rows})
    if "corrected" not in rows:
        table["corrected"] = table["simulated"] - table["bias"]
    if "noise" not in rows:
        table["noise"] = table["se"]
    if "unit" not in rows:
        table = _add_units(table, label)
    if "unseen_low" not in rows:
        table = _add_unseen(table)
    exact = (table["noise"] == 0.0) | table["paths"].isna()
    counted = table.get("effective_paths", table["paths"])
    table["effective_paths"] = counted.where(~exact, math.inf)
    return table


def _add_units(table: pd.DataFrame, label: str) -> pd.DataFrame:
    """The sd of each quantity as the unit of its means and sds."""
    sds = table[table["moment"] == "sd"].set_index([label, "quantity"])["simulated"]
    at = pd.MultiIndex.from_frame(table[[label, "quantity"]])
    of_sd = sds.reindex(at).to_numpy()
    scaled = table["moment"].isin(["mean", "sd"])
    without = table[scaled & np.isnan(of_sd)]
    if len(without):
        quantity = without["quantity"].iloc[0]
        why = f"a mean is judged in units of the sd; add the column 'sd_{quantity}' with its error"
        raise InputError("samples", quantity, why)
    sizes = np.hypot(table["simulated"].where(table["moment"] == "mean"), of_sd)
    size = sizes.groupby(table["quantity"]).transform("max")
    still = scaled & ~(of_sd > ROUNDED_SD * size)
    return table.assign(
        unit=np.where(scaled, of_sd, 1.0),
        still=np.where(still, ABSOLUTE * size, 0.0),
    )


def _add_unseen(table: pd.DataFrame) -> pd.DataFrame:
    """What so few paths cannot have seen; nothing where the rows are exact."""
    n = table["paths"].to_numpy(float)
    sampled = (table["noise"] > 0.0) & (n > 0.0)
    low = np.zeros(len(table))
    high = np.zeros(len(table))
    for moment in table["moment"].unique():
        here = (sampled & (table["moment"] == moment)).to_numpy()
        low[here], high[here] = _unseen(moment, n[here])
    unit = table["unit"].to_numpy(float)
    return table.assign(
        unseen_low=low * unit,
        unseen_high=high * unit,
        unseen_share=np.where(sampled, UNSEEN_PATHS / np.where(n > 0.0, n, 1.0), 0.0),
        unseen_paths=np.where(sampled, n, 0.0),
    )
