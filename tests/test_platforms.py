"""Nothing that only Linux has is needed to measure, to report and to place on the CPU."""

import pytest
from processes import run_python


@pytest.mark.slow
@pytest.mark.parametrize("system", ["darwin", "win32"])
def test_it_works_without_what_another_system_lacks(tmp_path, system):
    done = run_python("-m", "on_another_system", system, tmp_path)
    assert "coverage" in done.stdout
    assert "bits of 12 faces" in done.stdout
    assert (tmp_path / "report" / "summary.json").exists()
    assert (tmp_path / "placed" / "plan.json").exists()
    assert not [*tmp_path.rglob(".rastercov-lock")]
