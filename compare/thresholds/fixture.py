"""The fixture: compares a model with the simulation, or with its recorded baseline."""

import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn, TypeVar, cast

import pandas as pd
import pytest

from rattle.compare.thresholds import baseline
from rattle.compare.thresholds.claim import Claim
from rattle.compare.thresholds.looks import Looked, decide
from rattle.compare.thresholds.messages import (
    deciding,
    describe_undecided,
    failure_text,
    long_rows,
    moment_rows,
    remedies,
)
from rattle.compare.thresholds.prediction import Model, Prediction, predict
from rattle.compare.thresholds.sessions import Thresholds
from rattle.scene.errors import RattleError
from rattle.scene.text import harmless

if TYPE_CHECKING:
    from rattle.compare.thresholds.long_run import LongModel

T = TypeVar("T")


class Rattle:
    """The value of the fixture ``rattle``.

    `claim`: the claim of the test's marker.
    """

    def __init__(self, item: pytest.Item, claim: Claim, thresholds: Thresholds) -> None:
        self.claim, self._item, self._thresholds = claim, item, thresholds
        self._asked: set[str] = set()

    def check(self, model: "Model | LongModel", *, quantities: Sequence[str] | None = None) -> pd.DataFrame:
        """Compare a model's section moments with the simulation of the marker's scene.

        The test fails if the whole interval of an error lies outside the admissible range, and passes if all intervals
        lie inside.  Otherwise it is undecided and tried again with more paths, up to its budget
        (`rattle.compare.thresholds.looks`).  A test that stays undecided fails, unless the marker's ``undecided`` or
        ``--rattle-undecided`` is ``skip``.

        `quantities`: Quantities of the long run, such as ``["rate", "energy"]``, in place of the marker's section
        moments.  The model is then a closure, or a function ``(scene, quantities) -> mapping``; what counts as
        accurate is said in `rattle.compare.stationary.judged.TOLERANCES`.
        """
        self._once("check")
        if quantities is not None:
            return self._check_long(model, quantities)
        prediction = self._guard(lambda: predict(cast(Model, model), self.claim))
        looked = self._guard(lambda: decide(prediction, self.claim, self._thresholds))
        run, excluded = looked.drawn[-1].run, len(self.claim.rows) - len(looked.table)
        return self._judge(
            prediction.closure,
            looked,
            lambda rows: moment_rows(rows, run, looked.z),
            lambda: self._figure(prediction, looked.table),
            kind="check",
            not_judged=excluded,
            by_size=int((looked.table["still"] > 0.0).sum()),
            size=f"{run.paths:,} paths",
        )

    def _check_long(self, model: Any, quantities: Sequence[str]) -> pd.DataFrame:
        """Compare a model with the long run."""
        from rattle.compare.thresholds.long_run import decide_long, predict_long

        prediction = self._guard(lambda: predict_long(model, self.claim.scene, quantities))
        looked = self._guard(lambda: decide_long(prediction, self.claim, self._thresholds))
        facts = looked.drawn[-1].run.facts
        return self._judge(
            f"{prediction.name} in the long run",
            looked,
            lambda rows: long_rows(rows, looked.z),
            kind="long check",
            not_judged=0,
            by_size=0,
            size=f"{facts['paths']:,} paths of {facts['periods']:,} periods",
        )

    def _judge(
        self,
        model: str,
        looked: Looked,
        shown: Callable[[pd.DataFrame], str],
        figure: Callable[[], str] = str,
        **facts: Any,
    ) -> pd.DataFrame:
        """Record the decision on a claim, and fail or skip the test that it does not pass."""
        table, drawn, settings = looked.table, looked.drawn, self._thresholds.settings
        counts, folder = table["outcome"].value_counts(), self._thresholds.folder
        failed, undecided = int(counts.get("fail", 0)), int(counts.get("undecided", 0))
        self._record(
            model=model,
            rows=len(table),
            failed=failed,
            undecided=undecided,
            z=looked.z,
            rate=settings.false_alarm,
            widened=float(table["widened"].max()) if "widened" in table else looked.z,
            drawn=len(drawn),
            computed=sum(d.computed for d in drawn),
            seconds=sum(d.seconds for d in drawn),
            decide=deciding(table),
            folder="" if folder is None else self._shorten(folder),
            **facts,
        )
        if failed:
            self._fail(failure_text(model, table, shown) + figure())
        if undecided:
            text = describe_undecided(model, table, shown)
            if (self.claim.undecided or settings.undecided) == "skip":
                pytest.skip(harmless(f"rattle: {text}"))
            self._fail(f"{text}\n{remedies(table, self.claim)}{figure()}")
        return table

    def baseline(self, model: Model, *, relative: float = 1e-9, absolute: float = 1e-12) -> None:
        """Compare a model's predictions with those recorded in ``baselines/`` beside the test; nothing is simulated."""
        self._once("baseline")
        prediction = self._guard(lambda: predict(model, self.claim))
        path = baseline.place(self._item.path, ".".join(self._item.nodeid.split("::")[1:]))
        now = baseline.content(prediction, self.claim)
        mode = self._thresholds.settings.baselines
        again = f"pytest '{self._item.nodeid}' --rattle-baselines"
        if not path.exists():
            if mode == "compare":
                self._fail(f"there is no baseline {self._shorten(path)}; record it: {again}=record")
            self._guard(lambda: baseline.write(path, now, prediction.closure))
            self._record(kind="baseline", done=f"recorded {self._shorten(path)}")
            return
        recorded = self._guard(lambda: baseline.read(path))
        changes = baseline.changes(recorded, now, relative, absolute)
        if not changes:
            self._record(kind="baseline", done="")
        elif mode == "regenerate":
            new = baseline.update(recorded, now, changes)
            self._guard(lambda: baseline.write(path, new, prediction.closure))
            self._record(
                kind="baseline",
                done="\n".join([f"regenerated {self._shorten(path)}", *baseline.format_changes(changes)]),
            )
        else:
            lines = "\n".join(baseline.format_changes(changes))
            self._fail(
                f"{prediction.closure} differs from its baseline {self._shorten(path)} by more than {absolute:g} + "
                f"{relative:g} of a value:\n{lines}\nIf that is meant: {again}=regenerate"
            )

    def _once(self, kind: str) -> None:
        """Refuse a second call: rows are counted once at collection, and a test has one baseline file."""
        if kind in self._asked:
            self._fail(f"a test makes one {kind}; parametrize the test for more")
        self._asked.add(kind)

    def _guard(self, action: Callable[[], T]) -> T:
        try:
            return action()
        except RattleError as error:
            refusal = str(error)
        self._fail(refusal)

    def _fail(self, text: str) -> NoReturn:
        pytest.fail(harmless(f"rattle: {text}"), pytrace=False)

    def _record(self, **facts: Any) -> None:
        self._item.user_properties.append(("rattle", facts))

    def _figure(self, prediction: Prediction, table: pd.DataFrame) -> str:
        from rattle.compare.report.style import save
        from rattle.compare.thresholds.figure import error_figure

        if self._thresholds.folder is None:
            return ""
        name = re.sub(r"[^\w.-]+", "-", self._item.nodeid)
        path = self._thresholds.folder / "figures" / f"{name}.svg"
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            save(error_figure(table, prediction.closure), path)
        except OSError as error:  # the verdict does not depend on the figure
            return f"\nNo figure: {error.strerror}"
        return f"\nFigure: {self._shorten(path)}"

    def _shorten(self, path: Path) -> str:
        """A path relative to the folder in which pytest was called, if it lies inside."""
        here = self._item.config.invocation_params.dir
        return str(path.relative_to(here) if path.is_relative_to(here) else path)
