"""The names of `rastercov.placement`."""

import pytest
from processes import python

from rastercov import placement


def test_all_is_sorted_and_every_name_is_there():
    assert placement.__all__ == sorted(set(placement.__all__))
    assert all(hasattr(placement, name) for name in placement.__all__)


@pytest.mark.slow
def test_importing_placement_loads_no_file_format_and_no_solver():
    slow = "{'pyarrow', 'highspy', 'pydantic', 'typer', 'rich', 'moderngl'}"
    result = python("-c", f"import sys, rastercov.placement; print({slow} & set(sys.modules))")
    assert result.stdout.strip() == "set()"
