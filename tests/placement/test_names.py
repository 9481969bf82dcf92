"""The names of `rastercov.placement`, and the module paths of earlier releases."""

import importlib
import subprocess
import sys
import warnings

import pytest

from rastercov import placement
from rastercov._moved import MOVED

WARNED = """
import importlib, sys, warnings
import rastercov.placement as placement
before = dict(vars(placement))
for old, new in {moved}.items():
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        first, second = importlib.import_module(old), importlib.import_module(old)
    assert first is second is importlib.import_module(new), old
    said = [str(each.message) for each in caught if each.category is DeprecationWarning]
    own = [text for text in said if text.startswith(old + " is now " + new + ";")]
    assert len(own) == 1, (old, said)
assert all(vars(placement)[name] is before[name] for name in placement.__all__)
from rastercov.placement.select_greedy import select_greedy
assert select_greedy is placement.select_greedy
"""


def run(code):
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)


def test_all_is_sorted_and_every_name_is_there():
    assert placement.__all__ == sorted(set(placement.__all__))
    assert all(hasattr(placement, name) for name in placement.__all__)


def test_a_star_import_gives_all_names():
    names = {}
    exec("from rastercov.placement import *", names)
    assert set(placement.__all__) <= set(names)


@pytest.mark.slow
def test_importing_placement_loads_no_file_format_and_no_solver():
    slow = "{'pyarrow', 'highspy', 'pymoo', 'pydantic', 'typer', 'rich', 'moderngl'}"
    found = run(f"import sys, rastercov.placement; print({slow} & set(sys.modules))")
    assert found.stdout.strip() == "set()"


@pytest.mark.slow
def test_each_old_path_gives_the_module_that_moved_and_warns_once():
    run(WARNED.format(moved=MOVED))


def test_an_old_path_is_refused_where_warnings_are_errors():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with pytest.raises(DeprecationWarning, match=r"rastercov\.placement\.select\.problem"):
            importlib.import_module("rastercov.placement.problem")
