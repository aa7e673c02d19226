"""Committed pages link what is committed with them."""

import re
import shutil
import subprocess
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).parents[2]
LINK = {".html": re.compile(r'(?:href|src)="([^"#:]+)"'), ".md": re.compile(r"\]\(([^)#: ]+)\)")}


def missing_links(page, committed):
    """Local links of a page that lead to no committed file."""
    links = LINK[page.suffix].findall((REPOSITORY / page).read_text(encoding="utf-8"))
    return sorted({link for link in links if str(page.parent / link) not in committed})


@pytest.mark.skipif(not (REPOSITORY / ".git").exists() or not shutil.which("git"), reason="needs the repository")
def test_local_links_of_committed_reports_lead_to_committed_files():
    listing = subprocess.run(["git", "ls-files", "reports"], cwd=REPOSITORY, capture_output=True, text=True, check=True)
    committed = set(listing.stdout.splitlines())
    pages = [Path(name) for name in sorted(committed) if name.endswith((".html", ".md"))]
    assert len(pages) > 10
    assert {str(page): lost for page in pages if (lost := missing_links(page, committed))} == {}
    page = next(page for page in pages if page.name == "chaos.html")
    assert missing_links(page, committed - {"reports/chaos/sweep.csv"}) == ["sweep.csv"]
