"""Peers of benchmarks/throughput.py: their counts agree with ours up to ties at edges."""

import sys
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

import rastercov as rc
from rastercov.core.mesh import shapes

BENCHMARKS = Path(__file__).parents[1] / "benchmarks"
# No side is a multiple of a packet's 4 pixels, and fx, fy and the centre all differ.
CAMERA = rc.Camera(width=131, height=102, fx=120, fy=125, cx=60, cy=53)
N_POSES = 6


@pytest.fixture
def modules(monkeypatch):
    """benchmarks/embree_packets.py and same_faces.py."""
    if find_spec("embreex") is None:
        pytest.skip("embreex is missing: pip install 'rastercov[bench]'")
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    for name in ("embree_packets", "same_faces"):
        monkeypatch.delitem(sys.modules, name, raising=False)
    import embree_packets
    import same_faces

    if embree_packets.library() is None:
        pytest.skip("this wheel of embreex has no library of Embree inside")
    return embree_packets, same_faces


@pytest.mark.slow
def test_packets_of_embree_count_our_faces(modules):
    packets, same = modules
    torus = shapes.torus(20, 10)
    # Far from the origin, where float32 coordinates would be 1e-3 apart.
    mesh = rc.Mesh(vertices=torus.vertices + 1e4, faces=torus.faces)
    poses = rc.sphere_of_poses(mesh.bounds.mean(axis=0), 4.2, N_POSES)
    peer = packets.EmbreePackets(mesh, CAMERA, poses, threads=2)
    with rc.open_rasterizer(mesh, CAMERA, backend="cpu") as ours:
        counted = ours.count(poses, drawn=False).visible
        for row, pose in enumerate(poses):
            image = peer.faces(row)
            differing, wrong = same.wrong_pixels(mesh, CAMERA, pose, image, ours.render(pose).face)
            assert wrong == 0
            counts = peer.counts(row)
            assert counts.sum() > 1000
            assert np.array_equal(counts, np.bincount(image[image >= 0], minlength=mesh.n_faces))
            assert np.abs(counts - counted[row]).sum() <= 2 * differing
