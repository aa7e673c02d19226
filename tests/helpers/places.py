"""Where the files lie that tests read."""

from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
EXAMPLES = ROOT / "examples"
RESULTS = ROOT / "docs" / "results"
ORDINARY_PAIR = ROOT / "tests" / "compare" / "cli" / "pair.toml"
"""An engineer's gear pair, whose teeth stick and chatter."""
BUILT = {"_build", "auto_gallery", "generated"}
"""Folders of the documentation that are made."""
