"""Attack by symbolic links that archives and clones carry: under every name that a command uses.

To a folder with all of these names, to a file, and to nothing; nothing outside may be touched, and
the command is done as ever, or refuses in one line. The commands: tests/support/planted_links.py.
"""

import sys
import tempfile
from itertools import product
from pathlib import Path

import numpy as np
import planted_links
from rows import Report


def attack(report: Report, effort: float) -> None:
    """All of it; `effort` 1 is the whole campaign."""
    rng, wrong, n_names, n_links = np.random.default_rng(0), 0, 0, 0
    with tempfile.TemporaryDirectory() as name:
        base = Path(name)
        for line in planted_links.COMMANDS:
            names = planted_links.names_of(line, base / "seen")
            n_names += len(names)
            every = list(product(names, planted_links.KINDS))
            for row in rng.permutation(len(every))[: max(1, round(effort * len(every)))]:
                place, kind = every[row]
                n_links += 1
                fault = planted_links.fault_of(line, names, place, kind, base / "links")
                if fault:
                    print(f"{line}: a link to a {kind} at {place}: {fault}", file=sys.stderr)
                    wrong += 1
    report.add("commands that write", len(planted_links.COMMANDS), "commands")
    report.add("names that they use", n_names, "names", must=100)
    report.add("links planted", n_links, "links")
    report.add("of these followed, or without a clear line", wrong, "links", at_most=0)
    report.check("no command follows a link that a person has not named", not wrong)
