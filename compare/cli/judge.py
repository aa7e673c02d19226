"""The command that judges samples of one's own."""

import sys
from pathlib import Path
from typing import Any

import click

from rattle.compare.cli import shared
from rattle.compare.cli.shared import EXIT_NOT_MET, Results
from rattle.compare.report.folder import name_of

COARSER_HELP = "Samples at twice the step: the bias of the step is estimated."
ROWS_HELP = "Column that numbers the rows. [default: impact, row or time]"
NAMES_HELP = "Column of the samples that is a quantity; repeatable. [default: all numbers]"


@click.command()
@click.argument("predicted", type=shared.FILE_PATH)
@click.argument("samples", type=shared.FILE_PATH)
@click.option("--coarser", type=shared.FILE_PATH, help=COARSER_HELP)
@click.option("--rows", metavar="NAME", help=ROWS_HELP)
@shared.several("quantity", "quantities", str, NAMES_HELP)
@click.option("--groups", metavar="NAME", help="Column with the groups of paths that are related.")
@shared.real("level", "Probability with which all intervals hold together.", 0.95)
@shared.real("mean", "Largest error of a mean that counts as accurate, in sds.", 0.05)
@shared.real("sd", "The same of an sd.", 0.10)
@shared.real("rho", "The same of a correlation, absolute.", 0.05)
@shared.real("skew", "The same of a skewness.", 0.2)
@shared.real("kurt", "The same of an excess kurtosis.", 0.5)
@click.option(
    "--require",
    type=click.Choice(["accurate"]),
    help="Exit 3 unless every predicted moment is accurate.",
)
@shared.folder_options("reports/NAME-judge", shared.JSON_ALONE)
def judge(
    predicted: Path,
    samples: Path,
    coarser: Path | None,
    rows: str | None,
    quantities: tuple[str, ...],
    groups: str | None,
    level: float,
    require: str | None,
    out: Path | None,
    overwrite: bool,
    as_json: bool,
    **tolerances: float,
) -> None:
    """Judge predicted moments by samples of any simulation.

    PREDICTED is a CSV or Parquet file with columns x, sd_x, skew_x, kurt_x, rho_x_y, a row for each
    impact or time; a column closure tells several apart. SAMPLES is a file with columns path, the
    same rows and the quantities, a folder of such files, or a table with columns x, se_x, sd_x,
    se_sd_x, paths.

    Exit codes: 0 the run is complete, whatever the verdicts; 2 bad input; 3 --require is not met.
    """
    from rattle.compare.judge.judge import judge as judge_samples
    from rattle.compare.judge.predictions import read_predictions
    from rattle.compare.judge.verdict import Tolerances
    from rattle.scene import InputError

    results = Results(name_of(predicted), out, "judge", "judge.page", overwrite, as_json)
    tables = dict(read_predictions(predicted))
    if rows is not None:
        missing = [name for name, table in tables.items() if rows not in table]
        named = all(table.index.name == rows for table in tables.values())
        if missing and not named:
            raise InputError("rows", rows, "is no column of PREDICTED")
        if not named:
            tables = {name: table.set_index(rows) for name, table in tables.items()}
    limits = Tolerances(**tolerances)
    asked: dict[str, Any] = {"level": level, "tolerances": limits, "groups": groups}
    judgement = judge_samples(tables, samples, coarser=coarser, names=quantities or None, **asked)
    results.conclude(judgement, predicted=str(predicted), samples=str(samples))
    if require and not judgement.accurate:
        sys.exit(EXIT_NOT_MET)
