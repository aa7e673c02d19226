"""Writes beside the versions in requirements.txt the hashes of their wheels for Linux on x86-64;
needs the network."""

import json
import re
import subprocess
import sys
import tempfile
from pathlib import Path

FILE = Path(__file__).resolve().parent.parent / "requirements.txt"
PYTHONS = ("3.11", "3.12", "3.13", "3.14")
PLATFORMS = (
    "linux_x86_64",
    "manylinux2014_x86_64",
    *(f"manylinux_2_{minor}_x86_64" for minor in range(5, 37)),
)


def normalised(name: str) -> str:
    """Spell the name of a package in the one way in which names are compared."""
    return re.sub(r"[-_.]+", "-", name).lower()


pins = re.findall(r"^[^\s#=]+==[^\s\\]+", FILE.read_text(), re.MULTILINE)
hashes: dict[str, set[str]] = {normalised(pin.split("==")[0]): set() for pin in pins}
for python in PYTHONS:
    with tempfile.TemporaryDirectory() as nowhere:
        chosen = [word for platform in PLATFORMS for word in ("--platform", platform)]
        done = subprocess.run(
            [
                sys.executable,
                "-m",
                "pip",
                "install",
                "--quiet",
                "--dry-run",
                "--ignore-installed",
                "--no-deps",
                "--only-binary=:all:",
                "--report=-",
                f"--target={nowhere}",
                f"--python-version={python}",
                *chosen,
                *pins,
            ],
            stdout=subprocess.PIPE,
            check=True,
        )
    for wheel in json.loads(done.stdout)["install"]:
        found = wheel["download_info"]["archive_info"]["hashes"]["sha256"]
        hashes[normalised(wheel["metadata"]["name"])].add(found)
lines = [
    " \\\n    ".join(
        [
            pin,
            *(f"--hash=sha256:{value}" for value in sorted(hashes[normalised(pin.split("==")[0])])),
        ]
    )
    for pin in pins
]
FILE.write_text("\n".join(lines) + "\n")
