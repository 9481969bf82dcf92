"""Verdict at the top of a page: whether it may be signed, and under which conditions."""

from collections.abc import Sequence

from rastercov.base import first_of
from rastercov.placement.required import FAILS, HOLDS, UNDECIDED

Line = str | tuple[str, str | bool | None]
"""Text, or text and whether it passed, True, False or None, or its status."""
HELD = (True, HOLDS, "holds under errors")
"""Of a line that passed."""
OPENING = ("door", "glass", "glaz", "pane", "window")
"""Parts of names of groups that light passes, or that are opened."""
MOST_NAMED = 4


def mark_of(line: Line) -> tuple[str, str, str]:
    """Class of the sign of a line, the sign, both "" for text alone, and the text."""
    if isinstance(line, str):
        return "", "", line
    text, status = line
    if status in HELD:
        return "yes", "✓", text
    return ("no", "✗", text) if status in (False, FAILS) else ("soft", "–", text)


def sign_words(passed: bool | None, lines: Sequence[Line]) -> str:
    """Sentence that says whether a page may be signed, and what fails."""
    if passed is None:
        return "No goal was set: figures only, nothing to pass or fail."
    if passed:
        return "May be signed: all goals are met, under the conditions below."
    short = [
        f"{line[0].partition(':')[0]} {'is undecided' if line[1] == UNDECIDED else 'fails'}"
        for line in lines
        if not isinstance(line, str) and line[1] not in (*HELD, None)
    ]
    return f"Not to be signed: {', '.join(short) or 'not all goals are met'}."


def openings_in_words(names: Sequence[str]) -> str:
    """Words on groups that are glass or doors by their names, after a comma; "" for none."""
    own = [name for name in names if any(part in name.lower() for part in OPENING)]
    return f", glass and doors too: {first_of(own, MOST_NAMED)}" if own else ""
