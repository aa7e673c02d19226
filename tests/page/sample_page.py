"""Pages that the tests show."""

import base64

from rattle.compare.report import (
    Code,
    Figure,
    Glossary,
    Page,
    PageSection,
    Source,
    Table,
    TableCell,
    Text,
    numbers,
)

NASTY = (
    "</style><script>alert(1)</script> `x` | *y* _z_ [a](b) ![c](d) &lt; $e$\n# f\r\n| g |\x1b[2J"
    " \u202e"
)
SVG = (
    '<svg xmlns="http://www.w3.org/2000/svg" width="640" height="200"><circle cx="320" cy="100"'
    ' r="90"/></svg>'
)


PNG = (  # a white pixel
    "iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAAAAAA6fptVAAAACklEQVR4nGP4DwABAQEAsTj2FAAAAABJRU5ErkJggg=="
)


def sample(text="a plain text"):
    """A page with one block of every kind, and the text wherever a scene or file name can put
    one."""
    speeds = {
        "saltation": "≥ 480",
        "published": "9",
        "corrected": "–",
        "branching": "1,000",
        "other": -2,
    }
    rows = [*speeds.items(), (text, "-1.5e2"), *((f"row {i}", 9) for i in range(6))]
    table = Table.of(["closure", *numbers("speed-up")], rows)
    cells = [TableCell(f"{i / 7:+.3f} ± 0.012", ("good", "bad", "open")[i % 3]) for i in range(14)]
    heads = numbers(*(f"E y{i}" for i in range(14)))
    impacts = [[str(k), *cells, "why it ends, at some length: " + text] for k in (1, 2)]
    wide = Table.of(["impact", *heads, text], impacts)
    section = PageSection(
        f"First {text}",
        (
            Text(f"Before {text}", note=True),
            table,
            Figure("figures/a.svg", f"Under {text}", f"Shows {text}"),
        ),
        (
            PageSection("Inner", (Table.of(wide.columns, wide.rows, f"Folded {text}"),)),
            PageSection(f"First {text}"),
        ),
    )
    source = Source(
        f"rattle validate {text}",
        (("commit", "abc"), ("file", text)),
        (Code(f"x = '{text}'\n", "toml"),),
    )
    words = Glossary(f"Words of {text}", (("σ", "noise intensity"), ("other", f"means {text}")))
    opening = (Figure("b.png", "A point.", "One point"), Code("```\na\n```"), words)
    return Page(
        f"Is {text} right?",
        (f"Yes: {text}.", "It holds up to σ = 0.1."),
        source,
        opening,
        (section,),
    )


def figures(folder):
    """The figures of the sample, in a folder."""
    (folder / "figures").mkdir(parents=True)
    (folder / "figures" / "a.svg").write_text(SVG)
    (folder / "b.png").write_bytes(base64.b64decode(PNG))
    return folder
