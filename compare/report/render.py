"""Write a page into its report's folder: as data, as Markdown, and as one self-contained HTML file."""

import base64
import hashlib
import re
from collections.abc import Collection, Iterator
from functools import cache, partial
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING

from rattle.compare.report.content import MARKS, NUMBER, Block, Code, Figure, Glossary, Page, PageSection, Table, Text
from rattle.compare.report.markup import as_code, as_html, as_markdown, fence
from rattle.compare.report.page_file import NAME, page_text
from rattle.compare.report.terms import Terms
from rattle.scene.text import harmless, line

if TYPE_CHECKING:
    from jinja2 import Environment

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
    environment = _environment(False)
    environment.filters |= {"md": partial(as_markdown, files=files), "code": as_code, "fence": fence, "line": line}
    text = environment.get_template("page.md.j2").render(page=page, kind=_kind, NUMBER=NUMBER, files=files)
    return re.sub(r"\n{3,}", "\n\n", text).rstrip() + "\n"


def html(page: Page, folder: Path) -> str:
    """A page as one HTML file that needs no other; figures are embedded, and table files in the folder are linked."""
    from markupsafe import Markup

    style, script = _part("page.css"), _part("page.js")
    policy = (
        f"default-src 'none'; img-src data:; style-src '{_hash(style)}'; script-src '{_hash(script)}'; "
        "base-uri 'none'; form-action 'none'"
    )
    environment = _environment(True)
    anchors, files, terms = _anchors(page), data_files(folder), Terms(_glossaries(page))
    plain = partial(as_html, files=files)
    environment.filters |= {
        "inline": plain,
        "explained": partial(as_html, files=files, words=terms.text),
        "head": lambda text: terms.head(text, plain(text)),
        "cell": lambda cell: terms.cell(cell.text, plain(cell.shown)),
        "line": line,
        "anchor": lambda section: anchors[id(section)],
    }
    return environment.get_template("page.html.j2").render(
        page=page,
        kind=_kind,
        NUMBER=NUMBER,
        MARKS=MARKS,
        policy=policy,
        style=Markup(style),
        script=Markup(script),
        embedded=lambda figure: _embed(folder / figure.path),
        files=files,
        LONG=LONG,
    )


def _environment(escaped: bool) -> "Environment":
    from jinja2 import Environment, PackageLoader, StrictUndefined  # for what writes pages only

    return Environment(
        loader=PackageLoader("rattle.compare.report"),
        autoescape=escaped,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=StrictUndefined,
        finalize=lambda value: harmless(value) if type(value) is str else value,
    )


def _glossaries(page: Page) -> list[Glossary]:
    blocks = [*page.blocks, *(block for section in page.all_sections() for block in section.blocks)]
    return [block for block in blocks if isinstance(block, Glossary)]


def _kind(block: Block) -> str:
    return KINDS[type(block)]


@cache
def _part(name: str) -> str:
    return files("rattle.compare.report").joinpath("templates", name).read_text(encoding="utf-8")


def _hash(text: str) -> str:
    return "sha256-" + base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()


def _embed(path: Path) -> str:
    return f"data:{TYPES[path.suffix]};base64," + base64.b64encode(path.read_bytes()).decode()


def _anchors(page: Page) -> dict[int, str]:
    """Anchor of each section by its `id`: the words of its title, numbered where they repeat."""

    def names() -> Iterator[tuple[PageSection, str]]:
        taken: dict[str, int] = {"source": 1}
        for section in page.all_sections():
            words = re.sub(r"\W+", "-", section.title.lower()).strip("-") or "section"
            taken[words] = taken.get(words, 0) + 1
            yield section, words if taken[words] == 1 else f"{words}--{taken[words]}"

    return {id(section): anchor for section, anchor in names()}
