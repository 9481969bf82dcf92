"""Files of the GLB writer, as the strict reader of meshes takes them."""

import json
import struct

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from rastercov.core.mesh import Mesh
from rastercov.formats.meshes.gltf_file import Y_UP, GlbBuffer

COORDINATES = st.floats(-1e3, 1e3, width=32)
NAMES = st.text(min_size=1, max_size=12).filter(
    lambda name: name.isprintable() and name == name.strip()
)


def file_of(points, name, junk):
    """A node turned up, with triangles of separate vertices; other bytes lie before and behind."""
    buffer = GlbBuffer()
    buffer.add_bytes(junk)
    primitive = {"attributes": {"POSITION": buffer.add(points)}}
    buffer.add_bytes(junk)
    return buffer.file(
        {
            "scene": 0,
            "scenes": [{"nodes": [0]}],
            "nodes": [{"name": name, "mesh": 0, "matrix": Y_UP.T.ravel().tolist()}],
            "meshes": [{"primitives": [primitive]}],
        }
    )


@given(
    st.integers(1, 5).flatmap(lambda n: arrays(np.float32, (3 * n, 3), elements=COORDINATES)),
    NAMES,
    st.binary(max_size=9),
)
def test_what_is_written_is_read_and_begins_at_multiples_of_four_bytes(
    tmp_path_factory, points, name, junk
):
    path, data = tmp_path_factory.mktemp("glb") / "a.glb", file_of(points, name, junk)
    path.write_bytes(data)
    mesh = Mesh.load(path)
    x, y, z = points.astype(np.float64).T
    np.testing.assert_array_equal(
        mesh.vertices[mesh.faces].reshape(-1, 3), np.stack((x, z, -y), axis=1)
    )
    assert [group.name for group in mesh.groups] == [name]
    assert mesh.notes == ()
    total, n_text = struct.unpack_from("<2I", data, 8)
    assert total == len(data)
    assert len(data) % 4 == n_text % 4 == 0
    header = json.loads(data[20 : 20 + n_text])
    assert all(view["byteOffset"] % 4 == 0 for view in header["bufferViews"])
