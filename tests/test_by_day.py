"""By day tests with many slow cases run a third of them, and all others run whole."""

from types import SimpleNamespace

import by_day
from hypothesis import given, settings
from hypothesis import strategies as st


def item(name, is_slow=True):
    parts = {"callspec": None} if "[" in name else {}
    return SimpleNamespace(
        nodeid=name, get_closest_marker=lambda mark: is_slow and mark == "slow", **parts
    )


@settings(max_examples=25)
@given(st.sets(st.text(max_size=4), min_size=2), st.text(max_size=3))
def test_a_third_is_two_or_more_and_depends_on_names_and_seed_alone(names, seed):
    kept = by_day.a_third(sorted(names), seed)
    assert kept <= names
    assert len(kept) == max(2, -(-len(names) // 3))
    assert kept == by_day.a_third(sorted(names, reverse=True), seed)


def test_each_case_runs_for_some_seed():
    names = [f"t[{n}]" for n in range(9)]
    assert set().union(*(by_day.a_third(names, str(seed)) for seed in range(60))) == set(names)


def test_only_cases_of_tests_with_many_slow_ones_are_left_out():
    many, few = [f"a[{n}]" for n in range(9)], [f"b[{n}]" for n in range(3)]
    quick = [item(f"c[{n}]", is_slow=False) for n in range(9)]
    items = [*quick, *map(item, [*many, "d", *few])]
    kept, left_out = by_day.split(items)
    assert kept + left_out != items
    assert sorted(each.nodeid for each in kept + left_out) == sorted(each.nodeid for each in items)
    assert {each.nodeid for each in left_out} < set(many)
    assert len(left_out) == 6
    assert [each for each in items if each in kept] == kept


def test_where_a_run_decides_the_cases_are_the_same():
    run = {"PYTEST_XDIST_TESTRUNUID": "7"}
    assert by_day.seed_of(run) == "7"
    assert by_day.seed_of(run | {"CI": "true"}) == by_day.seed_of({"CI": "1"}) == ""
