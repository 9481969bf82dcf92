"""Names, values and calls of features that can be deleted: a module each, in `features`.

`NAMES` are public; `FIRST` methods that a program calls first; `OBJECTS` values of public classes;
`SHOWN` values whose text is one line; `COMPARED` arguments that are compared with names, `EARLY`
those of `test_misuse`; `FILES`, `CALLS`, `USUAL` and `UNTRIED` those of `misuse_calls`; `PAGES`
pages of docs/ whose first table is a file; `LINES` lines of commands with `OF_LINES`, their files;
`CROSSED` entries of equipment of random plans; `IN_WORDS` classes whose results are printed.
"""

from importlib import import_module
from pathlib import Path

FOLDER = Path(__file__).parent / "features"
TABLES = ("FILES", "CALLS", "USUAL", "UNTRIED", "EARLY", "PAGES", "LINES", "OF_LINES", "CROSSED")
MODULES = [import_module(f"features.{path.stem}") for path in sorted(FOLDER.glob("*.py"))]


def of_features(name):
    """Values of all features, by the name of one of their lists or tables."""
    own = [getattr(each, name) for each in MODULES if hasattr(each, name)]
    if name in TABLES:
        return {key: value for each in own for key, value in each.items()}
    return [value for each in own for value in each]
