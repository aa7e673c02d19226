"""A page in its two formats: as one self-contained HTML file, and as Markdown.

The template of a page says what stands on it, in plain text, and is rendered once with the macros
of each format.  Whatever is put out is escaped for the format unless a macro or a filter made it:
between two backticks stands code, everything else is shown literally.
"""

import base64
import hashlib
import math
import re
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass, field
from functools import cache, partial
from importlib.resources import files
from pathlib import Path
from typing import Any, TypeAlias

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup, escape

from rattle.compare.report.folder import page_files
from rattle.compare.report.report import Report
from rattle.compare.report.table import Column, Table, of_numbers
from rattle.compare.report.texts import join_words, name_all, span, wheel_label
from rattle.scene import duration_text, harmless, line
from rattle.scene.text import number_text, percent
from rattle.scene.words import PAIR, Words

Mark: TypeAlias = Callable[[str, bool], Markup]
CODE = re.compile(r"`([^`\n]+)`")
BLOCK_MARKS = (
    (r"^([#>+=-])", r"\\\1"),
    (r"^(\d+)([.)])", r"\1\\\2"),
    (r" (#+)$", r" \\\1"),
)
"""What would make a line of Markdown a heading or a list, or end a heading, and its escapes."""


def split_code(text: str) -> list[tuple[str, bool]]:
    """Split a text at its backticks; whether each piece is code."""
    pieces = CODE.split(line(text))
    return [(piece, bool(i % 2)) for i, piece in enumerate(pieces) if piece]


def as_html(
    text: str, files: Collection[str] = (), words: Mark = lambda piece, _: escape(piece)
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

    return Markup("").join(render(piece, code) for piece, code in split_code(text))


def as_markdown(text: str, cell: bool = False, files: Collection[str] = ()) -> Markup:
    r"""A text as Markdown that shows it literally."""
    written = "".join(
        (f"[`{piece}`]({piece})" if piece in files else f"`{piece}`") if code else _escape(piece)
        for piece, code in split_code(text)
    )
    if cell:
        return Markup(written.replace("|", r"\|"))
    for pattern, escaped in BLOCK_MARKS:
        written = re.sub(pattern, escaped, written)
    return Markup(written)


def _escape(text: str) -> str:
    text = re.sub(r"([\\`*\[\]<&~$])", r"\\\1", text)
    return re.sub(r"(?<![^\W_])_|_(?![^\W_])", r"\\_", text)  # within a word it is no emphasis


def as_block(text: str, language: str) -> Markup:
    """A text as a block of code in Markdown, in a fence of one backtick more than the longest run
    in it, at least three."""
    longest = max((len(run) for run in re.findall("`+", text)), default=0)
    fence = "`" * max(3, 1 + longest)
    return Markup(f"{fence}{line(language)}\n{harmless(text).rstrip()}\n{fence}")


def as_address(path: str) -> Markup:
    """A path as the address of a link in Markdown."""
    return Markup(line(path).replace(" ", "%20").replace("(", "%28").replace(")", "%29"))


WORD = Markup('<abbr title="{}" tabindex="{}">{}</abbr>')
HINT = Markup('<abbr title="{}">{}</abbr>')


class Terms:
    """Marks the terms of a page's glossary in its texts; only the first mark of each is in the
    order of the Tab key.

    A term "x1, x2" explains both words, and one between backticks is a term in code, heads and
    cells alone.
    """

    def __init__(self, glossary: Iterable[tuple[str, str]]) -> None:
        self._meanings: dict[str, str] = {}
        self._code: dict[str, str] = {}
        self._reached: set[str] = set()
        for term, meaning in glossary:
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
            meaning = self._meanings[match[1]]
            if meaning not in seen:
                marked += escape(piece[end : match.start()]) + self._mark(match[0], meaning)
                end = match.end()
                seen.add(meaning)
        return marked + escape(piece[end:])

    def _mark(self, word: str, said: str) -> Markup:
        order = -1 if said in self._reached else 0
        self._reached.add(said)
        return WORD.format(said, order, word)

    def head(self, text: str, shown: Markup) -> Markup:
        """Mark the head of a column with the meanings of all terms in it."""
        meanings = [self._meanings[match[1]] for match in self._pattern.finditer(text)]
        meanings += [meaning for word, meaning in self._code.items() if word == text]
        return HINT.format("; ".join(dict.fromkeys(meanings)), shown) if meanings else shown

    def cell(self, text: str, shown: Markup) -> Markup:
        """Mark the cell of a table if it is a term."""
        meaning = self._code.get(text) or self._meanings.get(text)
        return shown if meaning is None else WORD.format(meaning, -1, shown)


@dataclass
class Heading:
    """The heading of a section, with those below it."""

    title: str
    level: int
    anchor: str
    inner: list["Heading"] = field(default_factory=list)


class Contents:
    """The sections of a page in their order."""

    def __init__(self) -> None:
        self.sections: list[Heading] = []
        self._begun = [self.sections]
        self._taken = {"source": 1}

    def begin(self, title: str) -> Heading:
        """Begin a section; its anchor are the words of its title, numbered where they repeat."""
        words = re.sub(r"\W+", "-", title.lower()).strip("-") or "section"
        number = self._taken.get(words, 0) + 1
        self._taken[words] = number
        anchor = words if number == 1 else f"{words}--{number}"
        section = Heading(title, 1 + len(self._begun), anchor)
        self._begun[-1].append(section)
        self._begun.append(section.inner)
        return section

    def end(self, content: str) -> bool:
        """End the section that was begun last; without content it is left out."""
        self._begun.pop()
        if not content:
            self._begun[-1].pop()
        return bool(content)


WORDS = (percent, number_text, duration_text, join_words, name_all, span, wheel_label)
"""Functions that every template of plain text may call, by their names."""
LOADER = PackageLoader("rattle.compare", ".")
"""Finds templates by their path within `rattle.compare`."""


def make_environment(finalize: Callable[[Any], Any]) -> Environment:
    """Jinja's environment, in which each value that is put out passes a function."""
    return Environment(
        loader=LOADER,
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=StrictUndefined,
        finalize=finalize,
    )


@cache
def _text_environment() -> Environment:
    """Jinja's environment for plain text, in which nothing is escaped."""
    environment = make_environment(str)
    environment.autoescape = False
    environment.filters |= {"form": format, "line": line}
    environment.globals |= {function.__name__: function for function in WORDS}
    environment.tests["finite"] = math.isfinite
    return environment


def render_text(template: str, **values: Any) -> str:
    """A template as plain text."""
    return _text_environment().get_template(template).render(values)


def render_sentences(template: str, words: Words = PAIR, **values: Any) -> list[str]:
    """The sentences of an answer in the words of its scene; in its template an empty line stands
    between two of them."""
    text = words.put_into(render_text(template, **values))
    return [line(sentence) for sentence in re.split(r"\n\s*\n", text) if sentence.strip()]


def render_lines(template: str, **values: Any) -> list[str]:
    """What a command prints, a line for each line of its template that is not empty."""
    return [row for row in render_text(template, **values).split("\n") if row.strip()]


def _unless_made(change: Callable[[str], Any]) -> Callable[[Any], Any]:
    """A function that changes every value, unless a macro or a filter has made it."""
    return lambda value: value if hasattr(value, "__html__") else change(str(value))


def embed_files(package: str, name: str) -> dict[str, Any]:
    """The files ``NAME.css`` and ``NAME.js`` of a package's templates, and the policy that allows
    no other style or script."""
    templates = files(package).joinpath("templates")
    style = templates.joinpath(f"{name}.css").read_text(encoding="utf-8")
    script = templates.joinpath(f"{name}.js").read_text(encoding="utf-8")
    style_hash = _base64(hashlib.sha256(style.encode()).digest())
    script_hash = _base64(hashlib.sha256(script.encode()).digest())
    policy = (
        f"default-src 'none'; img-src data:; style-src 'sha256-{style_hash}';"
        f" script-src 'sha256-{script_hash}'; base-uri 'none'; form-action 'none'"
    )
    return {"policy": policy, "style": Markup(style), "script": Markup(script)}


def render_animation(**values: Any) -> str:
    """Render an animation as one HTML file; all texts in it are without control characters."""
    package = "rattle.compare.animation"
    environment = make_environment(_unless_made(harmless))
    template = environment.get_template("animation/templates/animation.html.j2")
    return template.render(values | embed_files(package, "animation"))


def _base64(data: bytes) -> str:
    return base64.b64encode(data).decode()


TYPES = {".svg": "image/svg+xml", ".png": "image/png"}
DATA = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]*\.(csv|parquet|toml)")
"""Names of the files beside a page to which it links."""
LONGEST_PRINTED = 40
"""Folded tables with more rows are not printed: paper cannot sort them, and the table files hold
them."""


def write_page(report: Report, folder: Path) -> None:
    """Write the page of a report into its folder, in which the figures and tables are already."""
    for file, render in zip(page_files(report.name), (markdown, html), strict=True):
        (folder / file).write_text(render(report, folder), encoding="utf-8")


def data_files(folder: Path) -> list[str]:
    """Names of the table files and settings in a report's folder."""
    return sorted(
        path.name for path in folder.iterdir() if path.is_file() and DATA.fullmatch(path.name)
    )


def markdown(report: Report, folder: Path) -> str:
    """A page as Markdown; the figures are linked, and the files beside it."""
    linked = data_files(folder)
    filters = {
        "cell": lambda text: as_markdown(
            report.words_of_scene.put_into(text), files=linked, cell=True
        ),
        "line": line,
        "block": as_block,
        "address": as_address,
    }
    text = _render(report, folder, "md", partial(as_markdown, files=linked), filters)
    return re.sub(r"\n{3,}", "\n\n", text).rstrip() + "\n"


def html(report: Report, folder: Path) -> str:
    """A page as one HTML file that needs no other; figures are embedded, and table files in the
    folder are linked."""
    put = report.words_of_scene.put_into
    terms = Terms([(put(term), put(meaning)) for term, meaning in report.words])
    plain = partial(as_html, files=data_files(folder))
    filters = {
        "explained": lambda text: plain(put(text), words=terms.text),
        "head": lambda head: terms.head(head, plain(put(head))),
        "cell": lambda cell: terms.cell(cell.text, plain(put(cell.display))),
        "literal": lambda value: escape(line(value)),
        "block": lambda value: escape(harmless(value).rstrip()),
        "embed": lambda path: _data_address(folder / path),
    }
    values = embed_files("rattle.compare.report", "page") | {"LONG": LONGEST_PRINTED}
    return _render(report, folder, "html", plain, filters, **values)


def _render(
    report: Report,
    folder: Path,
    kind: str,
    write: Callable[[str], Markup],
    filters: Mapping[str, Any],
    **values: Any,
) -> str:
    """Render the template of a page with the macros of a format.

    `kind`: The format, ``md`` or ``html``. `write`: Makes a text one of the format.
    """
    environment = make_environment(
        _unless_made(lambda text: write(report.words_of_scene.put_into(text)))
    )
    environment.filters |= {**filters, "columns": Table.of_frame, "table_of": Table.whole}
    environment.tests["drawn"] = lambda path: (folder / path).is_file()
    shared = {"words": report.words, "contents": Contents(), "number": of_numbers, "text": Column}
    environment.globals |= {**shared, **values}
    macros = environment.get_template(f"report/templates/macros.{kind}.j2").module
    environment.globals |= {name: of for name, of in vars(macros).items() if name[0] != "_"}
    template = environment.get_template(report.template or f"{report.name}/page.j2")
    layout = f"report/templates/layout.{kind}.j2"
    return template.render(report.content, report=report, layout=layout, files=data_files(folder))


def _data_address(path: Path) -> str:
    return f"data:{TYPES[path.suffix]};base64,{_base64(path.read_bytes())}"
