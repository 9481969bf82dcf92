"""Light of several lamps by the sets of those that are seen."""

import numpy as np
import pytest
from surface_cases import in_regions, room

import rastercov as rc
from rastercov.reference.regions import points_on


def test_light_of_lamps_adds_up_where_they_are_seen():
    mesh = room()[0]
    lamps = np.array([(2.5, 4.2, 2.9), (6.9, 1.2, 2.6), (1.0, 1.0, 1.0)])
    eye = rc.Camera(
        width=2048, height=1024, fx=1024 / np.pi, fy=1024 / np.pi, model="equirectangular"
    )
    lit = rc.regions(mesh, eye, rc.look_at(eyes=lamps, targets=lamps + np.array([0.13, 0.4, -1.0])))
    part = lit.by_devices().where(rc.Illuminance(lamps, limit=6, intensities=50))
    total, n = mesh.areas.sum(), 20_000
    assert 100 * part.area.sum() / total == pytest.approx(46.92795, abs=0.004)
    points, face = points_on(mesh, n)
    away = lamps - points[:, None]
    cosine = np.einsum("nki,ni->nk", away, mesh.normals[face])
    sees = np.array([in_regions(lit, row, points, face) for row in range(3)]).T
    light = np.where(sees, 50 * cosine / np.linalg.norm(away, axis=2) ** 3, 0).sum(axis=1)
    e = part.bound.sum() / total * n
    wrong = int((in_regions(part, 0, points, face) != (light >= 6)).sum())
    assert wrong <= 2 + e + 6 * np.sqrt(e)
