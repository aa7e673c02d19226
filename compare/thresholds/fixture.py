"""The fixture: compares a model with the simulation, or with its predictions recorded in a file
beside the test."""

import hashlib
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import pandas as pd
import pytest
import tomli_w

from rattle.compare.judge.rows import NamedSection
from rattle.compare.judge.verdict import Verdict
from rattle.compare.report.folder import write_whole
from rattle.compare.report.json_text import Facts
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
from rattle.compare.thresholds.judged import fail
from rattle.scene import FileError, RattleError, harmless, line
from rattle.scene.files import parse_toml, read_text
from rattle.scene.numpy_errors import numpy_defaults


def baseline_path(module: Path, test: str) -> Path:
    """Give the path of a test's baseline."""
    name = re.sub(r"[^\w.\[\]-]+", "-", test)
    if name != test:  # two tests may not share a file
        name += "-" + hashlib.sha256(test.encode()).hexdigest()[:6]
    return module.parent / "baselines" / module.stem / f"{name}.toml"


def baseline_content(prediction: NamedSection, claim: Claim) -> Facts:
    """Build the content of a baseline."""
    values = prediction.section[list(claim.columns)].astype(float).rename(str).to_dict()
    return {"values": values, **claim.scene.phase_reduced.to_dict()}


def read_baseline(path: Path) -> Facts:
    """Read a recorded baseline."""
    remedy = "restore it, or remove and record it"
    try:
        recorded = parse_toml(read_text("baseline", path))
    except FileError:
        raise
    except ValueError as error:
        raise FileError("baseline", str(path), f"is damaged ({error}); {remedy}") from None
    if not isinstance(recorded.get("values"), dict):
        raise FileError("baseline", str(path), f"has no table [values]; {remedy}")
    return recorded


def write_baseline(path: Path, content: Mapping[str, Any], model: str) -> None:
    """Write a baseline atomically."""
    what = f"Section moments of {line(model)} by quantity and impact, and their scene"
    head = f"# {what}; written by pytest\n# --rattle-baselines=record (or =regenerate).\n\n"
    write_whole(path, head + tomli_w.dumps(content))


def _flat(table: Mapping[str, Any], before: str = "") -> Iterator[tuple[str, Any]]:
    """The entries of a table and of those in it, with dotted keys."""
    for key, value in table.items():
        if isinstance(value, Mapping):
            yield from _flat(value, f"{before}{key}.")
        else:
            yield before + key, value


def describe_changes(
    recorded: Mapping[str, Any], now: Mapping[str, Any], relative: float, absolute: float
) -> list[str]:
    """A line for each entry that differs: values by more than ``absolute + relative *
    |recorded|``, everything else at all."""
    old = dict(_flat(recorded))
    new = dict(_flat(now))
    lines = []
    for key in old | new:
        a = old.get(key)
        b = new.get(key)
        same = a == b
        if key.startswith("values.") and isinstance(a, int | float) and isinstance(b, int | float):
            same = abs(b - a) <= absolute + relative * abs(a)
        if not same:
            lines.append(f"  {line(f'{key}: {_text(a)} -> {_text(b)}')}")
    return lines


def _text(value: object) -> str:
    if isinstance(value, float):
        return f"{value:.12g}"
    return "nothing" if value is None else str(value)


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
            name = prediction.closure
            run = decision.runs[-1].run
            size = f"{run.paths:,} paths"
            shown = partial(messages.moment_rows, run=run, z=decision.z)
        else:
            values = self._guard(predict_long, model, self.claim.scene, quantities)
            decision = self._guard(decide_long, values, self.claim, self._session)
            name = f"{values.name} in the long run"
            size = "{paths:,} paths of {periods:,} periods".format_map(decision.runs[-1].run.facts)
            shown = partial(messages.long_rows, z=decision.z)
        self._record_decision(name, decision, size)
        self._judge(name, decision.table, shown)
        return decision.table

    def _record_decision(self, model: str, decision: Decision, size: str) -> None:
        """Record what the summary of the session says of a decision."""
        table = decision.table
        of_moments = "still" in table
        kind = messages.kind_of(table)
        widened = decision.z if of_moments else float(table["widened"].max())
        session = self._session
        self._record(
            kind=kind,
            model=model,
            size=size,
            rows=len(table),
            not_judged=len(self.claim.rows) - len(table) if of_moments else 0,
            by_size=int((table["still"] > 0.0).sum()) if of_moments else 0,
            failed=int((table["verdict"] == Verdict.INACCURATE).sum()),
            undecided=len(messages.undecided_rows(table)),
            z=decision.z,
            rate=session.settings.false_alarm,
            widened=widened,
            is_wide=widened > messages.WIDER * decision.z,
            drawn=len(decision.runs),
            computed=sum(run.computed for run in decision.runs),
            seconds=sum(run.seconds for run in decision.runs),
            remedy=messages.describe_remedy(messages.paths_to_decide(table), kind),
            folder=self._shorten(session.folder) if session.folder else "",
        )

    def _judge(self, model: str, table: pd.DataFrame, shown: Callable[[pd.DataFrame], str]) -> None:
        """Fail or skip the test if its claim is not accurate."""
        if (table["verdict"] == Verdict.INACCURATE).any():
            fail(messages.failure_text(model, table, shown) + self._figure(model, table))
        if len(messages.undecided_rows(table)):
            text = messages.describe_undecided(model, table, shown)
            if (self.claim.undecided or self._session.settings.undecided) == "skip":
                pytest.skip(harmless(f"rattle: {text}"))
            remedies = messages.remedies(table, self.claim)
            fail(f"{text}\n{remedies}{self._figure(model, table)}")

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
                fail(f"there is no baseline {name}; record it: {again}=record")
            self._guard(write_baseline, path, now, prediction.closure)
            self._record(kind="baseline", done=f"recorded {name}")
            return
        recorded = self._guard(read_baseline, path)
        lines = describe_changes(recorded, now, relative, absolute)
        if lines and mode != "regenerate":
            bound = f"{absolute:g} + {relative:g} of a value"
            sentence = (
                f"{prediction.closure} differs from its baseline {name} by more than {bound}:"
            )
            fail("\n".join([sentence, *lines, f"If that is meant: {again}=regenerate"]))
        done = ""
        if lines:
            self._guard(write_baseline, path, now, prediction.closure)
            done = "\n".join([f"regenerated {name}", *lines])
        self._record(kind="baseline", done=done)

    def _once(self, kind: str) -> None:
        """Refuse a second call: rows are counted once at collection, and a test has one baseline
        file."""
        if kind in self._asked:
            fail(f"a test makes one {kind}; parametrize the test for more")
        self._asked.add(kind)

    def _guard(self, action: Callable[..., T], *given: Any) -> T:
        try:
            return action(*given)
        except RattleError as error:
            refusal = str(error)
        fail(refusal)

    def _record(self, **facts: Any) -> None:
        self._item.user_properties.append(("rattle", facts))

    def _figure(self, model: str, table: pd.DataFrame) -> str:
        """Draw a table of section moments; a line that says where the figure is."""
        from rattle.compare.report.style import render

        if self._session.folder is None or "moment" not in table:
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
