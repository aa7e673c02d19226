"""Pages that the tests show."""

import struct
import zlib

from rattle.compare.report import (
    NUMBER,
    Code,
    Column,
    Figure,
    Glossary,
    Page,
    PageSection,
    Source,
    Table,
    TableCell,
    Text,
)

NASTY = "</style><script>alert(1)</script> `x` | *y* _z_ [a](b) ![c](d) &lt; $e$\n# f\r\n| g |\x1b[2J \u202e"
SVG = '<svg xmlns="http://www.w3.org/2000/svg" width="640" height="200"><circle cx="320" cy="100" r="90"/></svg>'


def png():
    """A picture of one white pixel."""

    def chunk(name, data):
        return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))

    head = struct.pack(">2I5B", 1, 1, 8, 0, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(b"\0\xff")) + chunk(b"IEND", b"")


def sample(text="a plain text"):
    """A page with one block of every kind, and the text wherever a scene or file name can put one."""
    speeds = [
        ("saltation", "≥ 480"),
        ("published", "9"),
        ("corrected", "–"),
        ("branching", "1,000"),
        ("other", -2),
        (text, "-1.5e2"),
    ]
    table = Table.of(["closure", Column("speed-up", NUMBER)], [*speeds, *((f"row {i}", 9) for i in range(6))])
    cells = [TableCell(f"{i / 7:+.3f} ± 0.012", ("good", "bad", "open")[i % 3]) for i in range(14)]
    heads = [Column(f"E y{i}", NUMBER) for i in range(14)]
    wide = Table.of(
        ["impact", *heads, text], [[str(k), *cells, "why it ends, at some length: " + text] for k in (1, 2)]
    )
    section = PageSection(
        f"First {text}",
        (Text(f"Before {text}", note=True), table, Figure("figures/a.svg", f"Under {text}", f"Shows {text}")),
        (PageSection("Inner", (Table.of(wide.columns, wide.rows, f"Folded {text}"),)), PageSection(f"First {text}")),
    )
    source = Source(f"rattle validate {text}", (("commit", "abc"), ("file", text)), (Code(f"x = '{text}'\n", "toml"),))
    words = Glossary(f"Words of {text}", (("σ", "noise intensity"), ("other", f"means {text}")))
    opening = (Figure("b.png", "A point.", "One point"), Code("```\na\n```"), words)
    return Page(f"Is {text} right?", (f"Yes: {text}.", "It holds up to σ = 0.1."), source, opening, (section,))


def figures(folder):
    """The figures of the sample, in a folder."""
    (folder / "figures").mkdir(parents=True)
    (folder / "figures" / "a.svg").write_text(SVG)
    (folder / "b.png").write_bytes(png())
    return folder
