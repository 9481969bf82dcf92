"""Mesh files of every format: no face is lost or moved silently, nothing else is opened."""

import hashlib
import os
import re
import socket
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mesh_files import (
    FACES,
    POINTS,
    VALID,
    WRITERS,
    Glb,
    glb_bytes,
    obj,
    ply,
    refusal,
    triangles,
)
from nightly import examples
from repeated_parts import dae, threemf

from rastercov.base.errors import MeshError, RastercovError, ResourceError
from rastercov.core.mesh import Group, Mesh
from rastercov.formats.meshes import READERS

every_format = pytest.mark.parametrize("name", VALID)


# ---- valid files


@every_format
def test_every_format_keeps_faces_corners_and_order(name, load, tmp_path):
    mesh = load(name, VALID[name])
    np.testing.assert_array_equal(triangles(mesh), POINTS[FACES])
    np.testing.assert_array_equal(mesh.source_face, np.arange(4))
    assert mesh.n_vertices == 4
    assert mesh.can_cull_back_faces
    assert mesh.warnings == ()
    (source,) = mesh.sources
    assert (source.name, source.n_faces) == (name, 4)
    assert source.sha256 == hashlib.sha256(VALID[name]).hexdigest()
    assert str(tmp_path) not in repr(mesh.sources)


# ---- units and scenes


UNITS = {"m": 1, "mm": 1e-3, "cm": 1e-2, "um": 1e-6, "µm": 1e-6, "in": 0.0254, "inch": 0.0254}
UNITS |= {"ft": 0.3048, 2.5: 2.5, 1: 1}


@pytest.mark.parametrize("name", ["a.obj", "a.glb"])
def test_unit_scales(name, load):
    for unit, metres in UNITS.items():
        vertices = load(name, VALID[name], unit=unit).vertices
        np.testing.assert_array_equal(vertices, POINTS * metres, err_msg=str(unit))


def test_several_files_are_one_scene_in_order(tmp_path):
    paths = [tmp_path / name for name in ("a.stl", "b.obj", "c.glb")]
    for path, name in zip(paths, ("binary.stl", "a.obj", "a.glb"), strict=True):
        path.write_bytes(VALID[name])
    apart = {"b": {"scale": 2.0}, "c.*": {"scale": 4.0}}
    mesh = Mesh.load(paths, transforms=apart, occluders=["b/thing"], two_sided="all")
    assert mesh.groups == (
        Group("a", is_two_sided=True),
        Group("thing", is_occluder=True, is_two_sided=True),
        Group("part", is_two_sided=True),
    )
    np.testing.assert_array_equal(mesh.face_group, np.repeat([0, 1, 2], 4))
    in_order = np.concatenate([POINTS[FACES] * scale for scale in (1, 2, 4)])
    np.testing.assert_array_equal(triangles(mesh), in_order)
    assert [source.name for source in mesh.sources] == ["a.stl", "b.obj", "c.glb"]
    np.testing.assert_array_equal(mesh.source_face, np.tile(np.arange(4), 3))


@pytest.mark.parametrize("path", [[], 3, [None], [b"a.stl"], "missing.stl", "zero\0byte.stl"])
def test_what_is_no_path_is_refused(path):
    with pytest.raises((MeshError, TypeError), match=r"path|iterable"):
        Mesh.load(path)


def test_unknown_unit_lists_the_known_ones(load):
    for unit in ("yard", "M", "", 0, -1.0, float("nan"), float("inf"), True, None):
        with pytest.raises(
            MeshError, match="expected unit to be one of m, mm, cm, um, in, inch, ft"
        ):
            load("a.obj", VALID["a.obj"], unit=unit)
    with pytest.raises(MeshError, match="within ±1e\\+30"):
        load("a.obj", obj(POINTS * 1e20, FACES), unit=1e300)


@pytest.mark.parametrize("name", ["binary.stl", "a.off", "ascii.ply", "little.ply", "a.glb"])
def test_content_after_the_end_loads_with_a_warning_that_names_the_file(name, load):
    mesh = load(name, VALID[name] + b"\n1 2 3\n")
    assert mesh.n_faces == 4
    assert mesh.warnings == mesh.notes
    assert re.search(rf"{name}: .*ignored (7 bytes|the lines) after", *mesh.notes)


# ---- nothing in it


NOTHING = [
    *((name, b"") for name in VALID),
    ("a.stl", WRITERS["binary.stl"](POINTS, [])),
    ("a.stl", b"solid x\nendsolid x\n"),
    ("a.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\n"),
    ("a.off", b"OFF\n3 0 0\n0 0 0\n1 0 0\n0 1 0\n"),
    ("a.ply", ply(POINTS, [])),
    ("a.ply", ply(POINTS, [], "<")),
    ("a.ply", b"ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nend_header\n0\n"),
    *(("a.glb", data) for data in (glb_bytes({}), Glb(POINTS, []).data(), Glb(mode=1).data())),
]


def test_file_without_faces_has_no_triangles(load):
    for name, data in NOTHING:
        assert "expected" in refusal(load, name, data), (name, data)


# ---- coordinates and indices that are none


def spoilt(name: str, bad: float) -> bytes:
    """Four faces, of which 1 and 3 use a bad vertex."""
    faces = FACES.copy()
    faces[1, 0] = faces[3, 1] = 4
    return WRITERS[name](np.vstack([POINTS, [0, bad, 0]]), faces)


@every_format
def test_unusable_coordinates_are_refused_with_their_faces(name, load):
    for bad in (np.nan, np.inf, 1e38):
        with pytest.raises(
            MeshError, match=rf"{name}: expected finite .* faces \[1, 3\], 2 in all"
        ):
            load(name, spoilt(name, bad))


@every_format
def test_drop_invalid_keeps_the_rest_and_where_it_came_from(name, load):
    mesh = load(name, spoilt(name, np.nan), drop_invalid=True)
    np.testing.assert_array_equal(mesh.source_face, [0, 2])
    np.testing.assert_array_equal(triangles(mesh), POINTS[FACES[[0, 2]]])
    assert "dropped faces [1, 3], 2 in all" in mesh.warnings[0]
    assert mesh.sources[0].n_faces == 2


@pytest.mark.parametrize("name", ["a.off", "ascii.ply", "little.ply", "big.ply", "a.glb"])
def test_indices_out_of_range_and_truncated_files_are_refused(name, load):
    faces = FACES.copy()
    faces[2, 1] = 4
    assert "vertex indices in 0 ... 3, got 0 ... 4" in refusal(
        load, name, WRITERS[name](POINTS, faces)
    )
    for cut in (20, 60, 110):
        assert re.search("truncated|expected", refusal(load, name, VALID[name][:-cut])), cut


# ---- group names


def test_group_names_are_printable_and_short(load):
    name = b"a\x1b[31m\x07" + "\u202eé\ud7ff".encode() + b"\xff" + b"b" * 400
    mesh = load("a.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\ng " + name + b"\nf 1 2 3\n")
    (group,) = mesh.groups
    assert group.name.isprintable()
    assert group.name.startswith("a[31mé")
    assert len(group.name) == 200

    long = "n" * 300
    text = f"v 0 0 0\nv 1 0 0\nv 0 1 0\ng {long}a\nf 1 2 3\ng {long}b\nf 1 2 3\n"
    names = [group.name for group in load("a.obj", text.encode()).groups]
    assert names == ["n" * 200, "n" * 197 + " #2"]


# ---- what must never be opened


@pytest.fixture
def opened(monkeypatch):
    """Names of the files that were opened since, and no network."""
    names: list[str] = []
    watch = True

    def hook(event: str, arguments: tuple) -> None:
        if watch and event == "open" and isinstance(arguments[0], (str, os.PathLike)):
            names.append(Path(arguments[0]).name)

    def refuse(*arguments: object, **options: object) -> None:
        raise AssertionError("the network was asked")

    monkeypatch.setattr(socket, "socket", refuse)
    monkeypatch.setattr(socket, "getaddrinfo", refuse)
    sys.addaudithook(hook)
    yield names
    watch = False  # an audit hook cannot be removed


@pytest.mark.parametrize(
    "uri", ["secret.bin", "../secret.bin", "/etc/passwd", "file:///etc/passwd"]
)
def test_external_buffers_are_refused_and_never_opened(uri, load, opened, tmp_path):
    (tmp_path / "secret.bin").write_bytes(bytes(1000))
    del opened[:]
    with pytest.raises(MeshError, match=r"expected buffers in the file, got one outside \(u"):
        load("a.glb", Glb().put(("buffers", 0, "uri"), uri))
    assert set(opened) == {"a.glb"}


def test_images_and_material_libraries_are_never_opened(load, opened, tmp_path):
    for name in ("secret.mtl", "secret.png"):
        (tmp_path / name).write_text("secret")
    del opened[:]
    load("a.glb", Glb().put(["images"], [{"uri": "secret.png"}]))
    load("a.obj", b"mtllib secret.mtl\nmtllib ../../../etc/passwd\n" + VALID["a.obj"])
    assert set(opened) == {"a.glb", "a.obj"}


URLS = ("http://example.org/a.stl", "https://a.org/a.glb", "file:///a.stl", "s3://b/a.ply")
NAMES = ("a.zip", "a.fbx", "a.blend", "a.xml", "a.stl.gz", "a", ".stl", "a.npy")


def test_urls_and_other_formats_are_refused_without_opening_anything(load, opened, tmp_path):
    for url in (*URLS, *map(Path, URLS)):
        with pytest.raises(MeshError, match="got a URL; download it first"):
            Mesh.load(url)
    for name in NAMES:
        (tmp_path / name).touch()
        del opened[:]
        with pytest.raises(
            MeshError, match=re.escape(f"expected a mesh file of {', '.join(READERS)}, got")
        ):
            Mesh.load(tmp_path / name)
        assert not opened


def test_file_is_read_once_and_hashed_as_read(load, opened):
    mesh = load("a.stl", VALID["binary.stl"])
    assert opened == ["a.stl", "a.stl"], "one by the test that writes, one by the loader"
    assert mesh.sources[0].sha256 == hashlib.sha256(VALID["binary.stl"]).hexdigest()


# ---- memory


@pytest.mark.parametrize("name", [name for name in VALID if name != "ascii.stl"])
def test_budget_is_held_against_an_estimate(name, load):
    assert load(name, VALID[name], memory_budget=4 * 300).n_faces == 4
    with pytest.raises(ResourceError, match=rf"{name}: .*, got 1200 bytes for 4 triangles"):
        load(name, VALID[name], memory_budget=1199)


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name in VALID if name not in ("binary.stl", "big.ply")])
def test_vertices_count_against_the_budget(name, load):
    """Vertices that no face uses; in an STL there are none, so faces count there."""
    rng = np.random.default_rng(0)
    points = np.vstack([POINTS, rng.normal(size=(8000, 3))])
    faces = FACES if name != "ascii.stl" else rng.integers(0, 9, (3600, 3))
    data = WRITERS[name](points, faces)
    assert load(name, data, memory_budget=1_600_000).n_faces == len(faces)
    with pytest.raises(ResourceError, match=r"got \d+ bytes for"):
        load(name, data, memory_budget=800_000)


# ---- laws


TMP_PATH_IS_SHARED = [HealthCheck.function_scoped_fixture]  # each example writes it anew


def promised(name: str, content: bytes, unknown: int) -> int:
    """Polygons that a file claims to have, found without the loader, where that is clear."""
    first = [line.split()[:1] for line in content.split(b"\n")]
    if name == "ascii.stl":
        return first.count([b"endfacet"])
    if name == "a.obj" and b"\\" not in content and b"#" not in content[9:]:
        return first.count([b"f"])
    if name == "binary.stl":
        return int.from_bytes(content[80:84], "little")
    count = re.search(rb"\nelement face (\d+)\n|^OFF # comment\n4 (\d) 0\n", content)
    return int(count[1] or count[2]) if count else unknown


DAMAGED = VALID | {"a.dae": dae(), "a.3mf": threemf(), "a.gltf": Glb().json()}


@pytest.mark.slow
@pytest.mark.parametrize("name", DAMAGED)
@settings(examples(8, at_night=200), suppress_health_check=TMP_PATH_IS_SHARED)
@given(data=st.data())
def test_corrupt_files_load_whole_or_raise_mesh_error(name, data, load):
    """Whole as far as the file says: a text without counts may say less after it was damaged."""
    content = bytearray(DAMAGED[name])
    for _ in range(data.draw(st.integers(1, 4))):
        at = data.draw(st.integers(0, len(content)))
        piece = data.draw(st.binary(min_size=1, max_size=8))
        kind = data.draw(st.sampled_from(["change", "delete", "insert", "cut"]))
        n_removed = {"insert": 0, "cut": len(content)}.get(kind, len(piece))
        content[at : at + n_removed] = piece if kind in ("change", "insert") else b""
    error = ""
    try:
        mesh = load(name, bytes(content))
    except RastercovError as refused:
        error = str(refused)
    if error:
        assert name in error
        assert error.isprintable()
        return
    polygons = np.unique(mesh.source_face)
    np.testing.assert_array_equal(polygons, np.arange(len(polygons)))
    assert len(polygons) == promised(name, bytes(content), len(polygons))
    assert mesh.n_faces == mesh.sources[0].n_faces
    assert isinstance(mesh.warnings, tuple)


@pytest.mark.slow
@every_format
@settings(max_examples=10, suppress_health_check=TMP_PATH_IS_SHARED)
@given(seed=st.integers(0, 2**32 - 1))
def test_random_meshes_come_back_face_for_face(name, seed, load):
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(rng.integers(3, 9), 3)).astype(np.float32).astype(float)
    faces = rng.integers(0, len(points), (rng.integers(1, 20), 3))
    mesh = load(name, WRITERS[name](points, faces))
    np.testing.assert_array_equal(triangles(mesh), points[faces])
    assert name.endswith(".stl") or mesh.n_vertices == len(points), "only STL merges vertices"


def test_each_file_has_its_own_unit(tmp_path):
    for name in ("a.obj", "b.obj"):
        (tmp_path / name).write_bytes(VALID["a.obj"])
    paths = [tmp_path / "a.obj", tmp_path / "b.obj"]
    mesh = Mesh.load(paths, ["mm", 2])
    assert [np.ptp(triangles(mesh)[rows]) for rows in (slice(4), slice(4, 8))] == [1e-3, 2]
    for unit in (["mm"], ["mm"] * 3, []):
        with pytest.raises(MeshError, match=f"one for each of 2 files, got {len(unit)}"):
            Mesh.load(paths, unit)
    with pytest.raises(MeshError, match="unit to be one of"):
        Mesh.load(paths, ["mm", "miles"])
    with pytest.raises(MeshError, match="unit to be one of"):
        Mesh.load(paths, b"mm")


@pytest.mark.parametrize("change", [-1, 1])
def test_file_that_changes_while_it_is_read_is_refused(change, tmp_path, monkeypatch):
    path = tmp_path / "a.stl"
    path.write_bytes(VALID["binary.stl"])
    before = path.stat()
    grown = os.stat_result([*before[:6], before.st_size + change, *before[7:]])
    monkeypatch.setattr(Path, "stat", lambda *a, **k: grown)
    with pytest.raises(MeshError, match="the file changed while it was read"):
        Mesh.load(path)


def test_a_file_that_is_moved_may_be_there_again(tmp_path):
    (tmp_path / "a.stl").write_bytes(VALID["binary.stl"])
    places = [{"translation": (row, 0, 0)} for row in range(3)]
    mesh = Mesh.load([tmp_path / "a.stl"] * 3, transforms=places)
    assert [group.name for group in mesh.groups] == ["a", "a #2", "a #3"]
