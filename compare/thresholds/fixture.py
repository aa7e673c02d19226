"""The fixture: compares a model with the simulation, or with its recorded baseline."""

import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NoReturn, TypeVar

import pandas as pd
import pytest

from rattle.compare.thresholds import baseline, messages
from rattle.compare.thresholds.claim import Claim
from rattle.compare.thresholds.decision import Decision, decide
from rattle.compare.thresholds.prediction import Model, predict
from rattle.compare.thresholds.sessions import Thresholds
from rattle.scene.errors import RattleError
from rattle.scene.text import harmless

T = TypeVar("T")


class Rattle:
    """The value of the fixture ``rattle``.

    `claim`: the claim of the test's marker.
    """

    def __init__(self, item: pytest.Item, claim: Claim, session: Thresholds) -> None:
        self.claim, self._item, self._session = claim, item, session
        self._asked: set[str] = set()

    def check(self, model: str | Callable[..., Any], *, quantities: Sequence[str] | None = None) -> pd.DataFrame:
        """Compare a model's section moments with the simulation of the marker's scene.

        The test fails if the whole interval of an error lies outside the admissible range, and passes if all intervals
        lie inside.  Otherwise it is undecided and tried again with more paths, up to its budget
        (`rattle.compare.thresholds.decision`).  A test that stays undecided fails, unless the marker's ``undecided`` or
        ``--rattle-undecided`` is ``skip``.

        `quantities`: Quantities of the long run, such as ``["rate", "energy"]``, in place of the marker's section
        moments.  The model is then a closure, or a function ``(scene, quantities) -> mapping``; what counts as
        accurate is said in `rattle.compare.stationary.verdicts.TOLERANCES`.
        """
        self._once("check")
        if quantities is not None:
            return self._check_long(model, quantities)
        prediction = self._guard(predict, model, self.claim)
        decision = self._guard(decide, prediction, self.claim, self._session)
        run = decision.runs[-1].run
        return self._judge(
            prediction.closure,
            decision,
            lambda rows: messages.moment_rows(rows, run, decision.z),
            lambda: self._figure(prediction.closure, decision.table),
            kind="check",
            not_judged=len(self.claim.rows) - len(decision.table),
            by_size=int((decision.table["still"] > 0.0).sum()),
            size=f"{run.paths:,} paths",
        )

    def _check_long(self, model: Any, quantities: Sequence[str]) -> pd.DataFrame:
        """Compare a model with the long run."""
        from rattle.compare.thresholds.long_run import decide_long, predict_long

        prediction = self._guard(predict_long, model, self.claim.scene, quantities)
        decision = self._guard(decide_long, prediction, self.claim, self._session)
        facts = decision.runs[-1].run.facts
        return self._judge(
            f"{prediction.name} in the long run",
            decision,
            lambda rows: messages.long_rows(rows, decision.z),
            kind="long check",
            not_judged=0,
            by_size=0,
            size=f"{facts['paths']:,} paths of {facts['periods']:,} periods",
        )

    def _judge(
        self,
        model: str,
        decision: Decision,
        shown: Callable[[pd.DataFrame], str],
        figure: Callable[[], str] = str,
        **facts: Any,
    ) -> pd.DataFrame:
        """Record the decision on a claim, and fail or skip the test that it does not pass."""
        table, runs, settings = decision.table, decision.runs, self._session.settings
        failed, undecided = (int((table["outcome"] == outcome).sum()) for outcome in ("fail", "undecided"))
        folder = self._session.folder
        self._record(
            model=model,
            rows=len(table),
            failed=failed,
            undecided=undecided,
            z=decision.z,
            rate=settings.false_alarm,
            widened=float(table["widened"].max()) if "widened" in table else decision.z,
            drawn=len(runs),
            computed=sum(run.computed for run in runs),
            seconds=sum(run.seconds for run in runs),
            decide=messages.paths_to_decide(table),
            folder="" if folder is None else self._shorten(folder),
            **facts,
        )
        if failed:
            self._fail(messages.failure_text(model, table, shown) + figure())
        if undecided:
            text = messages.describe_undecided(model, table, shown)
            if (self.claim.undecided or settings.undecided) == "skip":
                pytest.skip(harmless(f"rattle: {text}"))
            self._fail(f"{text}\n{messages.remedies(table, self.claim)}{figure()}")
        return table

    def baseline(self, model: Model, *, relative: float = 1e-9, absolute: float = 1e-12) -> None:
        """Compare a model's predictions with those recorded in ``baselines/`` beside the test; nothing is simulated."""
        self._once("baseline")
        prediction = self._guard(predict, model, self.claim)
        path = baseline.place(self._item.path, ".".join(self._item.nodeid.split("::")[1:]))
        now, name = baseline.content(prediction, self.claim), self._shorten(path)
        mode = self._session.settings.baselines
        again = f"pytest '{self._item.nodeid}' --rattle-baselines"
        if not path.exists():
            if mode == "compare":
                self._fail(f"there is no baseline {name}; record it: {again}=record")
            self._guard(baseline.write, path, now, prediction.closure)
            self._record(kind="baseline", done=f"recorded {name}")
            return
        recorded = self._guard(baseline.read, path)
        changes = baseline.changes(recorded, now, relative, absolute)
        lines = baseline.format_changes(changes)
        if changes and mode != "regenerate":
            bound = f"{absolute:g} + {relative:g} of a value"
            said = f"{prediction.closure} differs from its baseline {name} by more than {bound}:"
            self._fail("\n".join([said, *lines, f"If that is meant: {again}=regenerate"]))
        if changes:
            self._guard(baseline.write, path, baseline.update(recorded, now, changes), prediction.closure)
        self._record(kind="baseline", done="\n".join([f"regenerated {name}", *lines]) if changes else "")

    def _once(self, kind: str) -> None:
        """Refuse a second call: rows are counted once at collection, and a test has one baseline file."""
        if kind in self._asked:
            self._fail(f"a test makes one {kind}; parametrize the test for more")
        self._asked.add(kind)

    def _guard(self, action: Callable[..., T], *given: Any) -> T:
        try:
            return action(*given)
        except RattleError as error:
            refusal = str(error)
        self._fail(refusal)

    def _fail(self, text: str) -> NoReturn:
        pytest.fail(harmless(f"rattle: {text}"), pytrace=False)

    def _record(self, **facts: Any) -> None:
        self._item.user_properties.append(("rattle", facts))

    def _figure(self, model: str, table: pd.DataFrame) -> str:
        from rattle.compare.report.style import save

        if self._session.folder is None:
            return ""
        name = re.sub(r"[^\w.-]+", "-", self._item.nodeid)
        path = self._session.folder / "figures" / f"{name}.svg"
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            save(messages.error_figure(table, model), path)
        except OSError as error:  # the verdict does not depend on the figure
            return f"\nNo figure: {error.strerror}"
        return f"\nFigure: {self._shorten(path)}"

    def _shorten(self, path: Path) -> str:
        """A path relative to the folder in which pytest was called, if it lies inside."""
        here = self._item.config.invocation_params.dir
        return str(path.relative_to(here) if path.is_relative_to(here) else path)
