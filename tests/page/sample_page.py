"""Pages that the tests show."""

import base64
from pathlib import Path

from jinja2 import ChoiceLoader, FileSystemLoader

from rattle.compare.report import render
from rattle.compare.report.report import Report
from rattle.compare.report.table import Table, TableCell, of_numbers

render.LOADER = ChoiceLoader([render.LOADER, FileSystemLoader(Path(__file__).parent)])

RECORD = {"commit": "abc", "command": "rattle", "wall_seconds": 1.0, "versions": {}}


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
    """A page with everything that a template can show, and the text wherever a scene or file name
    can put one."""
    speeds = {
        "saltation": "≥ 480",
        "published": "9",
        "corrected": "–",
        "branching": "1,000",
        "other": -2,
    }
    rows = [*speeds.items(), (text, "-1.5e2"), *((f"row {i}", 9) for i in range(6))]
    cells = [TableCell(f"{i / 7:+.3f} ± 0.012", ("good", "bad", "open")[i % 3]) for i in range(14)]
    heads = [of_numbers(f"E y{i}") for i in range(14)]
    impacts = [[str(k), *cells, "why it ends, at some length: " + text] for k in (1, 2)]
    content = {
        "text": text,
        "speeds": Table.of(["closure", of_numbers("speed-up")], rows),
        "wide": Table.of(["impact", *heads, text], impacts),
    }
    return Report(
        "report",
        f"Is {text} right?",
        (f"Yes: {text}.", "It holds up to σ = 0.1."),
        RECORD | {"repeat": f"rattle validate {text}"},
        content,
        (("σ", "noise intensity"), ("other", f"means {text}")),
        template="sample.j2",
        more={"file": text},
    )


def figures(folder):
    """The figures of the sample, in a folder."""
    (folder / "figures").mkdir(parents=True)
    (folder / "figures" / "a.svg").write_text(SVG)
    (folder / "b.png").write_bytes(base64.b64decode(PNG))
    return folder
