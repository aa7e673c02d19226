"""The terms of a page's glossary where they stand in its texts: each shows its meaning on hover, focus and tap."""

import re
from collections.abc import Iterable

from markupsafe import Markup, escape

from rattle.compare.report.content import Glossary

WORD = Markup('<abbr title="{}" tabindex="{}">{}</abbr>')
HINT = Markup('<abbr title="{}">{}</abbr>')


class Terms:
    """Marks the terms of glossaries in the texts of one page.

    Only the first mark of a term on the page is in the order of the Tab key; a tap opens each.

    `glossaries`: Of the page; a term "x1, x2" explains both words, and one between backticks is a term in code,
    heads and cells alone.

    Examples
    --------
    >>> terms = Terms([Glossary("Words", (("τ", "time"), ("E, sd", "mean and spread")))])
    >>> print(terms.text("sds of τ", False))
    <abbr title="E, sd: mean and spread" tabindex="0">sds</abbr> of <abbr title="τ: time" tabindex="0">τ</abbr>
    >>> print(terms.head("E τ", Markup("E τ")))
    <abbr title="E, sd: mean and spread; τ: time">E τ</abbr>
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
        """Mark each term where it stands first in a piece of text.

        `code`: Whether it is code, which is marked if it is a term as a whole.
        """
        if code:
            return self._mark(piece, self._code[piece]) if piece in self._code else escape(piece)
        marked, end, seen = Markup(""), 0, set()
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
