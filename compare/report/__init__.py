"""Report pages: their content as data, and its rendering as HTML, as Markdown and on a terminal."""

from rattle.compare.report.content import (
    NUMBER,
    TEXT,
    Block,
    Code,
    Column,
    Figure,
    Glossary,
    Page,
    PageSection,
    Row,
    Source,
    Table,
    TableCell,
    Text,
    numbers,
)
from rattle.compare.report.page_file import read_page
from rattle.compare.report.render import pages, write_page

__all__ = [
    "NUMBER",
    "TEXT",
    "Block",
    "Code",
    "Column",
    "Figure",
    "Glossary",
    "Page",
    "PageSection",
    "Row",
    "Source",
    "Table",
    "TableCell",
    "Text",
    "numbers",
    "pages",
    "read_page",
    "write_page",
]
