"""The results of a study: tidy tables computed from its stored cells."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
import pandas as pd

from rattle.compare.study.cells import Predicted, Sampled
from rattle.compare.study.design import Point, Study
from rattle.compare.study.paired import compare_paired
from rattle.compare.study.store import Store
from rattle.compare.validation.section_errors import section_errors, to_absolute_time
from rattle.compare.validation.validity_range import is_accurate, is_wrong, unbroken
from rattle.compare.validation.verdict import widest
from rattle.scene.moments import SECTION, STATE


@dataclass(frozen=True)
class Results:
    """The results that are stored so far."""

    study: Study
    samples: list[Sampled | None]  # the ensemble of each point; None if it is not stored
    predictions: list[list[Predicted]]  # the stored predictions of each point

    @classmethod
    def of(cls, study: Study, store: Store) -> "Results":
        """Read the results of a study from a store."""
        samples: list[Sampled | None] = []
        predictions: list[list[Predicted]] = []
        for point in study.points:
            found = store.read(point.sample.key) if point.sample else None
            samples.append(point.sample.restore(found) if point.sample and found else None)
            read = [(p, store.read(p.key)) for p in point.predictions]
            predictions.append([p.restore(s) for p, s in read if s])
        return cls(study, samples, predictions)

    @property
    def empty(self) -> bool:
        """Whether there is nothing to compare."""
        return bool(self.errors.empty)

    @cached_property
    def z(self) -> float:
        """Half width of the intervals in standard errors: 95 % simultaneous coverage over the study (Bonferroni)."""
        checks = sum(len(p) for p in self.predictions) * 2 * len(SECTION) * self.study.impacts
        return widest(checks)

    @cached_property
    def errors(self) -> pd.DataFrame:
        """Every section mean and sd of every closure at every point: error, interval, verdict.

        Columns: the fields that vary, then those of `rattle.compare.validation.section_errors.section_errors`.
        """
        parts = []
        for point, run, prediction in self._pairs():
            table = section_errors(prediction, run, self.z, self.study.within)
            parts.append(self._place(point, to_absolute_time(table, run.scene)))
        none = pd.DataFrame({"closure": [], "moment": [], "verdict": [], "judged": np.empty(0, bool)})
        return pd.concat(parts, ignore_index=True) if parts else none

    @cached_property
    def sections(self) -> pd.DataFrame:
        """Section moments of the simulation: a row for each point, impact, quantity and moment.

        Moments ``mean, sd, skew`` of the quantities at each path's k-th impact (the Poincaré section at the impacts),
        and the means of ``energy`` (lost at the impact) and of ``rate`` (impacts so far over their mean time).
        Columns: the fields that vary, ``impact, quantity, moment, value, se, paths`` (that reached the impact),
        ``followed`` (all simulated paths) and ``agreement`` (share of all paths on the noise-free itinerary).
        """
        parts = []
        for point, run in zip(self.study.points, self.samples, strict=True):
            if run is None:
                continue
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
                parts.append(self._place(point, table))
        none = pd.DataFrame(columns=["impact", "quantity", "moment", "value", "se", "paths", "followed", "agreement"])
        return pd.concat(parts, ignore_index=True) if parts else none

    @cached_property
    def correlation(self) -> pd.DataFrame:
        """Validity of each closure's correlations: how many of the impacts that it reaches have an invalid one.

        Columns: the fields that vary, ``closure, impacts, reached, invalid`` (impacts whose second moments are not
        realizable), ``beyond`` (those of them with ``|rho| > 1``), ``largest`` (|rho|).  ``branching`` has no rows:
        it predicts no correlations before impacts.
        """
        rows = []
        for point, _, prediction in self._pairs():
            reached = int(prediction.facts["found"])
            s = prediction.section.iloc[:reached]
            rho = s[["rho1", "rho2"]].abs()
            if rho.isna().all(axis=None) and bool(s["realizable"].all()) and prediction.closure == "branching":
                continue
            rows.append(
                {
                    **point.coordinates,
                    "closure": prediction.closure,
                    "impacts": self.study.impacts,
                    "reached": reached,
                    "invalid": int((~s["realizable"]).sum()),
                    "beyond": int((rho > 1.0).any(axis=1).sum()),
                    "largest": float(np.nan_to_num(rho.to_numpy(float)).max(initial=0.0)),
                }
            )
        return pd.DataFrame(rows)

    @cached_property
    def validity(self) -> pd.DataFrame:
        """Range of validity of each closure along the field `along`, for the first k impacts.

        Columns: the other fields that vary, ``closure, impact`` (k), ``accurate`` (the largest value up to which every
        judged moment of the first k impacts is accurate), ``not_inaccurate`` (the largest value up to which none is
        shown to be inaccurate), both NaN if the smallest value fails already, and ``ended``: whether at the next value
        the closure is not shown to be inaccurate but predicts fewer than k impacts.
        """
        if not self.study.along or self.errors.empty:
            return pd.DataFrame()
        first, keys = self.study.along, [*self.study.others, "closure"]
        verdicts = self.errors.groupby([*keys, first, "impact"], sort=True)["verdict"].agg(set).reset_index()
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

    @cached_property
    def paired(self) -> pd.DataFrame:
        """Differences between neighbours along `along`, with standard errors that use the common random numbers.

        Columns: the other fields, ``from, to`` and those of `rattle.compare.study.paired.compare_paired`.  Empty
        if every point has random numbers of its own, or too few paths for a standard error.
        """
        if not self.study.common_noise or not self.study.along:
            return pd.DataFrame()
        first, others = self.study.along, self.study.others
        groups: dict[tuple[Any, ...], list[tuple[float, Sampled]]] = {}
        for point, run in zip(self.study.points, self.samples, strict=True):
            if run is not None:
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

    @cached_property
    def cost(self) -> pd.DataFrame:
        """Seconds of each cell on the machine that computed it; not reproducible."""
        rows = []
        for point, run, predictions in zip(self.study.points, self.samples, self.predictions, strict=True):
            if run is not None:
                facts = {name: run.facts[name] for name in ("paths", "path_steps", "sticking_steps", "unfinished")}
                rows.append({**point.coordinates, "what": "monte carlo", "seconds": run.facts["seconds"], **facts})
            rows += [{**point.coordinates, "what": c.closure, "seconds": c.facts["seconds"]} for c in predictions]
        return pd.DataFrame(rows)

    @property
    def reasons(self) -> pd.DataFrame:
        """What could not be computed at each point, and why: the fields that vary, ``what, why``."""
        return pd.DataFrame(
            [{**p.coordinates, "what": what, "why": why} for p in self.study.points for what, why in p.reasons.items()],
            columns=[*self.study.names, "what", "why"],
        )

    def _pairs(self) -> Iterator[tuple[Point, Sampled, Predicted]]:
        for point, run, predictions in zip(self.study.points, self.samples, self.predictions, strict=True):
            for prediction in predictions if run is not None else ():
                assert run is not None
                yield point, run, prediction

    def _place(self, point: Point, table: pd.DataFrame) -> pd.DataFrame:
        coordinates = pd.DataFrame({n: [v] * len(table) for n, v in point.coordinates.items()}, index=table.index)
        return pd.concat([coordinates, table], axis=1)
