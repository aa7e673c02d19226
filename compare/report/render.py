"""Write a page into its report's folder: as data, as Markdown, and as one self-contained HTML file."""

import base64
import re
from collections.abc import Collection
from functools import partial
from pathlib import Path

from rattle.compare.report.content import MARKS, NUMBER, Block, Code, Figure, Glossary, Page, Table, Text
from rattle.compare.report.html_file import make_environment, render_html
from rattle.compare.report.markup import as_code, as_html, as_markdown, fence
from rattle.compare.report.page_file import NAME, page_text
from rattle.compare.report.terms import Terms
from rattle.scene.text import line

PACKAGE = "rattle.compare.report"  # of the templates
TYPES = {".svg": "image/svg+xml", ".png": "image/png"}
KINDS = {Text: "text", Table: "table", Figure: "figure", Code: "code", Glossary: "glossary"}
DATA = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]*\.(csv|parquet|toml)")
"""Names of the files beside a page to which it links."""
LONG = 40
"""Folded tables with more rows are not printed: paper cannot sort them, and the table files hold them."""


def pages(name: str) -> tuple[str, str, str]:
    """Names of the files that `write_page` writes."""
    return NAME, f"{name}.md", f"{name}.html"


def write_page(page: Page, folder: Path, name: str) -> None:
    """Write a page into a folder: ``page.json``, ``name.md`` and ``name.html``."""
    texts = (page_text(page), markdown(page, data_files(folder)), html(page, folder))
    for file, text in zip(pages(name), texts, strict=True):
        (folder / file).write_text(text, encoding="utf-8")


def data_files(folder: Path) -> list[str]:
    """Names of the table files and settings in a report's folder."""
    return sorted(path.name for path in folder.iterdir() if path.is_file() and DATA.fullmatch(path.name))


def markdown(page: Page, files: Collection[str] = ()) -> str:
    """A page as Markdown; the figures are linked, and the files beside it."""
    environment = make_environment(PACKAGE, False)
    environment.filters |= {"md": partial(as_markdown, files=files), "code": as_code, "fence": fence, "line": line}
    text = environment.get_template("page.md.j2").render(page=page, kind=_kind, NUMBER=NUMBER, files=files)
    return re.sub(r"\n{3,}", "\n\n", text).rstrip() + "\n"


def html(page: Page, folder: Path) -> str:
    """A page as one HTML file that needs no other; figures are embedded, and table files in the folder are linked."""
    anchors, files, terms = _anchors(page), data_files(folder), Terms(_glossaries(page))
    plain = partial(as_html, files=files)
    filters = {
        "inline": plain,
        "explained": partial(as_html, files=files, words=terms.text),
        "head": lambda text: terms.head(text, plain(text)),
        "cell": lambda cell: terms.cell(cell.text, plain(cell.display)),
        "line": line,
        "anchor": lambda section: anchors[id(section)],
        "embed": lambda figure: _data_address(folder / figure.path),
    }
    return render_html(
        PACKAGE, "page", filters, page=page, kind=_kind, NUMBER=NUMBER, MARKS=MARKS, files=files, LONG=LONG
    )


def _glossaries(page: Page) -> list[Glossary]:
    blocks = [*page.blocks, *(block for section in page.all_sections() for block in section.blocks)]
    return [block for block in blocks if isinstance(block, Glossary)]


def _kind(block: Block) -> str:
    return KINDS[type(block)]


def _data_address(path: Path) -> str:
    return f"data:{TYPES[path.suffix]};base64," + base64.b64encode(path.read_bytes()).decode()


def _anchors(page: Page) -> dict[int, str]:
    """Anchor of each section by its `id`: the words of its title, numbered where they repeat."""
    anchors: dict[int, str] = {}
    taken = {"source": 1}
    for section in page.all_sections():
        words = re.sub(r"\W+", "-", section.title.lower()).strip("-") or "section"
        taken[words] = taken.get(words, 0) + 1
        anchors[id(section)] = words if taken[words] == 1 else f"{words}--{taken[words]}"
    return anchors
