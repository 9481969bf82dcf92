"""Loading of mesh files from bytes."""

import pytest

from rastercov.mesh import Mesh


@pytest.fixture
def load(tmp_path):
    """Write bytes under a name and load them."""

    def write_and_load(name, data, **options):
        path = tmp_path / name
        path.write_bytes(data)
        return Mesh.load(path, **options)

    return write_and_load
