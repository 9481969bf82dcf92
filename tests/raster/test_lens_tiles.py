"""Tiles that a face may cover, against all tiles: none with a sample of it is left out."""

from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from lens_cameras import CAMERAS

from rastercov import Camera, CameraError
from rastercov.kernels import raster_lens_listing as kernels
from rastercov.kernels.jit import allocation_free
from rastercov.kernels.raster_lens_cover import count_covered
from rastercov.kernels.raster_lens_records import SAMPLES, Samples, make_workspace
from rastercov.kernels.raster_memory import LANES
from rastercov.kernels.simd_kernel import pointer, pointers
from rastercov.mesh import shapes
from rastercov.raster.cpu import CPURasterizer
from rastercov.raster.cpu.clusters import group_faces
from rastercov.raster.cpu.lens_rasterizer import LensRasterizer, _image
from rastercov.raster.cpu.lens_samples import SampleTables

NEAR = 1e-3
LENSES = ("brown", "wide fisheye", "equirectangular")


@cache
def patches_of(lens):
    return SampleTables(CAMERAS[lens].resized(0.05), 1, 0.2).band(0, 1)


@allocation_free
def covered_samples(mesh, eye, axes, patch, work, image, counts):
    """Samples of each face in (F, 3): in the tiles that are listed, and in all; and 1 for those
    that are listed by their chords."""
    kernels.set_view(patch, eye, axes, NEAR, work.pose)
    samples, planes = pointers(Samples(patch.centres, patch.x, patch.y)), pointer(work.setup.planes)
    for cluster in range(mesh.n):
        kernels.prepare_cluster(mesh, cluster, patch, work)
        for at in range(0, kernels.slots_of(mesh, cluster), LANES):
            wanted, _, edge_on, with_chords = kernels.prepare_faces(
                mesh, cluster, at, 0, NEAR, patch, work
            )
            for k in range(LANES):
                slot = at + k
                f = mesh.faces[mesh.face_starts[cluster] + slot]
                if mesh.corners[mesh.face_starts[cluster] + slot] == 0 or edge_on >> k & 1:
                    continue
                e = kernels.planes_of(work.setup, slot)
                for tile in range(patch.x.shape[0]):
                    counts[f, 1] += count_covered(e, tile, samples, planes)
                if wanted >> k & 1:
                    counts[f, 2] = with_chords >> k & 1
                    nothing = np.int64(0), np.int64(0), np.int64(0)
                    _, n_tiles, n_whole = kernels.list_face(
                        work.setup, slot, True, with_chords >> k & 1, np.float32(np.inf), patch,
                        image, work.listed, nothing,
                    )  # fmt: skip
                    for n in range(n_tiles):
                        counts[f, 0] += count_covered(e, work.listed.tiles[n], samples, planes)
                    for n in range(n_whole):
                        for s in range(SAMPLES):
                            counts[f, 0] += (
                                patch.x[work.listed.whole[n], s]
                                == (patch.x[work.listed.whole[n], s])
                            )


def counted(corners, patch):
    """`covered_samples` of faces (F, 3, 3) in axes of the plane of a patch."""
    n = len(corners)
    faces = np.arange(3 * n, dtype=np.int32).reshape(n, 3)
    mesh = group_faces(np.ascontiguousarray(corners.reshape(-1, 3)), faces, False)
    counts = np.zeros((n, 3), np.int64)
    work = make_workspace(mesh.stride, len(patch.x))
    image = _image(len(patch.x), patch.columns)
    image.bound[:] = -1.0
    covered_samples(mesh, np.zeros(3), np.eye(3), patch, work, image, counts)
    return counts


@pytest.mark.slow
@pytest.mark.parametrize("lens", LENSES)
@settings(max_examples=25)
@given(seed=st.integers(0, 2**32 - 1), size=st.floats(0.003, 3.0))
def test_every_sample_of_a_face_is_in_a_tile_of_it(lens, seed, size):
    rng = np.random.default_rng(seed)
    middle = rng.uniform((-3, -3, -1), (3, 3, 3), (40, 1, 3))
    corners = middle + rng.normal(0, size, (40, 3, 3))
    if rng.random() < 0.3:
        corners = np.round(corners, 1)  # edges through samples, and faces edge-on
    n_samples = 0
    for patch in patches_of(lens):
        counts = counted(corners, patch)
        np.testing.assert_array_equal(counts[:, 0], counts[:, 1])
        n_samples += int(np.isfinite(patch.x).sum())
    assert n_samples > 2000


@pytest.mark.slow
@pytest.mark.parametrize("lens", ["brown", "wide fisheye"])
def test_every_sample_of_a_face_is_within_its_chords(lens):
    """Faces of a few samples, which reach their tiles through the lens."""
    rng = np.random.default_rng(7)
    patch = patches_of(lens)[0]
    n = 4000
    middle = rng.uniform((-1.2, -1.2, 1), (1.2, 1.2, 1), (n, 1, 3))
    corners = middle + rng.normal(0, 1, (n, 3, 3)) * 10 ** rng.uniform(-2.5, -0.8, (n, 1, 1))
    counts = counted(corners, patch)
    np.testing.assert_array_equal(counts[:, 0], counts[:, 1])
    assert (counts[:, 2] & (counts[:, 1] > 0)).sum() > 300


@pytest.mark.slow
@pytest.mark.parametrize("lens", LENSES)
def test_boxes_hold_the_samples_of_their_tiles(lens):
    for patch in patches_of(lens):
        n = len(patch.x)
        assert patch.boxes.shape[1] >= n + SAMPLES
        low_x, high_x, low_y, high_y = patch.boxes[:, :n].astype(np.float64)
        x = patch.centres[:, :1] + patch.x
        y = patch.centres[:, 1:] + patch.y
        is_live = np.isfinite(patch.x)
        assert (low_x[:, None] < x)[is_live].all()
        assert (high_x[:, None] > x)[is_live].all()
        assert (low_y[:, None] < y)[is_live].all()
        assert (high_y[:, None] > y)[is_live].all()
        is_empty = ~is_live.any(axis=1)
        assert (low_x[is_empty] == np.inf).all()
        assert (high_x[is_empty] == -np.inf).all()
        assert (x[is_live] >= patch.low[0]).all()
        assert (y[is_live] <= patch.high[1]).all()


@pytest.mark.slow
def test_counts_do_not_depend_on_the_size_of_tables(monkeypatch):
    mesh = shapes.torus(20, 30)
    pose = np.eye(4)
    pose[2, 3] = -3.0
    camera = Camera(width=101, height=77, fx=80, fy=80, model="fov", distortion=(0.7,))
    with LensRasterizer(mesh, camera, supersample=2) as rasterizer:
        whole = rasterizer.count(pose)
        rasterizer._tables = SampleTables(camera, 2, 0.0, max_table=4000)
        assert rasterizer._tables.n_bands > 5
        banded = rasterizer.count(pose)
    np.testing.assert_array_equal(whole.visible, banded.visible)
    np.testing.assert_array_equal(whole.drawn, banded.drawn)
    assert whole.background == banded.background


def test_the_rasteriser_of_pinholes_says_what_draws_other_lenses():
    with pytest.raises(CameraError, match=r"draws pinholes only, got a lens of model opencv; take"):
        CPURasterizer(shapes.box((1, 1, 1)), CAMERAS["brown"])
