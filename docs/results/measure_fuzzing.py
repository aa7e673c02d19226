"""Run a fuzzing campaign: ``PYTHONPATH=. python docs/results/measure_fuzzing.py [--scenes N]``.

Every scene goes through one entry point, which is drawn with it.  Finished chunks are kept in a
working folder, so that the same command continues an interrupted campaign.  The report has the
counts, their figure and the slowest scenes.
"""

import argparse
import faulthandler
import json
import multiprocessing
import sys
import time
import traceback
import warnings
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from math import log10
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import pandas as pd
from tqdm import tqdm

from rattle.compare.report import provenance
from rattle.compare.report.folder import check_free, whole_folder
from rattle.compare.report.json_text import json_text

# as pytest does
sys.path.extend(str(Path(__file__).parents[2] / "tests" / folder) for folder in ("helpers", "fuzz"))
from fuzz_checks import check
from fuzz_plan import PLAN, job

CHUNK = 100  # scenes
# seconds for a scene: 64 sticking paths of ten million steps each take 72
BOUND = 300.0
# for every eye
COLOURS = {
    "complete": "#0072b2",
    "stopped": "#e69f00",
    "refused": "#bbbbbb",
    "defect": "#000000",
}
NAMES = frozenset({"outcomes.csv", "summary.json", "outcomes.svg"})


def decade(data: dict[str, Any]) -> int:
    """Decade of the time in which a typical path crosses the narrowest half gap."""
    scene = data["scene"] | data.get("gears", {})
    start = scene.get("start", {"y1": 2.0, "y2": 2.0})
    speed = max(scene["alpha"] + scene["sigma"], abs(start["y1"]), abs(start["y2"]))
    gaps = [scene.get("gap1", 0.5), scene.get("gap2", 0.5)][: scene["stages"]]
    return max(-12, min(9, int((log10(min(gaps)) - log10(speed)) // 1))) if speed > 0.0 else 9


def answer(entry: str, data: dict[str, Any], settings: dict[str, Any]) -> tuple[str, str, float]:
    """How an entry point ends, why, and its seconds; a process that needs too long ends itself."""
    faulthandler.dump_traceback_later(BOUND, exit=True)
    warnings.simplefilter("error")
    started = time.process_time()
    try:
        ended, why = check(entry, data, settings)
    except Exception:
        traceback.print_exc()
        ended = "defect"
        why = "broken"
    faulthandler.cancel_dump_traceback_later()
    return ended, why, time.process_time() - started


def run_chunk(seed: int, chunk: int, place: Path) -> pd.DataFrame:
    """One row a scene: entry, how it ended, why, decade, seconds, the job; kept in a file."""
    spawn = multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(1, spawn)
    rows = []
    for number in range(CHUNK * chunk, CHUNK * (chunk + 1)):
        entry, data, settings = job(seed, number)
        try:
            ended, why, seconds = pool.submit(answer, entry, data, settings).result()
        except BrokenProcessPool:
            ended, why, seconds = "defect", "hung or died", BOUND
            pool = ProcessPoolExecutor(1, spawn)
        rows.append([entry, ended, why, decade(data), seconds, repr((entry, data, settings))])
        if ended == "defect":
            print(why, rows[-1][-1], sep="\n", file=sys.stderr)
    pool.shutdown()
    table = pd.DataFrame(rows, columns=["entry", "ended", "why", "decade", "seconds", "job"])
    scratch = place.with_suffix(".part")
    table.to_csv(scratch, index=False)
    scratch.rename(place)
    return table


def drawn(table: pd.DataFrame) -> Any:
    """Share of outcomes of each entry point over the time in which a typical path crosses the
    narrowest half gap."""
    rows = -(-(len(PLAN) + 1) // 4)  # a place is left for the legend
    figure, axes = plt.subplots(
        rows, 4, figsize=(11.0, 2.2 * rows), sharex=True, sharey=True, layout="constrained"
    )
    for ax, entry in zip(axes.flat, PLAN, strict=False):
        part = pd.crosstab(
            *(table.loc[table["entry"] == entry, name] for name in ("decade", "ended"))
        )
        shares = part.div(part.sum(axis=1), axis=0)
        bottom = 0.0 * part.sum(axis=1)
        for ended, colour in COLOURS.items():
            if ended in shares:
                ax.bar(
                    shares.index + 0.5, shares[ended], 1.0, bottom=bottom, color=colour, label=ended
                )
                bottom = bottom + shares[ended]
        ax.set_title(f"{entry} ({int(part.to_numpy().sum()):,})", fontsize=9)
    for ax in axes.flat[len(PLAN) :]:
        ax.set_visible(False)
    figure.supxlabel("narrowest half gap over typical speed, log10")
    figure.supylabel("share of the scenes")
    handles = [plt.Rectangle((0, 0), 1, 1, color=c) for c in COLOURS.values()]
    figure.legend(handles, COLOURS, loc="lower right", ncols=2, frameon=False)
    return figure


def report(out: Path, table: pd.DataFrame, seed: int) -> dict[str, Any]:
    """Write the counts, the summary and the figure."""
    ended = table.groupby("ended").size().to_dict()
    slowest = table.loc[table.groupby("entry")["seconds"].idxmax()].set_index("entry")
    summary = {
        "scenes": len(table),
        "ended": ended,
        "defects": ended.get("defect", 0),
        "entries": {
            e: part.groupby("ended").size().to_dict() for e, part in table.groupby("entry")
        },
        "seconds": table.groupby("entry")["seconds"].sum().round(1).to_dict(),
        "bound_seconds": BOUND,
        "slowest": slowest[["seconds", "job"]].to_dict("index"),
        "seed": seed,
        "commit": provenance.commit(),
        "versions": provenance.versions(),
    }
    counts = (
        table.fillna("")
        .groupby(["entry", "ended", "why", "decade"])
        .size()
        .rename("scenes")
        .reset_index()
    )
    with whole_folder(out, NAMES, overwrite=True) as folder:
        counts.to_csv(folder / "outcomes.csv", index=False)
        (folder / "summary.json").write_text(
            json_text(json.loads(json.dumps(summary, default=int))) + "\n"
        )
        plt.rcParams["svg.hashsalt"] = "rattle"
        drawn(table).savefig(folder / "outcomes.svg", metadata={"Date": None})
    return summary


def main() -> int:
    """Run what is missing of a campaign, and report."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--scenes", type=int, default=20_000, help=f"in whole chunks of {CHUNK}")
    options.add_argument("--seed", type=int, default=0)
    options.add_argument("--workers", type=int, default=2)
    options.add_argument(
        "--work", type=Path, default=Path("build/fuzz"), help="where finished chunks are kept"
    )
    options.add_argument("--out", type=Path, default=Path("reports/fuzz-wide"))
    asked = options.parse_args()
    check_free(asked.out, NAMES, overwrite=True)
    work = asked.work / f"{provenance.commit()[:16]}-{asked.seed}"
    work.mkdir(parents=True, exist_ok=True)
    places = [work / f"{n}.csv" for n in range(-(-asked.scenes // CHUNK))]
    with ThreadPoolExecutor(asked.workers) as pool:
        missing = [
            pool.submit(run_chunk, asked.seed, n, p) for n, p in enumerate(places) if not p.exists()
        ]
        try:
            for future in tqdm(
                as_completed(missing), total=len(missing), unit="chunk", disable=None
            ):
                future.result()
        except BaseException:
            pool.shutdown(cancel_futures=True)
            raise
    summary = report(asked.out, pd.concat(map(pd.read_csv, places), ignore_index=True), asked.seed)
    print(
        f"{summary['scenes']:,} scenes: {summary['ended']}, {summary['defects']} defects; report in"
        f" {asked.out}"
    )
    return 1 if summary["defects"] else 0


if __name__ == "__main__":
    sys.exit(main())
