"""Report pages: their content as data, and its rendering as HTML, as Markdown and on a terminal."""

from rattle.compare.report.content import (
    NUMBER,
    TEXT,
    Block,
    Cell,
    Code,
    Column,
    Figure,
    Glossary,
    Page,
    Row,
    Section,
    Source,
    Table,
    Text,
    numbers,
)
from rattle.compare.report.page_file import read_page
from rattle.compare.report.render import pages, write_page

__all__ = [
    "NUMBER",
    "TEXT",
    "Block",
    "Cell",
    "Code",
    "Column",
    "Figure",
    "Glossary",
    "Page",
    "Row",
    "Section",
    "Source",
    "Table",
    "Text",
    "numbers",
    "pages",
    "read_page",
    "write_page",
]
