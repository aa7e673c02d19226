"""The cells of a study: an ensemble of a scene, or a closure's prediction for it.

A cell knows every input that determines its result.  Their digest is its key in the store.
"""

from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from rattle.closure import CLOSURES, Closure
from rattle.closure.mean_map import predict
from rattle.compare.engine.store import Cell, Content, Facts
from rattle.compare.validation.errors import followers_of
from rattle.montecarlo import (
    SCHEMES,
    Ensemble,
    Record,
    check_settings,
    default_step,
    simulate,
    simulate_to,
)
from rattle.montecarlo.diagnostics.accuracy import FEWEST_PATHS, sampling_error, small_noise
from rattle.montecarlo.ensemble.simulate_rare import begin_rare
from rattle.montecarlo.kernel.blocks import Blocks, in_threads
from rattle.montecarlo.settings import Sampling
from rattle.scene import Floats, InputError, Scene, choice, positive, section_names

FACTS_STORED = ("paths", "path_steps", "sticking_steps", "unfinished")
"""What is stored of an ensemble besides its table."""
FOLLOWERS = "followers_"  # before the columns of the paths on an itinerary
BATCH = "batch_{}_{}"  # column of batch statistics: mean, sd or control, and a section quantity


@dataclass(frozen=True)
class Sampled:
    """Section moments of an ensemble as read from the store; has those attributes of
    `montecarlo.Ensemble` it needs."""

    scene: Scene
    section: pd.DataFrame  # as `Ensemble.section`, with ``energy``
    step_bias: pd.DataFrame  # as `Ensemble.step_bias`
    # index ``impact``; columns ``batch_mean_tau, batch_sd_tau, batch_control_tau, ...``, lists over
    # the batches of `rattle.montecarlo.statistics.records`
    batches: pd.DataFrame
    facts: Facts  # `FACTS_STORED` and ``seconds``
    # the same of the paths on the noise-free itinerary, where asked for
    followers: "Sampled | None" = None

    @property
    def columns(self) -> dict[str, Floats]:
        """Section moments as arrays, shape (impacts,), by column name."""
        return {str(name): self.section[name].to_numpy(float) for name in self.section}

    @property
    def paths(self) -> int:
        """Number of simulated paths."""
        return int(self.facts["paths"])

    @property
    def agreement(self) -> pd.DataFrame:
        """Share of paths on the noise-free itinerary up to each impact; one equal column for every
        closure."""
        return pd.DataFrame(dict.fromkeys(CLOSURES, self.section["agreement"]))


@dataclass(frozen=True)
class Sample(Cell):
    """An ensemble of paths of a scene."""

    group = "ensembles"
    packages = ("montecarlo",)
    splits = True

    scene: Scene
    impacts: int
    seed: int
    scheme: str = "exact-flight"
    paths: int | None = None
    accuracy: float | None = None
    dt: float | None = None
    on_itinerary: bool = False
    # a part of the paths is drawn near the rare branches that matter, where any does
    near_branches: bool = False

    @property
    def settings(self) -> Facts:
        """Everything that determines the result besides the scene, with the default step filled
        in."""
        settings = self.list_fields()
        if self.dt is None and self.accuracy is None:
            settings["dt"] = default_step(
                self.scene, self.scheme, SCHEMES[self.scheme].has_step_bias
            )
        return {"kind": "ensemble", **settings}

    @property
    def expected_paths(self) -> int:
        """Paths to simulate, plain ones and those near rare branches; the fewest that an accuracy
        takes."""
        plain = self.paths or FEWEST_PATHS
        return plain + max(plain, FEWEST_PATHS) if self.near_branches else plain

    def evaluate(self, blocks: Blocks | None = None) -> tuple[pd.DataFrame, Facts]:
        """Simulate the ensemble: what is stored of it, a row for each impact."""
        record = Record(batches=True, energy=True, on_itinerary=self.on_itinerary)
        if self.accuracy is not None:
            run = simulate_to(
                self.scene.phase_reduced,
                self.accuracy,
                impacts=self.impacts,
                rng=self.seed,
                scheme=self.scheme,
                record=record,
                sampling=Sampling(blocks=blocks),
            )
            # where it stopped depends on wall time: not repeatable
            if run.reach is not None and not run.reach.reached:
                raise InputError("accuracy", self.accuracy, run.reach.sentence)
        else:
            assert self.paths is not None
            run = self.simulate(self.paths, blocks, record)
            if self.near_branches and self.scene.sigma > 0.0:
                run = begin_rare(run, max(run.paths, FEWEST_PATHS), blocks or in_threads(1)) or run
        parts = [_sections(run)]
        if self.on_itinerary:
            parts.append(_sections(followers_of(run)).add_prefix(FOLLOWERS))
        return pd.concat(parts, axis=1), {name: getattr(run, name) for name in FACTS_STORED}

    def simulate(
        self, paths: int, blocks: Blocks | None = None, record: Record | None = None
    ) -> Ensemble:
        """Simulate a number of paths of it, with the step bias where the scheme has one."""
        biased = SCHEMES[self.scheme].has_step_bias
        return simulate(
            self.scene.phase_reduced,
            paths=paths,
            impacts=self.impacts,
            dt=self.dt,
            rng=self.seed,
            scheme=self.scheme,
            sampling=Sampling(control=not biased and small_noise(self.scene), blocks=blocks),
            record=replace(record or Record(), step_bias=biased),
        )

    def describe(self, result: Sampled) -> str:
        """The largest standard error."""
        error, where = sampling_error(result)
        return f"largest se {error:.2g} sd ({where})"

    def restore(self, content: Content) -> Sampled:
        """Turn a stored result back into section moments."""
        table, apart = split_followers(content.table)
        followers = None if apart.empty else self._read_sample(apart, content.facts)
        return replace(self._read_sample(table, content.facts), followers=followers)

    def _read_sample(self, wide: pd.DataFrame, facts: Facts) -> Sampled:
        """What `_sections` has made a table of."""
        biases = []
        for moment, prefix in (("mean", ""), ("sd", "sd_")):
            for quantity in section_names(self.scene.stages):
                columns = {f"{name}_{prefix}{quantity}": name for name in BIAS}
                if columns.keys() <= set(wide):
                    rows = wide[[*columns]].rename(columns=columns).reset_index()
                    biases.append(rows.assign(quantity=quantity, moment=moment))
        return Sampled(
            self.scene,
            wide.iloc[:, : wide.columns.get_loc("bias_tau")],
            pd.concat(biases, ignore_index=True),
            wide.filter(regex="^batch_"),
            facts,
        )


def check_sample(sample: Sample) -> Sample:
    """Check that an ensemble can be simulated."""
    biased = SCHEMES[choice("scheme", sample.scheme, SCHEMES)].has_step_bias
    if sample.accuracy is not None:
        positive("accuracy", sample.accuracy)
    memory = sample.scene.correlation_time
    excluded = (
        (
            sample.accuracy is not None,
            f"accuracy = {sample.accuracy} samples rare branches by itself",
        ),
        (biased, f"scheme = {sample.scheme} cannot be drawn near rare branches"),
        (memory != 0.0, f"correlation_time = {memory} leaves rare branches unknown"),
    )
    for given, why in excluded:
        if sample.near_branches and given:
            raise InputError("near_branches", True, f"{why}; leave one of them out")
    dt = default_step(sample.scene, sample.scheme, biased) if sample.dt is None else sample.dt
    check_settings(
        sample.scene,
        paths=1 if sample.paths is None else sample.paths,
        impacts=sample.impacts,
        dt=dt,
        scheme=sample.scheme,
        rng=sample.seed,
        workers=1,
        step_bias=biased,
    )
    return sample


BIAS = ["bias", "se_bias", "corrected", "se_corrected", "rest"]
"""Columns of `Ensemble.step_bias` that are stored; ``rest`` is the step bias that extrapolation
leaves."""


def _sections(run: Ensemble) -> pd.DataFrame:
    """Everything that is stored of an ensemble, a row for each impact."""
    parts = [run.section[[name for name in run.section if not str(name).startswith("bias_")]]]
    for (moment, quantity), rows in run.step_bias.groupby(["moment", "quantity"], sort=False):
        name = quantity if moment == "mean" else f"sd_{quantity}"
        parts.append(rows.set_index("impact")[BIAS].add_suffix(f"_{name}"))
    if run.batches is not None:
        filled = run.batches.n[:, 0, 0] > 0  # batches that contain paths
        columns = {
            BATCH.format(moment, quantity): [*np.ascontiguousarray(batches.T)]
            for moment in ("mean", "sd", "control")
            for quantity, batches in zip(
                section_names(run.scene.stages),
                np.moveaxis(getattr(run.batches, moment)[filled], -1, 0),
                strict=True,
            )
        }
        parts.append(pd.DataFrame(columns, index=run.section.index))
    return pd.concat(parts, axis=1)


def split_followers(wide: pd.DataFrame) -> tuple[pd.DataFrame, pd.DataFrame]:
    """What is stored of all paths, and of those on the noise-free itinerary."""
    of_followers = wide.columns.str.startswith(FOLLOWERS)
    apart = wide.loc[:, of_followers]
    return wide.loc[:, ~of_followers], apart.rename(columns=lambda n: n.removeprefix(FOLLOWERS))


@dataclass(frozen=True)
class Predicted:
    """Section moments that a closure predicts, as read from the store."""

    closure: str  # name in `rattle.closure.CLOSURES`
    section: pd.DataFrame  # as `closure.MeanMap.section`, times counted from the phase of the start
    facts: Facts  # ``found`` (impacts), ``seconds``
    followers: "Predicted | None" = None  # the same of the paths on its itinerary, where asked for


@dataclass(frozen=True)
class Prediction(Cell):
    """A closure's prediction for a scene."""

    packages = ("closure",)

    scene: Scene
    impacts: int
    closure: str
    order: int = 4
    own: Closure | None = None  # one's own, of that name
    on_itinerary: bool = False

    @property
    def method(self) -> Closure:
        """The closure."""
        return CLOSURES[self.closure] if self.own is None else self.own

    @property
    def settings(self) -> Facts:
        """Everything that determines the result besides the scene."""
        names = ("impacts", "closure", "order", "on_itinerary")
        settings = {"kind": "prediction"} | {name: getattr(self, name) for name in names}
        return settings if self.own is None else settings | {"source": self.own.digest}

    @property
    def group(self) -> str:
        """The closure."""
        return self.closure

    @property
    def core_seconds(self) -> float:
        """Expected cost, with all components of a mixture."""
        return self.method.most_seconds(self.impacts, self.scene.stages)

    def evaluate(self, blocks: Blocks | None = None) -> tuple[pd.DataFrame, Facts]:
        """Evaluate the closure."""
        prediction = predict(self.scene, self.method, self.impacts, self.order).phase_reduced
        if prediction.trace.raised:
            raise InputError("closure", self.closure, prediction.stopped)
        parts = [prediction.section]
        if self.on_itinerary:
            parts.append(prediction.on_itinerary().section.add_prefix(FOLLOWERS))
        return pd.concat(parts, axis=1), {"found": prediction.trace.found}

    def restore(self, content: Content) -> Predicted:
        """Turn a stored result back into section moments."""
        table, apart = split_followers(content.table)
        on = None if apart.empty else Predicted(self.closure, apart, content.facts)
        return Predicted(self.closure, table, content.facts, on)
