"""The fixture: compares a model with the simulation, or with its predictions recorded in a file
beside the test."""

import hashlib
import re
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NoReturn, TypeVar

import pandas as pd
import pytest
import tomli_w

from rattle.compare.judge.rows import NamedSection
from rattle.compare.report.folder import write_whole
from rattle.compare.thresholds import messages
from rattle.compare.thresholds.claim import Claim
from rattle.compare.thresholds.decision import (
    Decision,
    Model,
    Thresholds,
    decide,
    decide_long,
    predict,
    predict_long,
)
from rattle.compare.validation.verdict import Verdict
from rattle.scene import FileError, RattleError, harmless, line
from rattle.scene.files import parse_toml, read_text
from rattle.scene.numpy_errors import numpy_defaults

Changes = dict[str, tuple[Any, Any]]
"""Recorded and present value, by dotted key in the file; None for a missing one."""


def baseline_path(module: Path, test: str) -> Path:
    """Give the path of a test's baseline."""
    name = re.sub(r"[^\w.\[\]-]+", "-", test)
    if name != test:  # two tests may not share a file
        name += "-" + hashlib.sha256(test.encode()).hexdigest()[:6]
    return module.parent / "baselines" / module.stem / f"{name}.toml"


def baseline_content(prediction: NamedSection, claim: Claim) -> dict[str, Any]:
    """Build the content of a baseline."""
    values = prediction.section[list(claim.columns)].astype(float).rename(str).to_dict()
    return {"values": values, **claim.scene.phase_reduced.to_dict()}


def read_baseline(path: Path) -> dict[str, Any]:
    """Read a recorded baseline."""
    try:
        found = parse_toml(read_text("baseline", path))
    except FileError:
        raise
    except ValueError as error:
        raise FileError(
            "baseline", str(path), f"is damaged ({error}); restore it, or remove and record it"
        ) from None
    if not isinstance(found.get("values"), dict):
        raise FileError(
            "baseline", str(path), "has no table [values]; restore it, or remove and record it"
        )
    return found


def write_baseline(path: Path, found: Mapping[str, Any], model: str) -> None:
    """Write a baseline atomically."""
    what = f"Section moments of {line(model)} by quantity and impact, and their scene"
    head = f"# {what}; written by pytest\n# --rattle-baselines=record (or =regenerate).\n\n"
    write_whole(path, head + tomli_w.dumps(found))


def _flat(table: Mapping[str, Any], before: str = "") -> dict[str, Any]:
    found: dict[str, Any] = {}
    for key, value in table.items():
        found |= (
            _flat(value, f"{before}{key}.") if isinstance(value, Mapping) else {before + key: value}
        )
    return found


def find_changes(
    recorded: Mapping[str, Any], now: Mapping[str, Any], relative: float, absolute: float
) -> Changes:
    """Find what differs: values by more than ``absolute + relative * |recorded|``, everything else
    at all."""
    old = _flat(recorded)
    new = _flat(now)

    def same(key: str) -> bool:
        a = old.get(key)
        b = new.get(key)
        if key.startswith("values.") and isinstance(a, int | float) and isinstance(b, int | float):
            return abs(b - a) <= absolute + relative * abs(a)
        return bool(a == b)

    return {
        key: (old.get(key), new.get(key)) for key in dict.fromkeys([*old, *new]) if not same(key)
    }


def format_changes(changed: Changes) -> list[str]:
    """Format changes as lines of text."""
    return [
        f"  {line(f'{key}: {_text(old)} -> {_text(new)}')}" for key, (old, new) in changed.items()
    ]


def _text(value: object) -> str:
    return (
        "nothing" if value is None else f"{value:.12g}" if isinstance(value, float) else str(value)
    )


T = TypeVar("T")


@numpy_defaults
class Rattle:
    """The value of the fixture ``rattle``."""

    def __init__(self, item: pytest.Item, claim: Claim, session: Thresholds) -> None:
        self.claim = claim
        self._item = item
        self._session = session
        self._asked: set[str] = set()

    def check(
        self, model: str | Callable[..., Any], *, quantities: str | Sequence[str] | None = None
    ) -> pd.DataFrame:
        """Compare a model's section moments with the simulation of the marker's scene.

        The test fails if the whole interval of an error lies outside the admissible range, and
        passes if all intervals lie inside.  Otherwise it is undecided and tried again with more
        paths, up to its budget (`rattle.compare.thresholds.decision`).  A test that stays undecided
        fails, unless the marker's ``undecided`` or ``--rattle-undecided`` is ``skip``.

        `quantities`: Quantities of the long run, such as ``["rate", "energy"]``, in place of the
        marker's section moments.  The model is then a closure, or a function ``(scene, quantities)
        -> mapping`` of names to dimensionless values, whose ``unit`` stands in the table; what
        counts as accurate is said in `rattle.compare.stationary.verdicts.TOLERANCES`.
        """
        self._once("check")
        if quantities is None:
            prediction = self._guard(predict, model, self.claim)
            decision = self._guard(decide, prediction, self.claim, self._session)
            table = decision.table
            run = decision.runs[-1].run
            shown = partial(messages.moment_rows, run=run, z=decision.z)
            by_size = int((table["still"] > 0.0).sum())
            facts = {
                "kind": "check",
                "not_judged": len(self.claim.rows) - len(table),
                "by_size": by_size,
            }
            return self._judge(
                prediction.closure, decision, shown, facts | {"size": f"{run.paths:,} paths"}
            )
        said = self._guard(predict_long, model, self.claim.scene, quantities)
        decision = self._guard(decide_long, said, self.claim, self._session)
        length = "{paths:,} paths of {periods:,} periods".format_map(decision.runs[-1].run.facts)
        facts = {"kind": "long check", "not_judged": 0, "by_size": 0, "size": length}
        return self._judge(
            f"{said.name} in the long run",
            decision,
            partial(messages.long_rows, z=decision.z),
            facts,
        )

    def _judge(
        self,
        model: str,
        decision: Decision,
        shown: Callable[[pd.DataFrame], str],
        facts: dict[str, Any],
    ) -> pd.DataFrame:
        """Record the decision on a claim, and fail or skip the test that it does not pass."""
        table = decision.table
        runs = decision.runs
        settings = self._session.settings
        failed = int((table["verdict"] == Verdict.INACCURATE).sum())
        undecided = messages.count_undecided(table)
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
        figure = partial(self._figure, model, table) if facts["kind"] == "check" else str
        if failed:
            self._fail(messages.failure_text(model, table, shown) + figure())
        if undecided:
            text = messages.describe_undecided(model, table, shown)
            if (self.claim.undecided or settings.undecided) == "skip":
                pytest.skip(harmless(f"rattle: {text}"))
            self._fail(f"{text}\n{messages.remedies(table, self.claim)}{figure()}")
        return table

    def baseline(self, model: Model, *, relative: float = 1e-9, absolute: float = 1e-12) -> None:
        """Compare a model's predictions with those recorded in ``baselines/`` beside the test;
        nothing is simulated."""
        self._once("baseline")
        prediction = self._guard(predict, model, self.claim)
        path = baseline_path(self._item.path, ".".join(self._item.nodeid.split("::")[1:]))
        now = baseline_content(prediction, self.claim)
        name = self._shorten(path)
        mode = self._session.settings.baselines
        again = f"pytest '{self._item.nodeid}' --rattle-baselines"
        if not path.exists():
            if mode == "compare":
                self._fail(f"there is no baseline {name}; record it: {again}=record")
            self._guard(write_baseline, path, now, prediction.closure)
            self._record(kind="baseline", done=f"recorded {name}")
            return
        lines = format_changes(
            find_changes(self._guard(read_baseline, path), now, relative, absolute)
        )
        if lines and mode != "regenerate":
            bound = f"{absolute:g} + {relative:g} of a value"
            said = f"{prediction.closure} differs from its baseline {name} by more than {bound}:"
            self._fail("\n".join([said, *lines, f"If that is meant: {again}=regenerate"]))
        if lines:
            self._guard(write_baseline, path, now, prediction.closure)
        self._record(
            kind="baseline", done="\n".join([f"regenerated {name}", *lines]) if lines else ""
        )

    def _once(self, kind: str) -> None:
        """Refuse a second call: rows are counted once at collection, and a test has one baseline
        file."""
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
        from rattle.compare.report.style import render

        if self._session.folder is None:
            return ""
        name = re.sub(r"[^\w.-]+", "-", self._item.nodeid)
        path = self._session.folder / "figures" / f"{name}.svg"
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(render(messages.error_figure(table, model)))
        except OSError as error:  # the verdict does not depend on the figure
            return f"\nNo figure: {error.strerror}"
        return f"\nFigure: {self._shorten(path)}"

    def _shorten(self, path: Path) -> str:
        """A path relative to the folder in which pytest was called, if it lies inside."""
        here = self._item.config.invocation_params.dir
        return str(path.relative_to(here) if path.is_relative_to(here) else path)
