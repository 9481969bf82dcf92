"""Luminaires of IES and EULUMDAT files: light at points by own interpolation, round trips."""

import contextlib

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from nightly import examples
from surface_cases import in_regions

import rastercov as rc
from rastercov.base.errors import CameraError
from rastercov.light.lamps import illuminances, lamps_of_json, points_of
from rastercov.light.photometry import TABLE_TOLERANCE, table_of
from rastercov.reference.regions import points_on

C_SPANS = {90: 0, 180: 90, 360: 0}
"""First plane of files over so many degrees, beside 0."""


def ies(down, around, candela, *, kind=1, head="IESNA:LM-63-2002", factors="1 1 1", tilt="NONE"):
    """Text of an IES file."""
    multiplier, ballast, other = factors.split()
    rows = [" ".join(f"{each:.17g}" for each in row) for row in (down, around, *candela)]
    sizes = f"1 1000 {multiplier} {len(down)} {len(around)} {kind} 2 0 0 0"
    return "\n".join([head, "[TEST] own", f"TILT={tilt}", sizes, f"{ballast} {other} 50", *rows])


def ldt(down, around, candela, symmetry, lumens=2500.0, factor=1.0):
    """Text of an EULUMDAT file of cd / klm, of the planes that its symmetry keeps."""
    n, (first, kept) = len(around), {
        0: (0, len(around)), 1: (0, 1), 2: (0, len(around) // 2 + 1),
        3: (3 * len(around) // 4, len(around) // 2 + 1), 4: (0, len(around) // 4 + 1),
    }[symmetry]  # fmt: skip
    lines = ["own", "3", symmetry, n, 360 / n, len(down), 0, *"12345", *[0] * 9, 100, 80]
    lines += [factor, 0, 1, 1, "LED", lumens, 3000, 80, 50, *[0] * 10, *around, *down]
    lines += [value for row in range(first, first + kept) for value in candela[row % n]]
    return "\r\n".join(map(str, lines)).replace(".", ",")


def bilinear(down, around, candela, from_pole, turn):
    """Intensities linear in both angles, degrees, of planes over a circle; 0 beyond the angles."""
    of_planes = np.array([np.interp(from_pole, down, row, 0, 0) for row in candela])
    columns = zip(around[0] + (turn - around[0]) % 360, of_planes.T, strict=True)
    return np.array([np.interp(at, around, column) for at, column in columns])


def light_at(lamps, points, normals):
    """Illuminance of points, which all lamps see."""
    poses = points_of(lamps, np.ones(len(lamps), bool))
    return illuminances(lamps, poses, np.ones((len(poses), len(points)), bool), points, normals)


def lamp_of(folder, text, more="", name="a.ies"):
    (folder / name).write_text(text, newline="", encoding="latin-1")
    (folder / "lamps.toml").write_text(f'[lamps.a]\nies = "{name}"\nposition = [1, 2, 3]\n{more}')
    return rc.load_lamps(folder / "lamps.toml")


def random_planes(rng, span, n_angles=8, n_planes=7, last=90):
    down = np.r_[0.0, np.sort(rng.choice(np.arange(1, last), n_angles - 2, replace=False)), last]
    around = np.sort(rng.choice(np.arange(1, span), n_planes - 2, replace=False))
    candela = rng.uniform(0, 900, (n_planes, n_angles))
    return down, np.r_[0.0, around, span], candela


def whole_circle(around, candela):
    """Planes mirrored to 360 degrees, by hand: each of the mirrored angles by its own."""
    span, first = np.ptp(around), around[0]
    turns = np.arange(0, 360.25, 0.25)
    folded = (turns - first) % 360
    folded = np.where(folded > 180, 360 - folded, folded) if span < 360 else folded
    folded = np.where(folded > span, 2 * span - folded, folded)
    of_angles = [np.interp(first + folded, around, column) for column in candela.T]
    return turns, np.array(of_angles).T


def below(rng, n=200):
    """Points below (1, 2, 3), and unit normals."""
    points = np.c_[rng.uniform(-4, 6, n), rng.uniform(-3, 7, n), rng.uniform(0, 2.9, n)]
    normals = rng.normal(size=(n, 3))
    return points, normals / np.linalg.norm(normals, axis=1)[:, None]


def assert_light(lamps, points, normals, intensity):
    away = np.array([1, 2, 3]) - points
    d = np.linalg.norm(away, axis=1)
    wanted = intensity * np.abs((away * normals).sum(axis=1)) / d**3
    assert light_at(lamps, points, normals) == pytest.approx(wanted, rel=1e-6, abs=1e-9)


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("span", C_SPANS)
def test_planes_of_type_c_light_points_by_both_angles(span, seed, tmp_path):
    rng = np.random.default_rng(seed)
    down, around, candela = random_planes(rng, span)
    if span == 360:
        candela[-1] = candela[0]
    around += C_SPANS[span] * (seed % 2)
    spin = float(rng.uniform(-180, 180))
    text = ies(down, around, candela, factors="1.5 0.8 7")
    lamps = lamp_of(tmp_path, text, f"spin_deg = {spin}")
    points, normals = below(rng)
    dx, dy, dz = (points - [1, 2, 3]).T
    from_down = np.degrees(np.arctan2(np.hypot(dx, dy), -dz))
    turns, grid = whole_circle(around, candela)
    turn = (np.degrees(np.arctan2(dy, dx)) - spin) % 360
    planes_at = around if span == 360 else turns
    grid = candela if span == 360 else grid
    assert_light(lamps, points, normals, 1.2 * bilinear(down, planes_at, grid, from_down, turn))
    again = lamps_of_json(lamps.to_json())
    assert (light_at(again, points, normals) == light_at(lamps, points, normals)).all()


@pytest.mark.parametrize("kind", [2, 3])
@pytest.mark.parametrize("is_half", [False, True])
def test_types_a_and_b_light_points_up_and_to_the_right_of_the_aim(kind, is_half, tmp_path):
    rng = np.random.default_rng(kind)
    up, right = np.arange(-90, 91, 15.0), np.array([-90, -40, -10, 0, 20, 50, 90.0])
    if is_half:
        right = np.array([0, 20, 50, 90.0])
    candela = rng.uniform(0, 900, (len(right), len(up)))
    lamps = lamp_of(tmp_path, ies(up, right, candela, kind=kind), "aim = [9, 2, 3]")
    points = np.array([1, 2, 3]) + np.abs(rng.normal(size=(200, 3))) * (1, 0, 0)
    points = points + rng.normal(size=(200, 3)) * (0, 1, 1) + (0.1, 0, 0)
    normals = below(rng)[1]
    dx, dy, dz = (points - [1, 2, 3]).T
    if kind == 3:  # H about the vertical axis, then V towards it
        v, h = np.arctan2(dz, np.hypot(dx, dy)), np.arctan2(-dy, dx)
    else:  # V about the horizontal axis, then H towards it
        v, h = np.arctan2(dz, dx), np.arctan2(-dy, np.hypot(dx, dz))
    v, h = np.degrees(v), np.degrees(h)
    of_planes = np.array([np.interp(v, up, row) for row in candela])
    h = np.abs(h) if is_half else h
    wanted = [np.interp(at, right, column) for at, column in zip(h, of_planes.T, strict=True)]
    assert_light(lamps, points, normals, np.array(wanted))


@pytest.mark.parametrize("symmetry", range(5))
def test_eulumdat_lights_points_as_its_symmetry_says(symmetry, tmp_path):
    rng = np.random.default_rng(symmetry)
    around, down = np.arange(0, 360, 30.0), np.arange(0, 91, 10.0)
    candela = rng.uniform(0, 400, (12, 10))
    mirrors = {1: [0] * 12, 2: (-np.arange(12)) % 12, 3: (6 - np.arange(12)) % 12}
    if symmetry in mirrors:
        candela = candela[np.minimum(mirrors[symmetry], np.arange(12))]
    if symmetry == 4:
        row = np.minimum(np.arange(12), 12 - np.arange(12))
        candela = candela[np.minimum(row, 6 - row)]
    text = ldt(down, around, candela, symmetry, factor=1.1)
    lamps = lamp_of(tmp_path, text, name="a.ldt")
    assert bool(lamps.lamps[0].planes) == (symmetry != 1)
    points, normals = below(rng)
    dx, dy, dz = (points - [1, 2, 3]).T
    from_down = np.degrees(np.arctan2(np.hypot(dx, dy), -dz))
    turn = np.degrees(np.arctan2(dy, dx)) % 360
    closed = np.r_[around, 360.0], np.r_[candela, candela[:1]]
    assert_light(lamps, points, normals, 2.5 * 1.1 * bilinear(down, *closed, from_down, turn))


@pytest.mark.parametrize("is_symmetric", [False, True])
def test_uplights_light_what_is_above_them(is_symmetric, tmp_path):
    rng = np.random.default_rng(1)
    up, around = np.array([90, 120, 135, 180.0]), np.array([0, 70, 200, 360.0])
    candela = rng.uniform(0, 900, (4, 4))
    candela[3] = candela[0]
    if is_symmetric:
        around, candela = around[:1], candela[:1]
    lamps = lamp_of(tmp_path, ies(up, around, candela, head="IES:LM-63-2019"))
    points, normals = below(rng)
    points = 2 * np.array([1, 2, 3]) - points
    dx, dy, dz = (points - [1, 2, 3]).T
    from_down = np.degrees(np.arctan2(np.hypot(dx, dy), -dz))
    if is_symmetric:
        around, candela = np.array([0, 360.0]), np.repeat(candela, 2, axis=0)
    turn = np.degrees(np.arctan2(dy, dx)) % 360
    assert_light(lamps, points, normals, bilinear(up, around, candela, from_down, turn))
    assert lamps.lamps[0].half_angle_deg == 90  # of a cone around the zenith
    assert points_of(lamps, np.ones(1, bool)).world_from_camera[0, 2, 2] == pytest.approx(1)


@pytest.mark.parametrize(
    ("head", "factor"),
    [("[TEST] none", 6), ("IESNA:LM-63-1986", 6), ("IESNA91", 6), ("IESNA:LM-63-1995", 3),
     ("IESNA:LM-63-2002", 3), ("IES:LM-63-2019", 3)],
)  # fmt: skip
def test_the_second_factor_counts_in_files_of_1986_and_1991(head, factor, tmp_path):
    text = ies([0, 45, 90], [0], [[1000, 700, 0]], head=head, factors="1.5 2 2")
    lamp = lamp_of(tmp_path, text).lamps[0]
    assert lamp.intensity == 1000 * factor
    assert lamp.profile == ((0, 1), (45, 0.7), (90, 0))


def test_files_of_dos_programs_end_with_a_character_of_their_own(tmp_path):
    text = ies([0, 45, 90], [0], [[1000, 700, 0]])
    lamps = [lamp_of(tmp_path, text + end).lamps[0] for end in ("", "\r\n\x1a\r\n")]
    assert lamps[0] == lamps[1]


def test_light_by_tilt_is_that_of_the_aim(tmp_path):
    for geometry, wanted in ((1, 700), (2, 900), (3, 700)):
        text = ies(
            [0, 45, 90], [0], [[1000, 700, 0]], tilt=f"INCLUDE\n{geometry}\n3\n0 45 90\n.9 .7 1"
        )
        lamps = lamp_of(tmp_path, text, "aim = [2, 2, 2]")
        assert lamps.lamps[0].intensity == pytest.approx(wanted)
        assert lamp_of(tmp_path, text).lamps[0].intensity == pytest.approx(900)
    text = text.replace("\n3\n3\n", "\n1\n3\n")
    with pytest.raises(CameraError, match="expected a fixed lamp"):
        lamp_of(tmp_path, text, "rig = true")


PROFILES = st.lists(st.tuples(st.integers(1, 1800), st.floats(0, 1)), min_size=2, max_size=40)


@examples(40)
@given(pairs=PROFILES, first=st.floats(0, 1))
@example(pairs=[(470, 0.12431870607487541), (600, 0.0)], first=1.0)  # rounded to -1e-17 at 60
def test_cubics_of_the_engine_are_within_a_millionth_of_a_profile(pairs, first):
    profile = ((0.0, first), *sorted({at / 10: share for at, share in pairs}.items()))
    angle, share = np.array(profile).T
    table = table_of(profile)
    assert (np.diff(table[:, 0]) > 0).all()
    assert table[[0, -1], 0].tolist() == [-1, 1]
    assert (table[:, 1] >= 0).all()
    cosine = np.cos(np.radians(np.r_[np.linspace(0, 180, 20_001), 10.0 ** np.linspace(-4, 0, 999)]))
    k = np.clip(np.searchsorted(table[:, 0], cosine, "right") - 1, 0, len(table) - 2)
    low, high = table[k], table[k + 1]
    width = high[:, 0] - low[:, 0]
    t = (cosine - low[:, 0]) / width
    values = (1 - t) ** 2 * ((1 + 2 * t) * low[:, 1] + t * width * low[:, 3])
    values += t**2 * ((3 - 2 * t) * high[:, 1] + (t - 1) * width * high[:, 2])
    wanted = np.interp(np.degrees(np.arccos(cosine)), angle, share)
    steep = np.abs(np.diff(share) / np.diff(angle)).max()
    off = TABLE_TOLERANCE * max(share.max(), steep)
    assert np.abs(values - wanted).max() <= off + 1e-12


def assert_lux(lamps, floor, camera, eye, task, n=2000):
    """Points of a floor, all seen and lit, are covered exactly if they have the light asked for."""
    regions = rc.regions(floor, camera, eye, task, lamps=lamps)
    points, face = points_on(floor, n)
    light = light_at(lamps, points, np.repeat([[0, 0, 1.0]], n, axis=0))
    most = np.inf if task.max_illuminance is None else task.max_illuminance
    wanted = (light >= task.min_illuminance) & (light <= most)
    wrong = in_regions(regions, 0, points, face) != wanted
    area = regions.mesh.areas.sum()
    assert 0.05 < wanted.mean() < 0.95
    assert wrong.mean() * area <= regions.bound.sum() + 3 * area / n
    assert regions.areas().sum() == pytest.approx(wanted.mean() * area, abs=area / np.sqrt(n))
    assert regions.bound.sum() < 2e-3 * area
    return regions


@pytest.mark.native
@pytest.mark.parametrize("more", ["", "spin_deg = 33\naim = [3, 2, 0]"], ids=["down", "aimed"])
def test_limits_of_illuminance_are_cut_by_both_angles(more, tmp_path):
    floor = rc.Mesh([(-2, 0, 0), (4, 0, 0), (4, 5, 0), (-2, 5, 0)], [(0, 1, 2), (0, 2, 3)])
    camera, eye = rc.Camera.from_fov(500, 500, hfov_deg=90), rc.look_at((1, 2, 8), (1, 2, 0))
    down, around, candela = random_planes(np.random.default_rng(0), 180)
    candela[:, 0] = 500
    lamps = lamp_of(tmp_path, ies(down, around, candela), more)
    light = light_at(lamps, points_on(floor, 2000)[0], np.repeat([[0, 0, 1.0]], 2000, axis=0))
    low, high = map(float, np.quantile(light, [0.3, 0.8]))
    both = assert_lux(lamps, floor, camera, eye, rc.Task(min_illuminance=low, max_illuminance=high))
    least = assert_lux(lamps, floor, camera, eye, rc.Task(min_illuminance=low))
    bright = assert_lux(lamps, floor, camera, eye, rc.Task(min_illuminance=high))
    off = sum(each.bound.sum() for each in (both, least, bright))
    parts = both.areas().sum() + bright.areas().sum()
    assert parts == pytest.approx(least.areas().sum(), abs=off)
    sensor = rc.Exposure(
        exposure_time=0.01, f_number=4, pixel_size=3.45e-6, quantum_efficiency=0.65,
        full_well=10_500, dark_noise=2.5, min_snr=5, max_saturation=0.9,
    )  # fmt: skip
    exposed = rc.Lamps(lamps.lamps, lamps.places, exposure=sensor)
    task = rc.Task().exposed(sensor)
    regions = rc.regions(floor, camera, eye, lamps=exposed)
    wanted = rc.regions(floor, camera, eye, task, lamps=lamps)
    assert regions.areas().sum() == wanted.areas().sum()


@pytest.mark.native
def test_types_a_and_b_and_uplights_have_limits_of_illuminance(tmp_path):
    floor = rc.Mesh([(-2, 0, 0), (4, 0, 0), (4, 5, 0), (-2, 5, 0)], [(0, 1, 2), (0, 2, 3)])
    camera, eye = rc.Camera.from_fov(500, 500, hfov_deg=90), rc.look_at((1, 2, 8), (1, 2, 0))
    rng, up = np.random.default_rng(3), np.arange(-90, 91, 15.0)
    candela = rng.uniform(200, 900, (7, len(up)))
    text = ies(up, np.array([-90, -40, -10, 0, 20, 50, 90.0]), candela, kind=2)
    lamps = lamp_of(tmp_path, text, "aim = [1, 2.5, 0]")
    assert_lux(lamps, floor, camera, eye, rc.Task(min_illuminance=30))
    around, candela = np.array([0, 70, 200, 360.0]), rng.uniform(200, 900, (4, 4))
    candela[3] = candela[0]
    text = ies(np.array([90, 120, 135, 180.0]), around, candela)
    (tmp_path / "up.ies").write_text(text)
    lamp = rc.Lamp.from_ies(tmp_path / "up.ies")
    upside = np.array([[1.0, 0, 0, 1], [0, 1, 0, 2], [0, 0, 1, 3], [0, 0, 0, 1]])  # shines down
    assert_lux(rc.Lamps([lamp], [upside]), floor, camera, eye, rc.Task(min_illuminance=20))


def test_files_of_luminaires_that_cannot_be_used_are_one_line(tmp_path):
    text = ldt(np.arange(0, 91, 10.0), np.arange(0, 360, 30.0), np.ones((12, 10)), 1)
    lines = text.split("\r\n")
    for change, words in [
        (lines[:60], "expected 64 lines or more of EULUMDAT, got 60"),
        ([*lines[:2], "7", *lines[3:]], "expected an EULUMDAT file, with symmetry 0 to 4"),
        ([*lines[:2], "-1", *lines[3:]], "expected an EULUMDAT file, with symmetry 0 to 4"),
        ([*lines[:3], "1e9", *lines[4:]], "expected an EULUMDAT file, with symmetry 0 to 4"),
        ([*lines[:25], "99999", *lines[26:]], "lines or more of EULUMDAT"),
        ([*lines[:28], "x", *lines[29:]], "expected numbers after its header, got words"),
    ]:
        with pytest.raises(CameraError, match=words) as caught:
            lamp_of(tmp_path, "\n".join(change), name="a.ldt")
        assert len(str(caught.value).split("a.ldt: ")[1]) <= 160
    with pytest.raises(CameraError, match=r"got a luminaire; name it in a .toml"):
        rc.load_lamps(tmp_path / "a.ldt")


@examples(200)
@given(data=st.data())
def test_spoilt_files_are_read_or_refused(data, tmp_path_factory):
    folder = tmp_path_factory.mktemp("spoilt")
    down, around, candela = [0, 30, 60, 90], [0, 45, 90], [[9, 8, 7, 0]] * 3
    is_ies = data.draw(st.booleans())
    text = ies(down, around, candela, tilt="INCLUDE\n1 2 0 90 1 1")
    if not is_ies:
        text = ldt(down, np.arange(0, 360, 45), candela * 3, 2)
    words = text.split(" ") if is_ies else text.split("\r\n")
    for _ in range(data.draw(st.integers(1, 3))):
        at = data.draw(st.integers(0, len(words) - 1))
        spoilt = st.sampled_from(["", "-1", "nan", "1e308", "0", "1e9", "2,5", "x", "\x00", "360"])
        words[at] = data.draw(spoilt)
    path = folder / ("a.ies" if is_ies else "a.ldt")
    path.write_text((" " if is_ies else "\r\n").join(words), encoding="latin-1")
    with contextlib.suppress(CameraError):
        lamp = rc.Lamp.from_ies(path)
        assert np.isfinite(light_at(rc.Lamps([lamp]), np.ones((1, 3)), np.ones((1, 3)))).all()


@pytest.mark.native
def test_a_lamp_with_a_range_is_enough_up_to_it(tmp_path):
    """A wall around its axis is lit up to E(r) = cos i / d^2 = 1 / range^2: d^3 = h range^2."""
    half, height = 3.0, 2.0
    wall = rc.Mesh(
        [(-half, -half, 0), (half, -half, 0), (half, half, 0), (-half, half, 0)],
        [(0, 1, 2), (0, 2, 3)],
    )
    camera, eye = rc.Camera.from_fov(500, 500, hfov_deg=100), rc.look_at((0, 0, 3), (0, 0, 0))
    (tmp_path / "ir.toml").write_text(
        '[lamps.ir]\nkind = "spot"\nhalf_angle_deg = 80\nrange = "2.5 m"\nposition = [0, 0, 2]\n'
    )
    lamps = rc.load_lamps(tmp_path / "ir.toml")
    assert lamps_of_json(lamps.to_json()).lamps == lamps.lamps
    result = rc.evaluate(wall, camera, eye, lamps=lamps, fields=())
    radius2 = (height * 2.5**2) ** (2 / 3) - height**2
    bound = result.covered.bound
    assert result.covered.area[0].sum() == pytest.approx(np.pi * radius2, abs=np.sum(bound) + 1e-9)
    assert "on its axis at its range, defined as 1 W/m2" in result.summary()["light"]["range"]
    half_of_it = rc.evaluate(
        wall, camera, eye, rc.Task(min_illuminance=0.5), lamps=lamps, fields=()
    )
    assert half_of_it.covered.share() > result.covered.share()
    with pytest.raises(CameraError, match="expected a range of all lamps or of none"):
        rc.Lamps([rc.Lamp(range_m=3.0), rc.Lamp(power_w_sr=9.0)])
    for value in ('"20 ft"', "-1", '"m"', "true"):
        (tmp_path / "ir.toml").write_text(f"[lamps.ir]\nposition = [0, 0, 2]\nrange = {value}\n")
        with pytest.raises(CameraError, match=r'a length above 0 such as "20 m", got'):
            rc.load_lamps(tmp_path / "ir.toml")
