"""The documentation site: built without a warning and without a network, and what a browser shows
of it.

The code cells of its pages are run; the scripts of its gallery are run by ``make docs``, and one of
them here.
"""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
import source_tree
from commands import commands
from places import BUILT, ROOT
from programs import python

DOCS = ROOT / "docs"
SHOWN = ("start", "results/dat21", "guide/notebooks")
LESS = {
    b"--budget 15": b"--budget 2",
    b'"accuracy": 0.02': b'"accuracy": 0.1',
    b"accuracy=0.05,": b"accuracy=0.2,",
    b"refuse=False": b"refuse=False, budget=2.0",
    b'"exponent-sum", "free-flight", "impact-laws", "gear-rattle-basins"': b"",
    b"budget=15": b"budget=1",
    b'paths": 96': b'paths": 80',
    b'paths": 10_000': b'paths": 1_000',
    b"within=5e-4": b"within=5e-2",
}
"""What cells compute on the pages, and how much less of it here."""


SOURCES = [page for page in sorted(DOCS.rglob("*.md")) if not BUILT & set(page.parts)]


def tracked(*words):
    """Files that git lists."""
    listing = subprocess.run(["git", "ls-files", *words], cwd=ROOT, capture_output=True, check=True)
    return listing.stdout.decode().splitlines()


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """The site, from a copy of its sources: what is generated beside them stays out of the tree."""
    copy = tmp_path_factory.mktemp("repository")
    out = tmp_path_factory.mktemp("site")
    listed = ["docs", "examples", "reports", "CHANGELOG.md"]
    listed += ["tests/helpers", *source_tree.PACKAGES]  # whose lines a page counts
    for name in tracked("--cached", "--others", "--exclude-standard", *listed):
        if (ROOT / name).exists():
            (copy / name).parent.mkdir(parents=True, exist_ok=True)
            content = (ROOT / name).read_bytes()
            for much, less in LESS.items() if name.endswith(".md") else ():
                content = content.replace(much, less)
            (copy / name).write_bytes(content)
    offline = {f"{name}_proxy": "http://127.0.0.1:9" for name in ("http", "https")}
    offline |= {name.upper(): place for name, place in offline.items()}
    words = "-m sphinx -W --keep-going -q -b html -D plot_gallery=0"
    done = subprocess.run(
        [sys.executable, *words.split(), copy / "docs", out],
        capture_output=True,
        text=True,
        env=os.environ | offline,
        timeout=850,  # less than what ends a process that hangs
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return out


def test_tables_are_those_of_the_reports(site):
    """A number of a committed table stands on the page, and no page has a table without rows."""
    page = (site / "results" / "dat21.html").read_text()
    found = re.findall(r'<table class="[^"]*reported[^"]*".*?</table>', page, re.DOTALL)
    assert len(found) == 4
    assert all(table.count("<tr") > 4 for table in found)


def test_no_output_is_typed_by_hand(site):
    """What the program prints, and what a report took, is made or read when the site is built."""
    assert not [page for page in SOURCES if "at version 0" in page.read_text()]
    for page, said in (
        ("trust/published", " results hold; "),
        ("guide/pytest", "rattle: my_model exceeds the allowed error"),
    ):
        assert said not in (DOCS / f"{page}.md").read_text()
        assert said in (site / f"{page}.html").read_text(), page


def test_a_script_of_the_gallery_runs():
    python("-W", "ignore", DOCS / "gallery" / "plot_tolerances.py", MPLBACKEND="agg")


def test_no_page_asks_for_another_host(site):
    """No script, style, font or picture of another host: links alone lead there."""
    source = r'<(script|img|iframe|source)[^>]* src="(https?:)?//'
    link = r'<link[^>]* rel="(stylesheet|preload)"[^>]* href="(https?:)?//'
    for page in site.rglob("*.html"):
        assert not re.search(f"{source}|{link}", page.read_text()), page


@pytest.mark.parametrize("width", [1280, 390])
@pytest.mark.parametrize("name", SHOWN)
def test_fits_in_a_browser(browser, site, name, width):
    browser.open(site / f"{name}.html", width)
    assert browser.fits()
    assert not [url for url in browser.asked() if not url.startswith(("file:", "data:"))]
    assert "Runtime.exceptionThrown" not in [event["method"] for event in browser.events]


@pytest.mark.parametrize("width", [1280, 390])
def test_the_start_page_shows_all_of_its_animation_and_a_figure_that_can_be_read(
    browser, site, width
):
    browser.open(site / "index.html", width)
    # the animation says how high it is when it has been drawn
    browser.run("new Promise(done => setTimeout(done, 500))")
    inner, height = browser.run(
        "(f => [f.clientWidth, f.clientHeight])(document.querySelector('iframe'))"
    )
    natural, shown = browser.run(
        "(i => [i.naturalWidth, i.getBoundingClientRect().width])(document.querySelector('figure"
        " img'))"
    )
    assert shown > 0.8 * min(natural, 900)  # its letters are of 9 px
    browser.open(site / "_static" / "animation.html", inner)
    assert 0 <= height - browser.run("document.body.offsetHeight") < 40


def test_formulas_are_drawn(browser, site):
    """In the site's own font with a table for mathematics, whatever fonts the machine has."""
    browser.open(site / "model.html")
    fonts = (
        "document.fonts.ready.then(all => [...all].filter(f => f.status == 'loaded').map(f =>"
        " f.family))"
    )
    assert "STIX Two Math" in str(browser.run(fonts))
    font = "getComputedStyle(document.querySelector('math')).fontFamily"
    assert "STIX Two Math" in browser.run(font)
    drawn = "[...document.querySelectorAll('math')].map(m => m.getBoundingClientRect().height)"
    heights = browser.run(drawn)
    assert len(heights) > 100
    assert min(heights) > 5.0


def test_the_page_of_the_commands_is_short_and_has_every_option(browser, site):
    """What ``--help`` says is folded below the heading of each command."""
    browser.open(site / "guide" / "command-line.html")
    assert browser.run("document.documentElement.scrollHeight") < 6000
    text = browser.run("document.body.textContent")
    for name, _ in commands():
        assert f"rattle {name} --help" in text
        assert f"Usage: rattle {name}" in text
    assert "--accuracy" in text


LINK = {".html": re.compile(r'(?:href|src)="([^"#:]+)"'), ".md": re.compile(r"\]\(([^)#: ]+)\)")}


def missing_links(page, committed):
    """Local links of a page that lead to no committed file."""
    links = LINK[page.suffix].findall((ROOT / page).read_text(encoding="utf-8"))
    return sorted({link for link in links if str(page.parent / link) not in committed})


@pytest.mark.skipif(
    not (ROOT / ".git").exists() or not shutil.which("git"), reason="needs the repository"
)
def test_local_links_of_committed_reports_lead_to_committed_files():
    committed = set(tracked("reports"))
    pages = [Path(name) for name in sorted(committed) if name.endswith((".html", ".md"))]
    assert len(pages) > 10
    assert {str(page): lost for page in pages if (lost := missing_links(page, committed))} == {}
    page = next(page for page in pages if page.name == "chaos.html")
    assert missing_links(page, committed - {"reports/chaos/sweep.csv"}) == ["sweep.csv"]
