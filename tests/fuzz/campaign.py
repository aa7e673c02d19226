"""Run a fuzzing campaign: ``PYTHONPATH=. python tests/fuzz/campaign.py [--space wide]``.

Every scene goes through one entry point, which is drawn with it.  Scenes are near the paper's example and anywhere
(`fuzz_space`), or log-uniform over the whole admissible range and for every entry point (`fuzz_wide`).  Finished chunks
are kept in a working folder, so that the same command continues an interrupted campaign.  The report has the counts,
their figure and the slowest scenes.
"""

import argparse
import json
import sys
import time
from collections import Counter
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor, as_completed
from functools import cache
from math import log10
from pathlib import Path
from typing import Any, NamedTuple

import matplotlib.pyplot as plt
import pandas as pd
from hypothesis import HealthCheck, Phase, given, seed, settings
from hypothesis import strategies as st
from tqdm import tqdm

from rattle.compare.report import provenance
from rattle.compare.report.folder import check_free, whole_folder
from rattle.compare.report.json_text import json_text

sys.path.append(str(Path(__file__).parents[1] / "helpers"))  # as pytest does
from fuzz_checks import check
from fuzz_plan import BOUNDS, PLAN, examples, warm_up
from fuzz_watched import Outcome, Watched
from fuzz_wide_plan import WIDE, job

CHUNK = 100  # scenes
RARE = {"validate": 1, "branching": 4}  # in 100 scenes; the rest is shared by the others
COLOURS = {"complete": "#0072b2", "stopped": "#e69f00", "refused": "#bbbbbb", "defect": "#000000"}  # for every eye
NAMES = frozenset({"outcomes.csv", "summary.json", "outcomes.svg"})


Job = tuple[str, dict[str, Any], dict[str, Any]]
"""An entry point, a scene, and settings."""


@st.composite
def jobs(draw: st.DrawFn) -> Job:
    """A job of the space near the paper's example."""
    often = [name for name in PLAN if name not in RARE]
    number, limit = draw(st.integers(0, 99)), 0
    for name, share in RARE.items():
        limit += share
        if number < limit:
            return name, *draw(examples(name))
    name = often[number % len(often)]
    return name, *draw(examples(name))


def near(visit: Callable[[Job], None], chunk: int, first_seed: int) -> None:
    """Visit a chunk of scenes near the paper's example and beyond, by hypothesis."""

    @seed(1_000_000 * first_seed + chunk)
    @settings(
        max_examples=CHUNK, database=None, deadline=None, phases=[Phase.generate],
        suppress_health_check=list(HealthCheck),
    )  # fmt: skip
    @given(jobs())
    def visited(drawn: Job) -> None:
        visit(drawn)

    visited()


def wide(visit: Callable[[Job], None], chunk: int, first_seed: int) -> None:
    """Visit a chunk of scenes of all admissible magnitudes."""
    for number in range(CHUNK * chunk, CHUNK * (chunk + 1)):
        visit(job(first_seed, number))


class Space(NamedTuple):
    """What is tried, and where the report goes."""

    visit: Callable[[Callable[[Job], None], int, int], None]
    entries: tuple[str, ...]
    scenes: int
    out: Path


SPACES = {
    "near": Space(near, tuple(PLAN), 100_000, Path("reports/fuzz")),
    "wide": Space(wide, tuple(WIDE), 20_000, Path("reports/fuzz-wide")),
}


def decade(data: dict[str, Any]) -> int:
    """Decade of the time in which a typical path crosses the narrowest half gap."""
    scene = data["scene"] | data.get("gears", {})
    start = scene.get("start", {"y1": 2.0, "y2": 2.0})
    speed = max(scene["alpha"] + scene["sigma"], abs(start["y1"]), abs(start["y2"]))
    gaps = [scene.get("gap1", 0.5), scene.get("gap2", 0.5)][: scene["stages"]]
    return max(-12, min(9, int((log10(min(gaps)) - log10(speed)) // 1))) if speed > 0.0 else 9


@cache
def _watched(space: str) -> Watched:
    return Watched(check, BOUNDS, warm_up(*SPACES[space].entries))


def run_chunk(space: str, chunk: int, first_seed: int) -> dict[str, Any]:
    """Counts by (entry, how it ended, why, decade), defects, seconds by entry, and the slowest scene of each."""
    counts: Counter[tuple[str, str, str, int]] = Counter()
    seconds: Counter[str] = Counter()
    defects: list[dict[str, Any]] = []
    slowest: dict[str, Any] = {}
    watched = _watched(space)

    def visit(drawn: Job) -> None:
        found: Outcome = watched.run(*drawn)
        entry, data, _ = drawn
        ended, why = ("defect", found.ended) if found.defect else (found.ended, found.detail)
        counts[entry, ended, why, decade(data)] += 1
        seconds[entry] += found.seconds
        if found.defect:
            defects.append({"job": repr(drawn), "ended": found.ended, "detail": found.detail[-3000:]})
        elif found.seconds > slowest.get(entry, {"seconds": 0.0})["seconds"]:
            slowest[entry] = {"seconds": round(found.seconds, 3), "job": repr(drawn)}

    SPACES[space].visit(visit, chunk, first_seed)
    rows = [[*key, count] for key, count in counts.items()]
    return {"chunk": chunk, "rows": rows, "defects": defects, "seconds": dict(seconds), "slowest": slowest}


def combined(chunks: list[dict[str, Any]]) -> tuple[pd.DataFrame, list[dict[str, Any]], dict[str, Any]]:
    """All chunks together."""
    columns = ["entry", "ended", "why", "decade", "scenes"]
    table = pd.DataFrame([row for c in chunks for row in c["rows"]], columns=columns)
    table = table.groupby(columns[:-1], as_index=False)["scenes"].sum()
    slowest: dict[str, Any] = {}
    for chunk in chunks:
        for entry, found in chunk["slowest"].items():
            if found["seconds"] > slowest.get(entry, {"seconds": 0.0})["seconds"]:
                slowest[entry] = found
    return table, [d for c in chunks for d in c["defects"]], slowest


def drawn(table: pd.DataFrame, entries: tuple[str, ...]) -> Any:
    """Share of outcomes of each entry point over the time in which a typical path crosses the narrowest half gap."""
    rows = -(-(len(entries) + 1) // 4)  # a place is left for the legend
    figure, axes = plt.subplots(rows, 4, figsize=(11.0, 2.2 * rows), sharex=True, sharey=True, layout="constrained")
    for ax, entry in zip(axes.flat, entries, strict=False):
        part = table[table["entry"] == entry].pivot_table("scenes", "decade", "ended", "sum", fill_value=0)
        shares, bottom = part.div(part.sum(axis=1), axis=0), 0.0 * part.sum(axis=1)
        for ended, colour in COLOURS.items():
            if ended in shares:
                ax.bar(shares.index + 0.5, shares[ended], 1.0, bottom=bottom, color=colour, label=ended)
                bottom = bottom + shares[ended]
        ax.set_title(f"{entry} ({int(part.to_numpy().sum()):,})", fontsize=9)
    for ax in axes.flat[len(entries) :]:
        ax.set_visible(False)
    figure.supxlabel("narrowest half gap over typical speed, log10")
    figure.supylabel("share of the scenes")
    handles = [plt.Rectangle((0, 0), 1, 1, color=c) for c in COLOURS.values()]
    figure.legend(handles, COLOURS, loc="lower right", ncols=2, frameon=False)
    return figure


def report(out: Path, space: str, chunks: list[dict[str, Any]], facts: dict[str, Any]) -> dict[str, Any]:
    """Write the counts, the summary and the figure."""
    table, defects, slowest = combined(chunks)
    tried = int(table["scenes"].sum())
    ended = table.groupby("ended")["scenes"].sum().to_dict()
    seconds = sum((Counter(c["seconds"]) for c in chunks), Counter[str]())
    summary = {
        "space": space, "scenes": tried, "ended": {k: int(v) for k, v in ended.items()}, "defects": len(defects),
        "entries": {
            e: {str(k): int(v) for k, v in part.groupby("ended")["scenes"].sum().items()}
            for e, part in table.groupby("entry")
        },
        "seconds": {e: round(s, 1) for e, s in seconds.items()}, "bound_seconds": BOUNDS,
        "slowest": slowest, "commit": provenance.commit(), "versions": provenance.versions(),
        **facts,
    }  # fmt: skip
    with whole_folder(out, NAMES, overwrite=True) as folder:
        table.to_csv(folder / "outcomes.csv", index=False)
        (folder / "summary.json").write_text(json_text(summary) + "\n", encoding="utf-8")
        plt.rcParams["svg.hashsalt"] = "rattle"
        drawn(table, SPACES[space].entries).savefig(folder / "outcomes.svg", metadata={"Date": None})
    for defect in defects:
        print(defect["ended"], defect["job"], defect["detail"], sep="\n", file=sys.stderr)
    return summary


def main() -> int:
    """Run what is missing of a campaign, and report."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--space", choices=SPACES, default="near")
    options.add_argument("--scenes", type=int, help=f"in whole chunks of {CHUNK}; 100 000 near, 20 000 wide by default")
    options.add_argument("--seed", type=int, default=0)
    options.add_argument("--workers", type=int, default=2)
    options.add_argument("--work", type=Path, default=Path("build/fuzz"), help="where finished chunks are kept")
    options.add_argument("--out", type=Path, help="reports/fuzz or reports/fuzz-wide by default")
    asked = options.parse_args()
    space = SPACES[asked.space]
    out, scenes = asked.out or space.out, asked.scenes or space.scenes
    check_free(out, NAMES, overwrite=True)
    work = asked.work / f"{provenance.commit()[:16]}-{asked.space}-{asked.seed}"
    work.mkdir(parents=True, exist_ok=True)
    numbers = range(-(-scenes // CHUNK))
    chunks = [json.loads(p.read_text(encoding="utf-8")) for n in numbers if (p := work / f"{n}.json").exists()]
    left = [n for n in numbers if not (work / f"{n}.json").exists()]
    started = time.perf_counter()
    with ProcessPoolExecutor(asked.workers) as pool:
        futures = [pool.submit(run_chunk, asked.space, n, asked.seed) for n in left]
        try:
            for future in tqdm(as_completed(futures), total=len(left), unit="chunk", disable=None):
                chunk = future.result()
                scratch = work / f"{chunk['chunk']}.part"
                scratch.write_text(json.dumps(chunk), encoding="utf-8")
                scratch.rename(work / f"{chunk['chunk']}.json")
                chunks.append(chunk)
        except BaseException:
            pool.shutdown(cancel_futures=True)
            raise
    facts = {"seed": asked.seed, "seconds_of_this_call": round(time.perf_counter() - started, 1)}
    summary = report(out, asked.space, sorted(chunks, key=lambda c: int(c["chunk"])), facts)
    print(f"{summary['scenes']:,} scenes: {summary['ended']}, {summary['defects']} defects; report in {out}")
    return 1 if summary["defects"] else 0


if __name__ == "__main__":
    sys.exit(main())
