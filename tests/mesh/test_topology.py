"""The edge table against a dictionary of edges."""

from collections import defaultdict

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from rastercov.core.mesh.topology import edge_table


@given(
    faces=hnp.arrays(
        np.int64, st.tuples(st.integers(1, 30), st.just(3)), elements=st.integers(0, 6)
    ),
    n_vertices=st.sampled_from([7, 2**31 - 1]),  # keys sorted with their codes, and by themselves
    dtype=st.sampled_from([np.int32, np.int64]),
)
@settings(max_examples=25)
def test_the_table_has_every_edge_with_all_its_uses(faces, n_vertices, dtype):
    uses, forward = defaultdict(list), {}
    for f, face in enumerate(faces.tolist()):
        if len(set(face)) < 3:
            continue
        for corner in range(3):
            start, end = face[corner], face[(corner + 1) % 3]
            uses[min(start, end), max(start, end)].append(3 * f + corner)
            forward[3 * f + corner] = start < end
    table = edge_table(faces.astype(dtype), n_vertices)
    assert list(map(tuple, table.vertices.tolist())) == sorted(uses)
    assert table.n_uses.tolist() == [len(uses[edge]) for edge in sorted(uses)]
    assert table.first.tolist() == (np.cumsum(table.n_uses) - table.n_uses).tolist()
    values = np.split(table.uses.tolist(), table.first[1:])
    for edge, mine in zip(sorted(uses), values, strict=bool(uses)):
        assert sorted(mine) == uses[edge]
        assert (np.diff(np.asarray(mine) // 3) >= 0).all()
    assert table.is_forward.tolist() == [forward[use] for use in table.uses.tolist()]
    assert table.faces.tolist() == [use // 3 for use in table.uses.tolist()]
