"""A page in its views: as one self-contained HTML file, as Markdown, and as data; every text in it
is escaped."""

import base64
import hashlib
import re
from collections.abc import Callable, Collection, Iterable, Mapping
from functools import partial
from importlib.resources import files
from pathlib import Path
from typing import Any, TypeAlias

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup, escape

from rattle.compare.report import MARKS, NUMBER, Block, Glossary, Page, parts
from rattle.compare.report.json_text import KINDS, NAME, page_text
from rattle.scene import harmless, line

Words: TypeAlias = Callable[[str, bool], Markup]


def as_html(
    text: str, files: Collection[str] = (), words: Words = lambda piece, _: escape(piece)
) -> Markup:
    """A text as HTML: what stands between backticks as ``<code>``, and as a link if it is one of
    the files.

    `words`: Makes a piece of the text HTML, and is told whether it is code.
    """

    def render(piece: str, code: bool) -> Markup:
        if not code:
            return words(piece, False)
        if piece in files:
            return Markup('<a href="{0}"><code>{0}</code></a>').format(piece)
        return Markup("<code>{}</code>").format(words(piece, True))

    return Markup("").join(render(piece, code) for piece, code in parts(line(text)))


def as_markdown(text: str, cell: bool = False, files: Collection[str] = ()) -> str:
    r"""A text as Markdown that shows it literally."""
    written = "".join(
        (f"[`{piece}`]({piece})" if piece in files else f"`{piece}`") if code else _escape(piece)
        for piece, code in parts(line(text))
    )
    if cell:
        return written.replace("|", r"\|")
    # no heading, no list
    return re.sub(r"^(\d+)([.)])", r"\1\\\2", re.sub(r"^([#>+=-])", r"\\\1", written))


def _escape(text: str) -> str:
    text = re.sub(r"([\\`*\[\]<&~$])", r"\\\1", text)
    return re.sub(r"(?<!\w)_|_(?!\w)", r"\\_", text)  # within a word it is no emphasis


def as_code(text: str) -> str:
    """A text as inline code in Markdown, with as many backticks around it as its own require."""
    text, ticks = line(text), "`" * (1 + _longest_run(text))
    return f"{ticks} {text} {ticks}" if "`" in text else f"`{text}`"


def _longest_run(text: str) -> int:
    return max((len(run) for run in re.findall("`+", text)), default=0)


def fence(text: str) -> str:
    """The fence around a block of code in Markdown: one backtick more than the longest run in it,
    at least three."""
    return "`" * max(3, 1 + _longest_run(text))


WORD = Markup('<abbr title="{}" tabindex="{}">{}</abbr>')
HINT = Markup('<abbr title="{}">{}</abbr>')


class Terms:
    """Marks the terms of a page's glossaries in its texts; only the first mark of each is in the
    order of the Tab key.

    A term "x1, x2" explains both words, and one between backticks is a term in code, heads and
    cells alone.
    """

    def __init__(self, glossaries: Iterable[Glossary]) -> None:
        self._meanings: dict[str, str] = {}
        self._code: dict[str, str] = {}
        self._reached: set[str] = set()
        for term, meaning in (entry for glossary in glossaries for entry in glossary.terms):
            kind = self._code if term.startswith("`") else self._meanings
            bare = term.strip("`")
            kind.update(dict.fromkeys(bare.split(", "), f"{bare}: {meaning}"))
        longest_first = sorted(map(re.escape, self._meanings), key=len, reverse=True)
        self._pattern = re.compile(rf"(?<![\w-])({'|'.join(longest_first) or '(?!)'})(s?)(?![\w-])")

    def text(self, piece: str, code: bool) -> Markup:
        """Mark each term where it stands first in a piece of text; code is marked if it is a term
        as a whole."""
        if code:
            return self._mark(piece, self._code[piece]) if piece in self._code else escape(piece)
        marked = Markup("")
        end = 0
        seen = set()
        for match in self._pattern.finditer(piece):
            said = self._meanings[match[1]]
            if said not in seen:
                marked += escape(piece[end : match.start()]) + self._mark(match[0], said)
                end = match.end()
                seen.add(said)
        return marked + escape(piece[end:])

    def _mark(self, word: str, said: str) -> Markup:
        order = -1 if said in self._reached else 0
        self._reached.add(said)
        return WORD.format(said, order, word)

    def head(self, text: str, shown: Markup) -> Markup:
        """Mark the head of a column with the meanings of all terms in it."""
        found = [self._meanings[match[1]] for match in self._pattern.finditer(text)]
        found += [said for word, said in self._code.items() if word == text]
        return HINT.format("; ".join(dict.fromkeys(found)), shown) if found else shown

    def cell(self, text: str, shown: Markup) -> Markup:
        """Mark the cell of a table if it is a term."""
        said = self._code.get(text) or self._meanings.get(text)
        return shown if said is None else WORD.format(said, -1, shown)


def make_environment(package: str, escaped: bool) -> Environment:
    """Jinja's environment for the templates of a package; all texts in it are without control
    characters."""
    return Environment(
        loader=PackageLoader(package),
        autoescape=escaped,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=StrictUndefined,
        finalize=lambda value: harmless(value) if type(value) is str else value,
    )


def render_html(package: str, name: str, filters: Mapping[str, Any], /, **values: Any) -> str:
    """Render a package's template ``NAME.html.j2`` with ``NAME.css`` and ``NAME.js``, and no other
    style or script."""
    templates = files(package).joinpath("templates")
    style, script = (
        templates.joinpath(f"{name}.{kind}").read_text(encoding="utf-8") for kind in ("css", "js")
    )
    allowed = (
        f"'sha256-{_base64(hashlib.sha256(text.encode()).digest())}'" for text in (style, script)
    )
    policy = (
        "default-src 'none'; img-src data:; style-src {}; script-src {}; base-uri 'none';"
        " form-action 'none'"
    )
    environment = make_environment(package, True)
    environment.filters |= filters
    template = environment.get_template(f"{name}.html.j2")
    return template.render(
        policy=policy.format(*allowed), style=Markup(style), script=Markup(script), **values
    )


def _base64(data: bytes) -> str:
    return base64.b64encode(data).decode()


PACKAGE = "rattle.compare.report"  # of the templates
TYPES = {".svg": "image/svg+xml", ".png": "image/png"}
DATA = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]*\.(csv|parquet|toml)")
"""Names of the files beside a page to which it links."""
LONG = 40
"""Folded tables with more rows are not printed: paper cannot sort them, and the table files hold
them."""


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
    return sorted(
        path.name for path in folder.iterdir() if path.is_file() and DATA.fullmatch(path.name)
    )


def markdown(page: Page, files: Collection[str] = ()) -> str:
    """A page as Markdown; the figures are linked, and the files beside it."""
    environment = make_environment(PACKAGE, False)
    environment.filters |= {
        "md": partial(as_markdown, files=files),
        "code": as_code,
        "fence": fence,
        "line": line,
    }
    text = environment.get_template("page.md.j2").render(
        page=page, kind=_kind, NUMBER=NUMBER, files=files
    )
    return re.sub(r"\n{3,}", "\n\n", text).rstrip() + "\n"


def html(page: Page, folder: Path) -> str:
    """A page as one HTML file that needs no other; figures are embedded, and table files in the
    folder are linked."""
    blocks = [*page.blocks, *(block for section in page.all_sections() for block in section.blocks)]
    anchors = _anchors(page)
    files = data_files(folder)
    terms = Terms(b for b in blocks if isinstance(b, Glossary))
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
    shown: dict[str, Any] = {
        "page": page,
        "kind": _kind,
        "NUMBER": NUMBER,
        "MARKS": MARKS,
        "files": files,
    }
    return render_html(PACKAGE, "page", filters, **shown, LONG=LONG)


def _kind(block: Block) -> str:
    return KINDS[type(block)]


def _data_address(path: Path) -> str:
    return f"data:{TYPES[path.suffix]};base64,{_base64(path.read_bytes())}"


def _anchors(page: Page) -> dict[int, str]:
    """Anchor of each section by its `id`: the words of its title, numbered where they repeat."""
    anchors: dict[int, str] = {}
    taken = {"source": 1}
    for section in page.all_sections():
        words = re.sub(r"\W+", "-", section.title.lower()).strip("-") or "section"
        taken[words] = taken.get(words, 0) + 1
        anchors[id(section)] = words if taken[words] == 1 else f"{words}--{taken[words]}"
    return anchors
