"""Cells of equal size: they divide the evaluated faces, and their shares are areas of regions."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from nightly import examples
from scenes import joined, square
from surface_cases import building, in_regions, room

import rastercov as rc
from rastercov.base.errors import ConfigError, ResourceError

pytestmark = pytest.mark.native

TASK = rc.Task(max_incidence_deg=70, min_pixels_per_m2=2000)


@pytest.mark.slow
@given(size=st.floats(0.05, 30))
@examples(8, at_night=25)
def test_cells_divide_their_faces_and_are_no_larger_than_asked(size):
    mesh, _, _ = room()
    cells = rc.cells(mesh, size)
    corners = cells.vertices[cells.faces]
    sides = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)
    assert sides.max() <= size * (1 + 1e-12)
    crossed = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert np.allclose(np.linalg.norm(crossed, axis=1) / 2, cells.area, rtol=1e-9)
    upright = np.einsum("ci,ci->c", crossed, mesh.normals[cells.source_face])
    assert (upright > 0).all()  # wound as their faces
    assert np.allclose(np.bincount(cells.source_face, cells.area), mesh.areas, rtol=1e-12)
    assert (np.diff(cells.source_face) >= 0).all()


@pytest.mark.slow
@pytest.mark.parametrize("scene", [room, building])
def test_shares_add_up_to_the_area_of_the_regions(scene):
    mesh, camera, poses = scene()
    regions = rc.regions(mesh, camera, poses, TASK)
    cells = rc.cells(mesh, 0.4)
    shares = cells.share(regions)
    assert shares.starts.tolist() == sorted(shares.starts.tolist())
    assert shares.starts[-1] == len(shares.cell) == len(shares.share)
    assert (shares.share > 0).all()
    assert (shares.share <= 1).all()
    for row in range(len(poses)):
        part = slice(shares.starts[row], shares.starts[row + 1])
        assert (np.diff(shares.cell[part]) > 0).all()
        area = shares.share[part] * cells.area[shares.cell[part]]
        by_face = np.bincount(cells.source_face[shares.cell[part]], area, mesh.n_faces)
        assert np.abs(by_face - regions.areas()[row]).max() <= 1e-9 * mesh.areas.max()


def test_a_cell_in_a_region_is_whole_and_one_outside_has_no_share():
    mesh, camera, poses = room()
    regions = rc.regions(mesh, camera, poses[:1], TASK)
    cells = rc.cells(mesh, 0.3)
    shares = cells.share(regions)
    share = np.zeros(len(cells))
    share[shares.cell] = shares.share
    centres = cells.vertices[cells.faces].mean(axis=1)
    inside = in_regions(regions, 0, centres, cells.source_face.astype(int))
    assert inside[share > 1 - 1e-12].all()
    assert not inside[share == 0].any()
    assert (share > 1 - 1e-12).sum() > 0.5 * inside.sum()


def test_occluders_have_no_cells():
    mesh = joined(square(0.25, 1), square(0.5, 2))
    groups = [rc.Group("plate", is_occluder=True), rc.Group("wall")]
    mesh = rc.Mesh(mesh.vertices, mesh.faces, groups, [0, 0, 1, 1])
    assert set(rc.cells(mesh, 0.2).source_face.tolist()) == {2, 3}


@pytest.mark.slow
def test_too_small_cells_are_refused_with_a_size_that_fits(monkeypatch):
    mesh, _, _ = room()
    monkeypatch.setattr("rastercov.core.area.cells.MOST_CELLS", 50_000)
    with pytest.raises(ResourceError, match=r"at most 50,000 patches, .* use 0\.\d+ m") as caught:
        rc.cells(mesh, 1e-5)
    fits = float(str(caught.value).split("; use ")[1].split(" m")[0])
    assert len(rc.cells(mesh, fits * 1.05)) <= 50_000
    with pytest.raises(ResourceError, match="; use "):
        rc.cells(mesh, 1e-300)
    for size in (0, -1, float("nan"), "small"):
        with pytest.raises(ConfigError, match="expected size above 0 m"):
            rc.cells(mesh, size)
