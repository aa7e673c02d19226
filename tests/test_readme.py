"""The README's example prints what the README says."""

import re
import subprocess
import sys
from pathlib import Path

README = Path(__file__).resolve().parent.parent / "README.md"


def test_the_worked_example_prints_what_it_says():
    code, printed = re.search(r"```python\n(.*?)```.*?```\n(.*?)```", README.read_text(), re.DOTALL).groups()
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert out.split() == printed.split()


def test_the_orbit_with_rests_prints_what_it_says():
    section = README.read_text().split("## Numerical stability")[1]
    code, printed = re.search(r"```python\n(.*?)```.*?```\n(.*?)```", section, re.DOTALL).groups()
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert out.split() == printed.split()


def test_pictures_and_links_exist():
    for link in re.findall(r"\]\(([^)#]+)\)", README.read_text()):
        assert (README.parent / link).exists(), link


def test_the_study_in_it_can_be_computed():
    from compare.study import Study

    study = Study.from_toml(re.search(r"```toml\n(\[study\].*?)```", README.read_text(), re.DOTALL).group(1))
    assert len(study.points) == 48
    assert all(p.sample for p in study.points)
