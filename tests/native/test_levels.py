"""Every level gives the same bits, and those of numpy."""

import os
import platform
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from lens_cameras import CAMERAS
from processes import python, run_python

from rastercov import engine, shapes
from rastercov.core.camera.lenses import of_camera
from rastercov.core.camera.lenses.of_camera import LensModel, lens_of
from rastercov.core.mesh import contacts
from rastercov.placement.bits import CoveredBits
from rastercov.placement.candidates import segments

pytestmark = pytest.mark.native
FUSED = Path(__file__).parents[2] / ".ci" / "fused"
LEVELS = [level for level in engine.built_modules() if level in engine.runnable()]


@pytest.fixture(params=LEVELS)
def level(request):
    return engine.load(f"_{request.param}")


def test_no_operations_are_fused(level):
    a = 1.0 + 2.0**-30
    assert level.base_check.multiply_add(a, a, -(1.0 + 2.0**-29)) == 0.0  # fused: 2^-60


@pytest.mark.skipif(shutil.which("objdump") is None, reason="no objdump, of binutils")
def test_no_module_has_a_fused_instruction(tmp_path):
    """Compilers may fuse in spite of `-ffp-contract=off`: GCC 12 did, by vfmaddsub."""
    built = [str(engine._file(f"_{level}")) for level in engine.built_modules()]
    done = python(str(FUSED), *built)
    assert (done.stdout, done.returncode) == ("", 0)
    source = tmp_path / "fused.s"
    is_arm = platform.machine() == "aarch64"
    source.write_text(
        "fmadd d0, d1, d2, d3\n" if is_arm else "vfmaddsub213pd %ymm0, %ymm1, %ymm2\n"
    )
    subprocess.run(["as", source, "-o", tmp_path / "fused.o"], check=True)
    done = python(str(FUSED), str(tmp_path / "fused.o"))
    assert done.returncode == 1
    assert done.stdout.startswith("fused.o: fused ")


@given(seed=st.integers(0, 10**6))
def test_vectors_are_sixteen_numbers(seed):
    rng = np.random.default_rng(seed)
    a, b, c = rng.normal(size=(3, 16)) * 10.0 ** rng.integers(-3, 4, (3, 16))
    b[rng.random(16) < 0.3] = a[0]
    index = rng.integers(0, 16, 16).astype(np.int32)
    wanted = (a * b + c, np.floor(a), np.sqrt(np.abs(a)), np.minimum(a, b), np.maximum(a, b))
    for name in LEVELS:
        out, masks = np.empty((6, 16)), np.empty(3, np.int64)
        engine.load(f"_{name}").base_check.combine((a, b, c, index, False), out, masks)
        assert out.tobytes() == np.stack((*wanted, a[index])).tobytes()
        less = a.astype(np.float32) < b.astype(np.float32)
        assert masks.tolist() == [
            sum(1 << i for i in np.flatnonzero(n)) for n in (a < b, less, less)
        ]


def test_lenses_are_proved_alike_on_all_levels(monkeypatch):
    for name in ("rational and prism", "fisheye", "omni", "equirectangular"):
        camera = CAMERAS[name]
        known = lens_of(camera)
        rows = set()
        for each in LEVELS:
            monkeypatch.setattr(of_camera, "solver_lens", engine.load(f"_{each}").solver_lens)
            lens = LensModel(camera.width, camera.height, known.code, known.coefficients)
            rows.add(lens.row.tobytes())
        assert rows == {known.row.tobytes()}, name


def test_trees_are_equal_on_all_levels(monkeypatch):
    mesh, rng = shapes.teapot(5), np.random.default_rng(0)
    points, ways = rng.uniform(-1, 1, (2, 500, 3))
    ways /= np.linalg.norm(ways, axis=1)[:, None]
    answers = set()
    for name in LEVELS:
        monkeypatch.setattr(contacts, "mesh_tree", engine.load(f"_{name}").mesh_tree)
        tree = contacts.TriangleTree.over(mesh.vertices / 8, mesh.faces)
        hits = tree.first_hits(points, ways, np.full(500, 0.7), np.full(500, -1))
        items = (tree.order, tree.nodes, hits, *tree.nearest(points), tree.winding_numbers(points))
        answers.add(b"".join(part.tobytes() for part in items))
    assert len(answers) == 1


def test_contacts_and_segments_are_equal_on_all_levels(monkeypatch):
    mesh = shapes.torus(40, 30)
    other = mesh.vertices[:, [1, 2, 0]] + 0.05
    vertices = np.concatenate((mesh.vertices, other))
    faces = np.concatenate((mesh.faces, mesh.faces + mesh.n_vertices))
    answers = set()
    for name in LEVELS:
        monkeypatch.setattr(contacts, "solver_contacts", engine.load(f"_{name}").solver_contacts)
        monkeypatch.setattr(segments, "kernels", engine.load(f"_{name}").placement_segments)
        touching = contacts.touching_faces(vertices, faces, 1e-9)
        partners = contacts.contact_partners(vertices, faces, 1e-9, touching)
        items = (touching, *partners, segments.segment(shapes.teapot(5), 20, None).labels)
        answers.add(b"".join(part.tobytes() for part in items))
    assert touching.any()
    assert len(answers) == 1


@given(seed=st.integers(0, 10**6))
def test_sums_over_bits_and_pairs_are_equal_on_all_levels(seed):
    rng = np.random.default_rng(seed)
    covers = rng.random((9, 300)) < rng.choice((0.02, 0.5))
    bits = CoveredBits.from_dense(covers)
    words, every = bits.parts[0], np.arange(9)
    values = rng.integers(-(2**63), 2**63 - 1, (2, 320))
    limits, face = bits.pairs()
    prices = rng.random(300)
    answers = set()
    for name in LEVELS:
        module = engine.load(f"_{name}")
        of_bits, prices_of = module.placement_bits, module.placement_lagrange
        sums = np.zeros((9, 2), np.int64)
        of_bits.sums(words, every, np.stack([words[0], words[1]]), values, sums)
        earned, cover = np.empty(9), np.empty(300)
        prices_of.earn(limits, face, prices, earned)
        prices_of.take(limits, face, earned, cover)
        items = (sums, earned, cover)
        answers.add(b"".join(each.tobytes() for each in items))
    masks = covers[:2, :]
    wanted = [(covers * mask) @ value[:300] for mask, value in zip(masks, values, strict=True)]
    np.testing.assert_array_equal(sums, np.transpose(wanted))
    np.testing.assert_allclose(earned, covers @ prices)
    np.testing.assert_allclose(cover, earned @ covers)
    assert len(answers) == 1


def test_figures_by_area_and_uncertainties_are_equal_on_all_levels():
    script = Path(__file__).parents[1] / "support" / "area_bits.py"
    answers = {}
    for name in LEVELS:
        *lines, level = run_python(script, RASTERCOV_LEVEL=name).stdout.splitlines()
        answers[level] = lines
    assert answers.keys() == set(LEVELS)
    first, *others = answers.values()
    assert len(first) == 10
    assert all(other == first for other in others)


@pytest.mark.parametrize("name", LEVELS)
def test_the_environment_chooses_a_level(name):
    script = "from rastercov import engine; print(engine.LEVEL)"
    assert python("-c", script, env=os.environ | {"RASTERCOV_LEVEL": name}).stdout.split() == [name]


def test_a_level_that_is_not_here_is_refused():
    done = python("-c", "import rastercov.engine", env=os.environ | {"RASTERCOV_LEVEL": "v9"})
    *_, line = done.stderr.strip().split("\n")
    assert line.startswith("ImportError: expected RASTERCOV_LEVEL to be one of ")
    assert line.endswith(" got v9")


def test_modules_that_are_missing_are_named(tmp_path):
    done = python(
        "-c", "import rastercov.engine", env=os.environ | {"RASTERCOV_MODULES": str(tmp_path)}
    )
    assert "make native" in done.stderr.strip().split("\n")[-1]
