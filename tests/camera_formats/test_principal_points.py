"""Principal points far from the middle: a line asks for the image size, but not of crops."""

from pathlib import Path

import numpy as np
import pytest
import yaml
from commands import call, write_part

import rastercov as rc

SIZES = ((640, 480), (1920, 1080), (2448, 2048), (1000, 1000), (480, 640))
FACTORS = (3.0, 2.0, 1.5, 4.0, 6.0, 2.5)


def opencv(size, centre, skew=0.0):
    numbers = [
        900.0,
        skew,
        float(centre[0] - 0.5),
        0.0,
        900.0,
        float(centre[1] - 0.5),
        0.0,
        0.0,
        1.0,
    ]
    return (
        f"%YAML:1.0\n---\nimage_width: {size[0]}\nimage_height: {size[1]}\n"
        "camera_matrix: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n"
        f"   data: {numbers}\ndistortion_coefficients: !!opencv-matrix\n"
        "   rows: 1\n   cols: 5\n   dt: d\n   data: [0., 0., 0., 0., 0.]\n"
    )


def doubts_of(path):
    return [note for note in rc.read_views(path).notes if "the principal point" in note]


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("seed", range(6))
def test_a_calibration_of_another_size_is_asked_for_by_that_size(tmp_path, size, seed):
    random, path = np.random.default_rng(seed), tmp_path / "k.yaml"
    factor = FACTORS[seed]
    other = np.round(np.multiply(size, factor)).astype(int)
    path.write_text(opencv(size, other / 2 * random.uniform(1.002, 1.02, 2)))
    (line,) = doubts_of(path)
    assert line.endswith(f"px: is it of {other[0]} x {other[1]}, or cropped?")
    assert factor == 2 or ("outside" in line) == (factor > 2)
    path.write_text(opencv(size, np.multiply(size, random.uniform(0.26, 0.74, 2))))
    assert not doubts_of(path)
    path.write_text(opencv(size, np.multiply(size, (0.5, random.choice((0.2, 0.8))))))
    assert "far from the middle of its image" in doubts_of(path)[0]
    path.write_text(opencv(size, np.multiply(size, (-0.1, 0.5))))
    assert doubts_of(path)[0].endswith("px: is it of another size?")


def test_a_crop_that_the_file_states_is_no_doubt(tmp_path):
    entries = {
        "image_width": 1920, "image_height": 1080, "distortion_model": "plumb_bob",
        "D": [0.0] * 5, "K": [900.0, 0, 960, 0, 900, 540, 0, 0, 1],
        "width": 1920, "height": 1080, "R": [1.0, 0, 0, 0, 1, 0, 0, 0, 1],
        "roi": {"x_offset": 0, "y_offset": 0, "width": 640, "height": 480, "do_rectify": False},
    }  # fmt: skip
    path = tmp_path / "info.yaml"
    del entries["image_width"], entries["image_height"]
    path.write_text(yaml.safe_dump(entries))
    views = rc.read_views(path)
    assert (views.cameras()[0].width, views.cameras()[0].cx) == (640, 960.5)
    assert not doubts_of(path)


def test_evaluate_and_check_ask(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    write_part("part.obj")
    Path("k.yaml").write_text(opencv((640, 480), (960, 720)))
    rc.write_poses("rig.json", rc.sphere_of_poses((0, 0, 0), 3.0, 3))
    Path("plan.toml").write_text('[[meshes]]\npath = "part.obj"\n[camera]\nfile = "k.yaml"\n')
    words = "(960, 720), is outside its image of 640 x 480 px: is it of 1920 x 1440, or cropped?"
    for line in (
        "evaluate part.obj -c k.yaml --pictures 0 -o r",
        "check plan.toml --min-coverage 0.1",
    ):
        _, _, err = call(capsys, f"{line} -p rig.json")
        assert err.count(words) == 1, err
