"""What a simulation found: the tables behind which the merged sums stand."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from rattle.montecarlo.diagnostics.lateness import find_kinks, find_lateness
from rattle.montecarlo.diagnostics.reach import Reach
from rattle.montecarlo.kernel.block import (
    BlockResult,
    Plan,
    impact_codes,
    kept_places,
    section_pairs,
    state_pairs,
)
from rattle.montecarlo.schemes.control_variate import estimate_controlled
from rattle.montecarlo.schemes.step_size import COARSEST, SCHEMES
from rattle.montecarlo.settings import NOISE_FREE, begins, is_random
from rattle.montecarlo.statistics import section_statistics as statistics
from rattle.montecarlo.statistics.records import Batches, Histograms
from rattle.scene import (
    Floats,
    InputError,
    Ints,
    Scene,
    choice,
    section_names,
    state_names,
)
from rattle.scene.numpy_errors import numpy_defaults
from rattle.scene.section_result import SectionResult
from rattle.scene.units import at_times_in

if (
    TYPE_CHECKING
):  # tables are made when they are asked for: loading pandas takes as long as all the rest
    import pandas as pd


NOT_APART = "ask for it: simulate(..., record=Record(on_itinerary=True))"


@numpy_defaults
@dataclass(frozen=True)
class Ensemble(SectionResult):
    """What a simulation found.

    Attributes
    ----------
    plan : Plan
        What was computed, and the seed that makes it repeatable.
    paths : int
        Paths that were asked for.
    result : BlockResult
        The merged sums behind the tables.
    histograms : Histograms or None
        Section histograms, if asked for.
    raw : ndarray or None
        ``tau, flight, x1, y1, ..., mesh * side`` of every impact of every path, shape (paths,
        impacts, 3 + 2 wheels), if asked for; here and in the histograms tau is counted from the
        start's phase (`Scene.phase`).  `records` has them with names.
    wall_seconds : float
        Time the run took.
    batches : Batches or None
        Means and sds of batches of paths, if asked for.
    reach : Reach or None
        How far it got, if an accuracy was asked for.
    unseen : dict of str to ndarray
        Where rare branches were sampled on purpose: columns of `section` that say how far others
        could move a moment.

    Examples
    --------
    >>> from rattle import DAT21, Scene, simulate
    >>> run = simulate(Scene.from_gears(DAT21, sigma=0.01), paths=1000, impacts=2, rng=7)
    >>> run.section[["tau", "sd_tau", "y1", "sd_y1"]].round(3).loc[1].tolist()
    [0.56, 0.0, -1.848, 0.002]
    """

    plan: Plan
    paths: int
    result: BlockResult
    histograms: Histograms | None
    raw: Floats | None
    wall_seconds: float
    batches: Batches | None = None
    reach: Reach | None = None
    unseen: dict[str, Floats] = field(default_factory=dict)

    def __repr__(self) -> str:
        """What was simulated, and what was counted on the way, on a few lines."""
        from rattle.montecarlo.diagnostics.diagnostics import list_counted

        last = {name: self.columns[name][-1] for name in ("tau", "se_tau", "sd_tau", "agreement")}
        lines = [
            (
                f"Ensemble: {self.paths:,} paths, impacts 1 to {self.impacts}, sigma ="
                f" {self.scene.sigma:.4g}"
            ),
            (
                f"  {self.scheme}, dt = {self.dt:.4g}, seed {str(self.seed.entropy)[:40]},"
                f" {self.wall_seconds:.1f} s"
            ),
            (
                f"  at impact {self.impacts}: tau = {last['tau']:.6g}, standard error"
                f" {last['se_tau']:.2g}, sd {last['sd_tau']:.4g}; {last['agreement']:.1%} of the"
                " paths on the noise-free itinerary"
            ),
            *(f"  {sentence}" for sentence in list_counted(self)),
            (
                "  diagnostics also looks for rare branches that are missing, and for the bias of"
                " the step"
            ),
        ]
        return "\n".join(lines)

    @property
    def records(self) -> pd.DataFrame:
        """Every impact of every path, recorded with ``record=Record(raw=True)``.

        Index ``path`` (from 0) and ``impact`` (from 1); columns ``tau, flight, x1, y1, ..., mesh,
        side``, tau in absolute time.  NaN, and mesh and side 0, where a path had no such impact.

        Raises
        ------
        InputError
            If they were not recorded.

        Examples
        --------
        >>> from rattle import DAT21, Record, Scene, simulate
        >>> run = simulate(
        ...     Scene.from_gears(DAT21, sigma=0.1), paths=64, impacts=3, record=Record(raw=True)
        ... )
        >>> run.records.loc[(0, 1), ["mesh", "side"]].tolist()
        [1, -1]
        """
        import pandas as pd

        if self.raw is None:
            raise InputError(
                "record.raw", False, "ask for it: simulate(..., record=Record(raw=True))"
            )
        paths, impacts, _ = self.raw.shape
        index = pd.MultiIndex.from_product(
            [range(paths), range(1, impacts + 1)], names=["path", "impact"]
        )
        rows = self.raw.reshape(paths * impacts, -1)
        table = pd.DataFrame(rows[:, :-1], index, list(section_names(self.scene.stages)))
        table["tau"] = self.scene.to_absolute_time(table["tau"].to_numpy())
        code = np.nan_to_num(rows[:, -1]).astype(int)
        return table.assign(mesh=np.abs(code), side=np.sign(code))

    @cached_property
    def phase_reduced(self) -> Ensemble:
        """The same result for the phase-reduced scene (`Scene.phase_reduced`): tau has all its
        digits, however late."""
        scene = self.scene.phase_reduced
        return self if scene is self.scene else replace(self, plan=self.plan._replace(scene=scene))

    @property
    def scene(self) -> Scene:
        """What was modelled."""
        return self.plan.scene

    @property
    def impacts(self) -> int:
        """Impacts of each path."""
        return self.plan.impacts

    @property
    def dt(self) -> float:
        """Finest step."""
        return self.plan.dt

    @property
    def scheme(self) -> str:
        """Name of the scheme."""
        return self.plan.scheme

    @property
    def seed(self) -> np.random.SeedSequence:
        """Seed that makes the run repeatable."""
        return self.plan.seed

    @property
    def fixed_times(self) -> Floats:
        """Times at which moments of all paths were taken, on the step grid."""
        return np.asarray(self.scene.start.tau + self.plan.fixed_steps * self.dt)

    @property
    def path_steps(self) -> int:
        """Steps taken, over all paths and step sizes."""
        return self.result.path_steps

    @property
    def unfinished(self) -> int:
        """Paths that had not had all their impacts at the horizon; they count in the rows they
        reached."""
        return round(self.result.unfinished * self._copies)

    @property
    def sticking_steps(self) -> int:
        """Path-steps in which a mesh stayed closed: completed chatter, or a sticking phase
        (`rattle.montecarlo.schemes.sticking`)."""
        return self.result.sticking_steps

    @cached_property
    def diagnostics(self) -> tuple[str, ...]:
        """What may be wrong with these numbers, a sentence each: see
        `rattle.montecarlo.diagnostics.diagnostics`.

        It looks for rare branches that may be missing, and follows the noise-free path at a shorter
        step.
        """
        from rattle.montecarlo.diagnostics.diagnostics import diagnose

        return diagnose(self)

    @cached_property
    def section(self) -> pd.DataFrame:
        """Moments of each path's own k-th impact, just before it (dimensionless), index ``impact``.

        Columns: the mean of ``tau, flight, x1, y1, ...`` under their own names, ``mesh`` and
        ``side`` of most paths, ``sd_``, ``skew_``, ``kurt_`` (third and fourth cumulants in units
        of the sd) of each quantity, the standard error of each of these under ``se_`` + its name
        (NaN where fewer than `rattle.montecarlo.statistics.section_statistics.FEWEST_FOR_ERROR`
        paths tell none), ``rho1, ...``, ``paths`` that reached the impact, and ``agreement``: the
        share that has followed the noise-free itinerary up to there.  With a control variate, means
        and sds and their errors are the controlled ones.  Where the bias of the step was measured
        it stands under ``bias_`` + the name of the mean or sd, which is not corrected
        (`step_bias`).  If asked for, ``energy`` and ``se_energy``: mean loss at the impact, see
        `rattle.scene.impact.energy_loss`.
        """
        import pandas as pd

        return pd.DataFrame(self.columns, index=pd.RangeIndex(1, self.impacts + 1, name="impact"))

    @property
    def _title(self) -> str:
        return f"{self.paths:,} paths"

    @cached_property
    def columns(self) -> dict[str, Floats | Ints]:
        """The columns of `section`, each of shape (impacts,)."""
        sums = self.result.sums
        s = self._statistics
        if "control" in sums:
            s = s | estimate_controlled(sums["control"], self.plan.control.variance)
        wheels = self.scene.stages
        quantities = section_names(wheels)
        columns: dict[str, Floats | Ints] = {}
        codes = np.array(impact_codes(wheels))
        most = codes[np.argmax(self.result.codes, axis=1)] * (self._arrivals > 0)
        for prefix, name in (("", "mean"), ("sd_", "sd"), ("skew_", "skew"), ("kurt_", "kurt")):
            tables = {prefix: s[name], "se_" + prefix: s["se_" + name]}
            tables["se_" + prefix] = tables["se_" + prefix] * self._estimable(name)[:, None]
            if name in self._step_biases:
                tables["bias_" + prefix] = self._step_biases[name].bias
            for i, quantity in enumerate(quantities):
                columns |= {start + quantity: t[:, i] for start, t in tables.items()}
                if prefix + quantity == "flight":
                    columns |= {"mesh": np.abs(most), "side": np.sign(most)}
        columns["tau"] = self.scene.to_absolute_time(s["mean"][:, 0])
        covariance = self.covariance
        for wheel in range(1, wheels + 1):
            j = 2 * wheel - 1
            with statistics.undefined():
                scale = np.sqrt(covariance[:, j, j]) * np.sqrt(covariance[:, j + 1, j + 1])
                # rounding of few paths can pass 1
                rho = np.clip(covariance[:, j, j + 1] / scale, -1.0, 1.0)
                columns[f"rho{wheel}"] = np.where(scale > 0.0, rho, np.nan)
        if "energy" in sums:
            energy = statistics.mean_statistics(sums["energy"])
            columns["energy"] = energy["mean"][:, 0]
            columns["se_energy"] = energy["se_mean"][:, 0] * self._estimable("mean")
        if "weighted" in sums:
            for i, quantity in enumerate(quantities):
                columns["lean_" + quantity] = s["lean_mean"][:, i]
                columns["lean_sd_" + quantity] = s["lean_sd"][:, i]
            if self.plan.energy:
                columns["energy"] = s["mean"][:, -1]
                columns["se_energy"] = s["se_mean"][:, -1]
        columns |= self.unseen
        columns["paths"] = (self._arrivals * self._copies).astype(int)
        columns["agreement"] = self._share(self.result.agreeing[NOISE_FREE])
        return columns

    @cached_property
    def _statistics(self) -> dict[str, Floats]:
        """Moments of the section quantities with standard errors, without a control variate."""
        sums = self.result.sums
        if "weighted" in sums:
            return dict(sums["weighted"].moments())
        return statistics.single_statistics(sums["section"])

    @cached_property
    def agreement(self) -> pd.DataFrame:
        """Share of paths whose impacts so far had the meshes and sides of each itinerary given
        (columns)."""
        import pandas as pd

        shares = {name: self._share(a) for name, a in self.result.agreeing.items()}
        return pd.DataFrame(shares, index=pd.RangeIndex(1, self.impacts + 1, name="impact"))

    def to_samples(self) -> pd.DataFrame:
        """What the paths say of every section mean and sd, as ``rattle.judge`` takes it.

        Returns
        -------
        DataFrame
            A row for each impact, quantity and moment: ``simulated`` with its standard error
            ``se``, the measured ``bias`` of the step, and what else decides a verdict: the
            skewness of the sampling distribution, and what rare branches that are missing from
            these paths could change.

        Raises
        ------
        InputError
            If the scheme has a bias in the step, and the run was made without step bias.

        Examples
        --------
        >>> from rattle import DAT21, Scene, judge, mean_map, simulate
        >>> scene = Scene.from_gears(DAT21, sigma=0.01)
        >>> run = simulate(scene, paths=20_000, impacts=2, rng=7)
        >>> judge(mean_map(scene, impacts=2, closure="saltation"), run.to_samples()).accurate
        True
        """
        from rattle.montecarlo.diagnostics.reference import list_reference

        rows = list_reference(self)
        return rows.drop(columns=["closure", "kind", "predicted", "error"])

    def on_itinerary(self, name: str = NOISE_FREE) -> Ensemble:
        """The same result for the paths alone that have followed an itinerary up to each impact.

        Moments, errors and ``paths`` of its `section` are those of these paths; ``agreement`` says
        which share of all they are.  There is no control variate, and no histogram, among them.

        Parameters
        ----------
        name : str
            That of an itinerary of ``Record(itineraries=...)``; by default that of the noise-free
            path.

        Returns
        -------
        Ensemble

        Raises
        ------
        InputError
            For an unknown name, or if the run was made without ``Record(on_itinerary=True)``.

        Examples
        --------
        >>> from rattle import DAT21, Record, Scene, simulate
        >>> scene = Scene.from_gears(DAT21, sigma=0.1)
        >>> run = simulate(scene, paths=4096, impacts=3, record=Record(on_itinerary=True))
        >>> bool(run.on_itinerary().section["sd_y2"][3] < 0.9 * run.section["sd_y2"][3])
        True
        """
        if not self.plan.apart:
            raise InputError("record.on_itinerary", False, NOT_APART)
        itineraries = self.plan.itineraries
        own = itineraries[choice("name", name, itineraries)]
        followers = self.result.followers[
            next(n for n in self.plan.apart if begins(own, itineraries[n]))
        ]
        codes = np.equal.outer(own, impact_codes(self.scene.stages)).astype(float)
        codes *= self.result.agreeing[name][:, None]
        sums = {of: s.until(np.count_nonzero(own)) for of, s in followers.sums.items()}
        result = replace(self.result, sums=sums, codes=codes, followers={})
        return replace(self, result=result, histograms=None, raw=None, batches=None, unseen={})

    @cached_property
    def leaving(self) -> pd.DataFrame:
        """Probability of leaving the noise-free itinerary at an impact, by what is struck instead.

        Columns ``impact, mesh, side`` (the wall that is struck in place of the itinerary's),
        ``probability`` with a 95 % interval ``low, high``, ``paths`` that it rests on, and
        ``near``: whether these were drawn near this exit, at which pilots have aimed
        (``rattle.montecarlo.ensemble.leaving``), or are those of this run.  Which of the two
        depends on the scene and the number of paths alone.  An exit that the pilots know is listed
        even where no path of this run took it.  What fewer than one in a billion paths do is left
        out.

        Raises
        ------
        InputError
            If the run was made without ``Record(on_itinerary=True)``.

        Examples
        --------
        >>> from rattle import DAT21, Record, Scene, simulate
        >>> scene = Scene.from_gears(DAT21, sigma=0.07)
        >>> run = simulate(scene, paths=4096, impacts=1, record=Record(on_itinerary=True))
        >>> first = run.leaving.iloc[0]
        >>> int(first["mesh"]), bool(first["near"]), bool(1e-6 < first["probability"] < 2e-6)
        (2, True, True)
        """
        from rattle.montecarlo.ensemble.leaving import find_leaving

        if not self.plan.apart:
            raise InputError("record.on_itinerary", False, NOT_APART)
        return find_leaving(self, self.result.followers)

    @cached_property
    def covariance(self) -> Floats:
        """Covariance of ``tau, x1, y1, ...`` at each impact, shape (impacts, 1 + 2 wheels, 1 + 2
        wheels)."""
        wheels = self.scene.stages
        places = list(kept_places(wheels))
        sums = self.result.sums
        if "weighted" in sums:
            moment = sums["weighted"].pair_moment(section_pairs(wheels))
            variance = self._statistics["sd"][:, places] ** 2
        else:
            moment = sums["section_pairs"].moment(1, 1)
            variance = sums["section"].moment(2, 0)[:, places]
        size = len(places)
        out = np.empty((self.impacts, size, size))
        i, j = np.tril_indices(size, -1)  # in the order of `section_pairs`
        out[:, i, j] = moment
        out[:, j, i] = moment
        out[:, range(size), range(size)] = variance
        return out

    def at_times(
        self, times: Sequence[float] | Floats | None = None, units: str = "dimensionless"
    ) -> pd.DataFrame:
        """Moments of all paths at fixed times, index ``time`` (on the grid of the coarsest step, so
        within half of it).

        Columns as in `rattle.closure.MeanMap.at_times`, with ``se_`` beside each mean and
        covariance, and for each ``rho`` its standard error ``se_rho``, that of Fisher's artanh rho
        ``se_z_rho``, and ``coarse_rho``, the value at twice the step, if step bias was asked for.
        Errors are NaN as in `section`.

        Parameters
        ----------
        times : sequence of float, optional
            Absolute times, dimensionless; all that were recorded if none are given.
        units : {"dimensionless", "physical"}
            Units of the table; the second for a scene that was made from gears.

        Returns
        -------
        DataFrame
            In physical units with the index ``time_ms`` and columns that end with their unit, as
            `rattle.closure.MeanMap.at_times` has them.

        Raises
        ------
        InputError
            If a time was not among those given to `simulate`, for unknown units, or physical ones
            of a scene without gears.

        Examples
        --------
        >>> from rattle.montecarlo import Record, simulate
        >>> from rattle.scene import DAT21, Scene
        >>> run = simulate(
        ...     Scene.from_gears(DAT21), paths=1, impacts=1, dt=0.03, record=Record(times=[0.3])
        ... )
        >>> run.at_times(units="physical").index
        Index([1.0], dtype='float64', name='time_ms')
        """
        table = at_times_in(self._fixed_table, self.scene.gears, units)
        if times is None:
            return table
        rows = []
        grid = self.dt * (COARSEST if "fine_coarse" in self.result.sums else 1)
        for t in np.asarray(times, dtype=float):
            away = np.abs(self.plan.fixed_steps * self.dt - (t - self.scene.start.tau))
            near = np.flatnonzero(away <= 0.5001 * grid)
            if near.size == 0:
                raise InputError(
                    "times",
                    float(t),
                    "was not recorded; give it to simulate: record=Record(times=...)",
                )
            rows.append(int(near[np.argmin(away[near])]))
        return table.iloc[rows]

    @cached_property
    def _fixed_table(self) -> pd.DataFrame:
        import pandas as pd

        if "fixed" not in self.result.sums:
            return pd.DataFrame(index=pd.Index([], name="time"))
        sums = self.result.sums["fixed"]
        s = statistics.mean_statistics(sums) | statistics.pair_statistics(sums)
        for name, of in (("mean", "mean"), ("cov", "cov"), ("rho", "rho"), ("z", "rho")):
            s["se_" + name] = s["se_" + name] * self._estimable(of, sums.n[:, 0])[:, None]
        wheels = self.scene.stages
        names = state_names(wheels)
        pairs = state_pairs(wheels)
        columns: dict[str, Floats] = {}
        coarse = self.result.sums.get("coarse_fixed")
        coarse_rho = None if coarse is None else statistics.pair_statistics(coarse)["rho"]
        for i, name in enumerate(names):
            k = pairs.index((i, i))
            columns[name] = s["mean"][:, k]
            columns[f"se_{name}"] = s["se_mean"][:, k]
        for k, (i, j) in enumerate(pairs):
            columns[f"cov_{names[i]}_{names[j]}"] = s["cov"][:, k]
            columns[f"se_cov_{names[i]}_{names[j]}"] = s["se_cov"][:, k]
        for wheel in range(1, wheels + 1):
            k = pairs.index((2 * wheel - 2, 2 * wheel - 1))
            columns[f"rho{wheel}"] = s["rho"][:, k]
            columns[f"se_rho{wheel}"] = s["se_rho"][:, k]
            columns[f"se_z_rho{wheel}"] = s["se_z"][:, k]
            if coarse_rho is not None:
                columns[f"coarse_rho{wheel}"] = coarse_rho[:, wheel - 1]
        return pd.DataFrame(columns, index=pd.Index(self.fixed_times, name="time"))

    @cached_property
    def step_bias(self) -> pd.DataFrame:
        """What the step size does to section means and sds, from dt, 2 dt and 4 dt on the same
        noise; tidy.

        Columns ``impact, quantity, moment, bias, se_bias, corrected, se_corrected, rest``.
        ``bias`` is the first-order estimate of (this run - limit): the change from dt to 2 dt;
        ``corrected = value - bias`` is Richardson's extrapolation; ``rest`` estimates what is left:
        a third of the change from the same extrapolation of 2 dt and 4 dt, and more of it where the
        changes fall more slowly than the step.  Where impacts spread over less than a few steps,
        the error of paths without noise counts too: all of it where impacts are detected at the end
        of a step, else what extrapolation misses of it.

        A scheme without a bias in the step has 0, and its own values.

        Raises
        ------
        InputError
            If the run was made without step bias.
        """
        import pandas as pd

        if not self._step_biases and SCHEMES[self.scheme].has_step_bias:
            raise InputError(
                "record.step_bias",
                False,
                "ask for it: simulate(..., record=Record(step_bias=True))",
            )
        rows = [
            {"impact": np.arange(1, self.impacts + 1), "quantity": quantity, "moment": moment}
            | self._bias_of(prefix + quantity, moment, i)
            for moment, prefix in (("mean", ""), ("sd", "sd_"))
            for i, quantity in enumerate(section_names(self.scene.stages))
        ]
        return pd.concat([pd.DataFrame(row) for row in rows], ignore_index=True)

    def _bias_of(self, name: str, moment: str, i: int) -> dict[str, Any]:
        """Columns of `step_bias` for the mean or the sd that a column of `section` has."""
        if not self._step_biases:
            value, se = (self.columns[start + name].astype(float) for start in ("", "se_"))
            nil = np.zeros(self.impacts)
            return statistics.StepBias(nil, nil, value, se, nil)._asdict()
        bias = {name: v[:, i] for name, v in self._step_biases[moment]._asdict().items()}
        for error in ("se_bias", "se_corrected"):
            bias[error] = bias[error] * self._estimable(moment)
        if (
            self.plan.apart and not self.result.followers
        ):  # paths that follow at one step may not at another
            own = self._statistics[moment][:, i]
            bias["rest"] = bias["rest"] + 2.0 * np.abs(own - bias["corrected"] - bias["bias"])
            bias["corrected"] = own - bias["bias"]
        if moment == "mean":
            bias["rest"] = np.fmax(bias["rest"], np.abs(self._kinks[:, i] - bias["bias"]))
        late = self.lateness[:, i]
        bias["rest"] = bias["rest"] + np.where(late > 0.0, late + np.abs(bias["bias"]), 0.0)
        if name == "tau":  # counted from the phase, and said in absolute time
            bias["corrected"] = self.scene.to_absolute_time(bias["corrected"])
        return bias

    @cached_property
    def lateness(self) -> Floats:
        """What impacts that are detected late may do to the section, where extrapolation cannot
        see it."""
        return find_lateness(self.plan, self._statistics["sd"][:, 0])

    @cached_property
    def _kinks(self) -> Floats:
        """The error of the path without noise, where extrapolation may miss it."""
        return find_kinks(self.plan, self._statistics["sd"][:, 0])

    @cached_property
    def _step_biases(self) -> dict[str, statistics.StepBias]:
        """Measured step bias of means and sds; empty where none was measured."""
        sums = self.result.sums
        return (
            statistics.extrapolate(sums["fine_coarse"], sums["coarse_coarser"])
            if "fine_coarse" in sums
            else {}
        )

    @property
    def _arrivals(self) -> Floats:
        return np.asarray(self.result.codes.sum(axis=1))

    def _estimable(self, name: str, paths: Floats | None = None) -> Floats:
        """NaN where so few paths, by default those that arrived, cannot have a standard error of a
        random statistic, else 1."""
        few = (self._arrivals if paths is None else paths) < statistics.FEWEST_FOR_ERROR[name]
        return np.where(is_random(self.scene) & few, np.nan, 1.0)

    def _share(self, count: Floats) -> Floats:
        return count / (self.paths / self._copies)

    @property
    def _copies(self) -> float:
        """Paths that one computed path stands for: all of them, where nothing is random."""
        return 1.0 if is_random(self.scene) else float(self.paths)
