"""Tables that a benchmark writes between two marks of a page of the documentation."""

import sys
from pathlib import Path


def marks(program: str) -> tuple[str, str]:
    """Comments before and after the tables of a program."""
    return f"<!-- made by {program} -->", "<!-- made until here -->"


def write(page: Path, program: str, block: str) -> None:
    """Put a block between the marks of a program."""
    begin, end = marks(program)
    before, result, rest = page.read_text(encoding="utf-8").partition(begin)
    _, closed, after = rest.partition(end)
    if not (result and closed):
        sys.exit(f"{page} must have the lines {begin} and {end}; add them where the tables belong")
    page.write_text(f"{before}{begin}\n{block}\n{end}{after}", encoding="utf-8")


def earlier(page: Path | None, start: str) -> list[str]:
    """Lines of a page that start so, which a run of other parts keeps."""
    lines = page.read_text(encoding="utf-8").splitlines() if page else []
    return [line for line in lines if line.startswith(start)]
