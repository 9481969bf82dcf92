"""A camera with a filter sees the light of lamps within it only, as in fluorescence."""

from dataclasses import replace

import numpy as np
import pytest

import rastercov as rc


def check(command, folder):
    """A side of a box each for two lamps of two bands; none for a filter that passes neither."""
    mesh, camera = rc.shapes.box((0.2, 0.2, 0.2)), rc.Camera.from_fov(640, 480, hfov_deg=60)
    poses = rc.look_at([(0.6, 0, 0), (0, 0, 0.6)], (0, 0, 0))
    places = np.repeat(np.eye(4)[None], 2, axis=0)
    places[0, :3, 3], places[1, :3, 3] = (2, 0, 0), (0, 0, 2)
    bands = (450, 550), (600, 700)
    lamp = rc.Lamp.point(intensity=100)
    lamps = rc.Lamps([replace(lamp, band_nm=band) for band in bands], places=places)

    def covered(passes, lamps=lamps):
        own = replace(camera, filter_nm=passes)
        return rc.evaluate(mesh, own, poses, lamps=lamps).covered.area[0].reshape(6, 2).sum(axis=1)

    both = covered(None)
    one, other = covered((400, 560)), covered((590, 800))
    np.testing.assert_allclose(one + other, both)
    assert [np.count_nonzero(each) for each in (both, one, other)] == [2, 1, 1]
    with pytest.raises(rc.ConfigError, match="filter_nm"):
        covered((100, 200))
    path = folder / "dye.toml"
    path.write_text("[lamps.dye]\nintensity_cd = 100\nband_nm = [450, 550]\nposition = [2, 0, 0]\n")
    np.testing.assert_allclose(covered((400, 560), path), one)
    assert "filter_nm" in command("place --schema")
