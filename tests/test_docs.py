"""The documentation: its commands and programs run and say what it says; the site is whole."""

import re
import shlex
from pathlib import Path

import pytest
from processes import python

import rastercov as rc
from rastercov.cli import COMMANDS

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
PAGES = ["start", "faq", *(f"tutorials/{path.stem}" for path in DOCS.glob("tutorials/*.md"))]


def blocks(page, language):
    text = (DOCS / f"{page}.md").read_text(encoding="utf-8")
    found = re.findall(r"^```(\w*)\n(.*?)^```$", text, re.DOTALL | re.MULTILINE)
    return "".join(block for its, block in found if its == language)


@pytest.mark.slow
@pytest.mark.parametrize("page", PAGES)
def test_a_page_does_what_it_says(page, tmp_path):
    """Commands without files of the reader, and programs; what is printed there is printed here."""
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    said = ""
    for line in blocks(page, "sh").replace(".venv/bin/", "").splitlines():
        program, *words = shlex.split(line, comments=True)
        if program in ("rastercov", "python") and "part.stl" not in words:
            module = ["-m", "rastercov"] if program == "rastercov" else []
            done = python(*module, *words, cwd=tmp_path)
            assert done.returncode == 0, done.stderr
            said += done.stdout
    if programs := blocks(page, "python"):
        done = python("-W", "error", "-c", programs, cwd=tmp_path)
        assert done.returncode == 0, done.stderr
    assert [line for line in blocks(page, "").splitlines() if line not in said] == []


@pytest.mark.slow
def test_the_site_is_whole_and_asks_nothing_of_the_network(tmp_path):
    done = python(
        "-m", "sphinx", "-q", "-W", "--keep-going", "-d", tmp_path / "d", DOCS, tmp_path / "site"
    )
    assert (done.returncode, done.stderr) == (0, "")
    site = tmp_path / "site"
    pages = [f"api/rastercov.{name}" for name in rc.__all__] + [
        f"commands/{name}" for name in COMMANDS
    ]
    assert {page for page in pages if not (site / "reference" / f"{page}.html").exists()} == set()
    asked = r'<(?:script|img|link|iframe|source)[^>]*(?:src|href)="(?:https?:)?//[^"]*"'
    for path in site.rglob("*.html"):
        assert re.findall(asked, path.read_text(encoding="utf-8")) == [], path
