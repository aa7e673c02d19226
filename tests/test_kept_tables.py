"""What the pages show of the measurements is what the kept measurements say."""

from places import RESULTS
from programs import python

READ_KEPT = f"""
import sys
sys.path.insert(0, {str(RESULTS)!r})
from kept_tables import kept
for file, text in kept().items():
    if file.read_text(encoding="utf-8") != text:
        print(file.name)
    print(file.name + " read")
"""


def test_the_markdown_of_every_measurement_is_that_of_its_csv():
    """In a process of its own, for the scripts are no modules of the tests."""
    said = python("-c", READ_KEPT).stdout
    files = sorted(file.name for file in RESULTS.glob("*.table.md"))
    assert len(files) == 17
    assert said.splitlines() == [f"{name} read" for name in files]
