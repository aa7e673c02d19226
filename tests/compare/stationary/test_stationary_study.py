"""Studies of the long run, and claims about it in pytest."""

import json
from dataclasses import replace

import pytest
from commands import rattle
from places import ROOT
from refusals import refusal
from scenes import dat21

import rattle as rt

LONG_STUDY = """
[study]
kind = "stationary"
title = "the pair"
closures = ["saltation", "corrected"]
periods = 64
paths = 32

[scene]
alpha = 0.25
epsilon = 0.5
beta1 = 0.02
gamma1 = 0.0
stages = 1

[[axes]]
sigma = [0.0, 0.002, 0.3]
"""


def test_study_runs_and_is_kept(tmp_path):
    file = tmp_path / "pair.toml"
    file.write_text(LONG_STUDY)
    assert json.loads(rattle(f"study {file} --json").stdout)["complete"]
    folder = tmp_path / "pair"
    assert (folder / "figures/long-run.svg").stat().st_size > 0
    tables = rt.load_study(folder)
    rate = tables.quantities.query("quantity == 'rate'").set_index("sigma")
    assert rate["se"][0.0] == 0.0
    verdicts = tables.verdicts.set_index(["closure", "quantity", "sigma"])["verdict"]
    for name in ("rate", "speed", "energy_per_period", "slow_share"):
        assert verdicts["saltation", name, 0.002] == "accurate"
    assert verdicts["saltation", "speed", 0.3] == "inaccurate"
    assert float(tables.to_xarray()["value"].sel(sigma=0.0, quantity="rate")) == rate["value"][0.0]
    assert "up to date" in rattle(f"study {file}").stderr
    nothing = replace(tables, verdicts=tables.verdicts.assign(verdict="not predicted")).plot()
    assert all(ax.lines for ax in nothing.axes if ax.get_visible())


def test_over_a_value_of_the_gears_all_is_in_physical_units(tmp_path):
    scene = dat21(0.5)
    file = tmp_path / "gears.toml"
    head = '[study]\nkind = "stationary"\nclosures = []\nperiods = 64\npaths = 32\n'
    file.write_text(head + scene.to_toml() + "[[axes]]\nbacklash1 = [0.2, 0.4]\n")
    assert "impacts a second that are not slow: from" in rattle(f"study {file}").stdout
    table = rt.load_study(tmp_path / "gears").quantities
    rows = table.query("backlash1 == 0.4").set_index("quantity")
    changed = scene.with_gears(backlash1=0.4)
    alone = rt.stationary(changed, slow=0.05, periods=64, paths=32, closures=())  # as fast, in mm/s
    at = (["rate_above", "power", "q95_speed"], ["value", "unit"])
    assert rows.loc[at].equals(alone.table_in("physical").loc[at])
    assert "backlash at mesh 1, mm" in (tmp_path / "gears/figures/long-run.svg").read_text()


def test_a_study_over_two_fields_has_a_figure_for_each_value_of_the_second():
    tables = rt.load_study(ROOT / "reports/studies/long-memory")
    values = sorted(tables.quantities["correlation_time"].unique())
    ax = tables.plot(sigma=tables.quantities["sigma"][0]).axes[0]
    assert list(ax.lines[0].get_xdata()) == values
    assert ax.get_xscale() == "symlog"  # logarithmic beside 0
    with refusal("no field varies"):
        tables.plot(sigma=3.0)


@pytest.mark.parametrize(
    ("old", "new", "word"),
    [
        ("periods = 64", "periods = 64\naccuracy = 0.1", "periods"),
        ('"saltation"', '"linear"', "closures"),
        ("periods = 64", "impacts = 12", "impacts"),
        ('kind = "stationary"', 'kind = "static"', "kind"),
        ("sigma = [0.0, 0.002, 0.3]", "scheme = ['a']", "scheme"),
    ],
)
def test_bad_studies_are_refused(old, new, word):
    with refusal(word):
        assert rt.Study.from_toml(LONG_STUDY.replace(old, new)).points
