"""A reader of meshes is one of `Mesh.load`, the command line and the errors that list formats."""

import numpy as np
import pytest

import rastercov as rc


def text_of(mesh, unit="meter"):
    """The mesh as AMF."""
    points = "".join(
        f"<vertex><coordinates><x>{x}</x><y>{y}</y><z>{z}</z></coordinates></vertex>"
        for x, y, z in mesh.vertices.tolist()
    )
    rows = "".join(
        f"<triangle><v1>{a}</v1><v2>{b}</v2><v3>{c}</v3></triangle>"
        for a, b, c in mesh.faces.tolist()
    )
    return (
        f'<?xml version="1.0"?><amf unit="{unit}"><object id="1">'
        f"<mesh><vertices>{points}</vertices>"
        f"<volume><metadata type='name'>part</metadata>{rows}</volume></mesh></object></amf>"
    )


def check(command, folder):
    """Faces keep their order; damaged files are refused."""
    mesh, file = rc.shapes.by_name("torus"), folder / "part.amf"
    for unit, metres in (("meter", 1), ("inch", 0.0254)):
        file.write_text(text_of(mesh, unit))
        own = rc.Mesh.load(file)
        assert np.allclose(own.vertices[own.faces], metres * mesh.vertices[mesh.faces])
        assert [each.name for each in own.groups] == ["part"]
    assert "part.amf" in command(
        f"evaluate {file} -c khepra -p sphere:2 --pictures 0 -o amf --json"
    )
    for old, new in (("</amf>", ""), ("<v1>", "<v1>99999"), ("inch", "mile"), ("<x>", "<x>a")):
        file.write_text(text_of(mesh, "inch").replace(old, new, 1))
        with pytest.raises(rc.MeshError, match="expected"):
            rc.Mesh.load(file)
    with pytest.raises(rc.MeshError, match=r"\.amf"):
        rc.Mesh.load(folder / "part.abc")
