"""What a terminal shows: the first five lines, figures once, 80 columns, no faces by area."""

import re
import shlex
import signal
import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import pytest
from commands import call, write_part

import rastercov as rc
from rastercov.advice.headline import MOST_REASONS, by_reason
from rastercov.base import percent
from rastercov.core.area.feature import in_words
from rastercov.core.coverage.task import NAMES, REASONS
from rastercov.report import coverage
from rastercov.report.plan import cameras_table, source_of

CAMERA = "width = 96\nheight = 72\nfx = 60\nfy = 60\n"
PLAN = f"""
meshes = [{{ path = "part.obj" }}]
task = {{ max_incidence_deg = 80 }}
candidates = [{{ generator = "on_sphere", count = 12, distances = [3.0] }}]
selection = {{ SELECTION }}
[camera]
{CAMERA}
"""
BEST = 'goal = "best_coverage", cameras = 2'
FEWEST = 'goal = "fewest_cameras", coverage = 0.9'
ZONE = r"dead zone .* m² .*: .*"


@pytest.fixture(autouse=True)
def files(here):
    write_part("part.obj")
    (here / "camera.toml").write_text(CAMERA)
    rc.write_poses("rig.json", rc.look_at([(3, 0.5, 1), (0, 3, 1), (0, 3, 1.01)], np.zeros(3)))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("line", "selection", "goal", "file"),
    [
        ("place plan.toml -o out", BEST, "goal: best coverage with at most 2 cameras", "page.html"),
        ("place plan.toml -o out", FEWEST, r"goal for the whole task \w+: 90.0 % .*", "page.html"),
        ("check plan.toml -p rig.json -o out", FEWEST, "goal for the whole .*", "check.html"),
        ("check plan.toml -p rig.json -o out --min-coverage .1", BEST, "goal .*", "check.html"),
        ("evaluate part.obj -c camera.toml -p rig.json -o out", BEST, None, "report.html"),
    ],
)  # fmt: skip
@pytest.mark.parametrize("level", ["", " --level 1"])
def test_answer_goal_worst_zone_advice_and_file_come_first(
    here, capsys, line, selection, goal, file, level
):
    few = PLAN.replace("count = 12", "count = 2")
    (here / "plan.toml").write_text(few.replace("SELECTION", selection))
    code, out, _ = call(capsys, line + level)
    lines = out.splitlines()
    wanted = [r"covered: [\d.]+ % of the area", goal, ZONE, rf"out/{file}"]
    gain = (
        "about .+ percentage points more of the whole task; then about .+ % or more is covered: .+"
    )
    is_tried = gain[:5] in lines[1]  # the advice for the zone says no more
    if code == 1:
        wanted.insert(1, "best change known: (.+: " + gain + "|none .*)")
    wanted[-1:-1] = ["advice: .+"] * (code == 0 or not is_tried)
    for text, pair in zip(filter(None, wanted), lines, strict=False):
        assert re.fullmatch(text, pair), (text, pair)
    assert code in (0, 1)
    rest = out.replace("12 faces, 1 x 1 x 1 m", "").replace("│ faces", "")
    rest = rest.replace("pose-face pairs", "")
    assert not re.search(r"\bfaces?\b", rest), "by area, nothing is said of faces"
    assert out.count(lines[0]) == 1
    said = [each for each in lines if each.strip() and each[0] not in "┏┃┡│├└┌"]
    assert len({*said}) == len(said)
    assert out.count("out/") == 1
    assert all(len(each) <= 80 for each in lines if each[:1] in "┏┃┡│├└")


def test_by_face_the_worst_reason_takes_the_place_of_a_zone(capsys):
    _, out, _ = call(capsys, "evaluate part.obj -c camera.toml -p rig.json -o out --by face")
    answer, worst, advice, file = out.splitlines()[:4]
    assert answer == "covered: 50.0 % of the faces, 50.0 % of the area"
    assert worst == "not covered: 6 faces (50.0 % of the area); cause: back-facing"
    assert advice.startswith("advice: ")
    assert file == "out/report.html"
    assert out.count("6 faces") == 1


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(5))
def test_reasons_in_a_line_are_few_have_one_unit_and_add_up(seed):
    """Lines had forty reasons, down to 0.003 %, in two units."""
    rng = np.random.default_rng(seed)
    known = [name for name in NAMES if name in REASONS and "," not in REASONS[name].label]
    some = rng.permutation(known)[: rng.integers(2, len(known))].tolist()
    sizes = 10 ** rng.uniform(-5, 1, (2, len(some)))
    why = {
        name: {"m2": m2, "gain_m2": m2 * gain}
        for name, (m2, gain) in zip(some, sizes.T, strict=True)
    }
    text = by_reason(why)
    assert len({*re.findall(r"[cm]?m²", text)}) == 1
    own = re.findall(r"(?:^|, )([\d.,e-]+) ([cm]?m)²", text)
    assert 0 < len(own) <= MOST_REASONS + 1
    metres = {"m": 1.0, "cm": 1e-4, "mm": 1e-6}
    m2 = [float(size.replace(",", "")) * metres[unit] for size, unit in own]
    assert sum(m2) == pytest.approx(sizes[0].sum(), rel=0.01)
    assert m2[:MOST_REASONS] == sorted(m2[:MOST_REASONS], reverse=True)


@pytest.mark.parametrize("doubtful", [0.0, 1e-13, 1e-5, 0.0004, 0.06, 0.5, 12.0])
def test_what_is_edge_on_is_said_where_its_figure_is_not_0(doubtful):
    figures = {"percent": 50.0, "bound_percent": 0.0, "views": 1, "doubtful_percent": doubtful}
    assert ("edge-on" in in_words(figures)) == (percent(doubtful / 100) != "0.0 %")
    assert "0.0 % more" not in in_words(figures)


def test_cameras_that_add_under_one_percent_are_named(here, capsys):
    goal = 'goal = "best_coverage", cameras = 12'
    (here / "plan.toml").write_text(PLAN.replace("SELECTION", goal))
    _, out, _ = call(capsys, "place plan.toml -o out")
    rows = re.findall(r"^│ (\d+) │.*│ +([\d.]+) % │ +[\d.]+ % │$", out, re.MULTILINE)
    few = [row for row, added in rows if float(added) < 1]
    words = re.findall(
        r"^cameras? ([\d, ]+) (?:adds less than 1 % of the total|add less than 1 % of the total "
        r"each)$",
        out,
        re.MULTILINE,
    )
    assert words == ([", ".join(few)] if few else [])


@pytest.mark.parametrize("far", [1.0, 99.96, 12_345.6, 5e6])
@pytest.mark.parametrize("size", [np.inf, 12.0])
@pytest.mark.parametrize("several", [False, True])
def test_coordinates_of_cameras_fit_80_columns(far, several, size):
    """In three digits of the furthest, or of the scene, which may be far from the origin."""
    rng = np.random.default_rng(3)
    n = 40
    poses = rc.look_at(far * rng.uniform(-1, 1, (n, 3)), np.zeros(3))
    names = ["pair/left", "a very long name of a camera", "long"]
    cameras = SimpleNamespace(
        poses=poses, placed=rc.Poses.of(poses, camera=np.arange(n) % 3), owner=np.arange(n),
        curve=np.linspace(0.1, 1, n),
        network=SimpleNamespace(covered_faces=np.arange(n), mesh=SimpleNamespace(diagonal=size)),
    )  # fmt: skip
    prepared = SimpleNamespace(
        noun="camera", plan=SimpleNamespace(chooses_cameras=False),
        camera=[None] * (1 + 2 * several),
        mounts=SimpleNamespace(rig=SimpleNamespace(names=names, __len__=None), has_rigs=False),
        pool=SimpleNamespace(costs=np.ones(n)),
    )  # fmt: skip
    prepared.mounts.rig = type("Rig", (), {"names": names, "__len__": lambda _: 1 + 2 * several})()
    simple_namespace = SimpleNamespace(
        cameras=cameras, prepared=prepared, origin=["walls, searched, refined"] * n
    )
    console = rc_console()
    console.print(cameras_table(simple_namespace))
    text = console.file.getvalue()
    assert all(len(line) <= 80 for line in text.splitlines())
    assert "…" not in text
    furthest = min(np.abs(poses[:, :3, 3]).max(), size)
    digits = max(0, 2 - int(np.floor(np.log10(furthest))))
    for pose in poses[:30]:
        assert " ".join(f"{value:.{digits}f}" for value in pose[:3, 3]) in text


@pytest.mark.parametrize(
    ("origin", "words"),
    [
        ("sphere", "sphere"),
        ("sphere on arm 2", "sphere on arm 2"),
        ("segment 13", "segment 13"),
        ("cavity 808, refined", "cavity at face 808, refined"),
        ("in Room 12 on arm 7", "in Room 12 on arm at face 7"),
        ("poses 6, searched, refined", "poses 6 (from 0), searched, refined"),
        ("strips on drone 2 11", "strips on drone 2 11 (from 0)"),
        ("existing 0", "kept: existing 0 (from 0)"),
    ],
)
def test_the_number_of_a_source_is_of_a_face_or_counts_from_0(origin, words):
    assert source_of(origin) == words


def rc_console():
    from io import StringIO

    from rich.console import Console

    return Console(file=StringIO(), width=80, color_system=None)


@pytest.mark.parametrize("by", ["area", "face"])
def test_the_answer_is_printed_before_anything_is_drawn(here, capsys, monkeypatch, by):
    """Then the report is made, whether somebody reads on or not, and nothing comes twice."""
    draw, seen = coverage._draw_poses, []

    def drawn(*arguments):
        seen.append(capsys.readouterr().out)
        return draw(*arguments)

    monkeypatch.setattr(coverage, "_draw_poses", drawn)
    code, rest, _ = call(capsys, f"evaluate part.obj -c camera.toml -p rig.json --by {by} -o out")
    assert code == 0
    answer, worst, advice = seen[0].splitlines()
    assert answer.startswith("covered: ")
    assert worst.startswith("dead zone" if by == "area" else "not covered: ")
    assert advice.startswith("advice: ")
    assert rest.startswith("out/report.html\n")
    assert not {answer, worst, advice} & set(rest.splitlines())


def test_a_reader_that_leaves_before_the_answer_does_not_end_the_report(here):
    code = "import os, sys; from rastercov.cli import main; os.read(0, 1); main()"
    line = shlex.split("evaluate part.obj -c camera.toml -p rig.json --pictures 1 -o out")
    streams = dict.fromkeys(("stdin", "stdout", "stderr"), subprocess.PIPE)
    with subprocess.Popen([sys.executable, "-c", code, *line], **streams) as child:
        child.stdout.close()
        child.stdin.write(b"\n")
        child.stdin.close()
        errors = child.stderr.read()
    assert child.returncode == -signal.SIGPIPE
    assert b"error" not in errors
    assert (here / "out" / "report.html").exists()
