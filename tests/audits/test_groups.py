"""Figures of frames and cameras in an audit, against their definitions."""

import json
from itertools import combinations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from nightly import examples
from test_audit import CAMERAS, MESH, looking_in, pairs_of

import rastercov as rc
from rastercov.placement.audit import audit, groups_of


@examples(5, at_night=10)
@given(
    seed=st.integers(0, 10_000),
    views=st.integers(1, 3),
    least=st.sampled_from([0, 25]),
    n_frames=st.integers(1, 5),
)
def test_every_figure_of_a_frame_is_its_definition(seed, views, least, n_frames):
    rng = np.random.default_rng(seed)
    poses, task = looking_in(seed, 10), rc.Task(views=views, min_angle_deg=least)
    frames = [f"t{number}" for number in rng.integers(0, n_frames, 10)]
    found = audit(MESH, CAMERAS, poses, task, by="face", frames=frames)
    covers, weights = pairs_of(found), np.where(MESH.task_mask, MESH.areas, 0)

    def covered(rows):
        return found.problem.covered_by(rows)[1] & (weights > 0)

    names = list(dict.fromkeys(frames))
    groups = found.frames
    assert list(groups.names) == names
    whole = covered(np.arange(10))
    for row, name in enumerate(names):
        own = np.array([frame == name for frame in frames])
        seen = covers[own].any(axis=0)
        assert groups.seen_m2[row] == pytest.approx(weights[seen].sum(), abs=1e-12)
        lost = whole & ~covered(np.flatnonzero(~own))
        assert groups.lost_m2[row] == pytest.approx(weights[lost].sum(), abs=1e-12)
        alone = seen & ~covers[~own].any(axis=0)
        assert groups.alone_m2[row] == pytest.approx(weights[alone].sum(), abs=1e-12)
    # Fewest frames, by trying all.
    enough = [
        len(chosen)
        for n in range(len(names) + 1)
        for chosen in combinations(names, n)
        if (covered(np.flatnonzero(np.isin(frames, chosen))) == whole).all()
    ]
    assert groups.subset.bound <= min(enough) <= len(groups.subset.chosen)
    chosen = np.isin(frames, [names[row] for row in groups.subset.chosen])
    np.testing.assert_array_equal(covered(np.flatnonzero(chosen)), whole)


def test_cameras_of_a_rig_have_figures_by_name():
    poses = looking_in(4, 8)
    rig = rc.Rig(CAMERAS, ["wide", "long"])
    found = audit(MESH, rig, poses, by="face")
    entries = found.summary()["by_camera"]
    assert [entry["camera"] for entry in entries] == ["wide", "long"]
    covers = pairs_of(found)
    for row, entry in enumerate(entries):
        own = poses.camera == row
        assert entry["poses"] == own.sum()
        seen = MESH.areas[covers[own].any(axis=0)].sum()
        assert entry["seen_m2"] == pytest.approx(seen)
    assert "frames" not in found.summary()
    assert "by_camera" not in audit(MESH, CAMERAS[0], poses.world_from_camera).summary()


@pytest.mark.slow
def test_a_report_has_frames(tmp_path):
    poses = looking_in(4, 8)
    rig = rc.Rig(CAMERAS, ["wide", "long"])
    frames = ("a", "a", "b", "b", "c", "c", "d", "d")
    views = rc.Views(rig=rig, poses=poses, images=tuple("01234567"), frames=frames)
    rc.audit(MESH, views, by="face", out=tmp_path / "out")
    summary = json.loads((tmp_path / "out" / "audit.json").read_text())
    assert [entry["frame"] for entry in summary["frames"]["per_frame"]] == ["a", "b", "c", "d"]
    assert set(summary["frames"]["subset"]["names"]) <= set(frames)
    text = (tmp_path / "out" / "audit.html").read_text()
    assert "of 4 frames" in text
    assert "wide" in text
    import pyarrow.parquet as pq

    table = pq.read_table(tmp_path / "out" / "cameras.parquet")
    assert table["frame"].to_pylist() == list(frames)


def test_no_poses_have_no_groups():
    found = audit(MESH, CAMERAS[0], np.zeros((0, 4, 4)), by="face")
    groups = groups_of(found.problem, found.covered, [])
    assert groups.names == ()
