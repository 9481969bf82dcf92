"""The documentation: its commands and programs run and say what it says; the site is whole."""

import json
import os
import re
import shlex
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
import yaml
from browser import CHROMIUM
from commands import call
from nightly import IS_NIGHTLY, nightly
from of_features import of_features
from processes import python
from reader import write_files
from short_search import short_search  # noqa: F401 # a fixture

import rastercov as rc
from rastercov.cli.console import COMMANDS
from rastercov.core.camera.catalogue import catalogue
from rastercov.placement.plan.file import plan_of

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
MADE = ("_build", "appendix", "reference")
PAGES = {"README": ROOT / "README.md"} | {
    str(path.relative_to(DOCS).with_suffix("")): path
    for path in sorted(DOCS.rglob("*.md"))
    if path.relative_to(DOCS).parts[0] not in MADE
}
HOW_TO = {*re.findall(r"\]\((\w+)\.md\)", PAGES["guides"].read_text(encoding="utf-8")), "start"}
HOW_TO |= {name for name in PAGES if name.startswith("tutorials/")}
BASES = (ROOT, ROOT / "rastercov")
"""Folders that names of files in CONTRIBUTING begin at."""
ELSEWHERE = {".", "make", "python3", "pip", "jupyter", "docker", "dask", "openssl", "export", "ssh"}
"""Programs that need a network, a desk or another machine; tests/cluster has the lines of Dask."""
FILES = {
    "sensors": "fringe.toml",
    "turntable": "plan.toml",
    "buildings": "house.toml",
    "start": "camera.toml",
    "recipes": "ir.toml",
    **of_features("PAGES"),
}
"""Pages whose first table is a file of the reader, and those of features."""
SHORT = {"--workers 8": "--workers 2", "as1.stp": "as1.obj", "audit/": "audit", "report/": "report"}
SHORT |= {"teapot -c stereo:0.12 -p turntable:8@30": "teapot-5 -c stereo:0.12 -p turntable:2@30"}
"""Words that are replaced: fewer processes and poses, and a public file without the file."""
LONG = {"tutorials/inspection"}
"""Pages whose goals short searches do not reach."""
OF_SEARCHES = {"plan_result", "tutorials/building"}
"""Pages that say what long searches find, which are made at night."""
DEAR = {
    *("audit", "catalogue", "light", "recipes", "scale", "scan_room", "turntable"),
    *("tutorials/building", "tutorials/inspection", "tutorials/photogrammetry"),
}
"""Pages of long commands: by day others run, and these where pages changed."""
AT_NIGHT = {"tutorials/print_monitor"}
"""Pages of an example alone that tests/test_examples.py tries by day."""
MARKS = dict.fromkeys(DEAR, pytest.mark.matter("docs")) | dict.fromkeys(AT_NIGHT, nightly)
GIVEN = """
import numpy as np
import rastercov as rc
mesh, K, k1, k2, p1, p2, k3 = rc.Mesh.load("mesh.ply"), 900 * np.eye(3), 0, 0, 0, 0, 0
K[:, 2] = 640, 512, 1
left = right = rc.Camera.from_fov(64, 48, hfov_deg=46)
rig_from_camera = world_from_rig = rc.sphere_of_poses((0, 0, 0), 0.3, 2)
"""
"""Values of the reader in pages that only show what follows from them."""


def blocks(page):
    text = PAGES[page].read_text(encoding="utf-8")
    return re.findall(r"^```([^\n]*)\n(.*?)^```$", text, re.DOTALL | re.MULTILINE)


def text_of(page, language):
    return "".join(text for its, text in blocks(page) if its == language)


def run(line, capsys):
    """Output of a line of a shell, or nothing of what is elsewhere."""
    command, fails, _ = line.partition(" || ")
    program, *words = shlex.split(command, comments=True) or [""]
    if program == "rastercov" and "--scheduler" not in words:
        if words[0] == "view" and "--export" not in words:
            words += ["--export", f"{len(list(Path().iterdir()))}.html"]
        if "--pdf" in words and CHROMIUM is None:
            words.remove("--pdf")
        code, out, err = call(capsys, words)
        assert code == bool(fails), err
        assert "not read" not in err  # what one command writes another one knows
        return out
    if program == "python":
        done = python("-W", "error", *words)
        assert (done.returncode, done.stderr) == (0, "")
        return done.stdout
    if program == "cp":
        shutil.copy(*words)
    else:
        assert program in {"", "rastercov", *ELSEWHERE}, line
    return ""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    write_files(tmp_path)
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "100")


@pytest.mark.slow
@pytest.mark.parametrize(
    "page",
    [
        pytest.param(page, marks=MARKS.get(page, ()))
        for page in PAGES
        if {"sh", "python"} & {*dict(blocks(page))}
    ],
)
def test_a_page_does_what_it_says(page, folder, capsys, request):
    """What is printed in a block without a language is printed by the commands."""
    if page not in LONG and not IS_NIGHTLY:
        request.getfixturevalue("short_search")
    if page in FILES:
        first = next(text for its, text in blocks(page) if its == "toml")
        Path(FILES[page]).write_text(first, encoding="utf-8")
    lines = text_of(page, "sh")
    for word, other in SHORT.items():
        lines = re.sub(rf"{re.escape(word)}(?=\s)", other, lines)
    lines = re.sub(r"\\\n", "", lines).replace(" && ", "\n").splitlines()
    said = "".join(run(line, capsys) for line in lines)
    exec(compile(GIVEN + text_of(page, "python"), page, "exec"), {})
    said += capsys.readouterr().out
    missing = [line for line in text_of(page, "").splitlines() if line not in said]
    assert missing == [] or (page in OF_SEARCHES and not IS_NIGHTLY)


@pytest.mark.parametrize("page", [page for page in PAGES if "toml" in dict(blocks(page))])
def test_a_table_is_understood(page, folder):
    """A table is part of a plan, a camera, or a catalogue of one's own."""
    base = {"meshes": [{"path": "part.ply"}], "camera": {"preset": "khepra"}}
    for text in (text for its, text in blocks(page) if its == "toml"):
        for name in re.findall(r'"([\w/]+\.(?:glb|obj|stl|json))"', text):
            Path(name).parent.mkdir(exist_ok=True)
            Path(name).touch()  # whether it is there is asked here, its content is not
        table = tomllib.loads(text)
        if "lenses" in table:
            Path("own.toml").write_text(text, encoding="utf-8")
            catalogue("own.toml")
        elif "width" in table or "file" in table or "rig_from_camera" in table:
            Path("camera.toml").write_text(text, encoding="utf-8")
            assert rc.read_views("camera.toml").cameras()
        else:
            missing = {key for key in base if key not in table and f"{key}s" not in table}
            plan_of({key: base[key] for key in missing} | table, Path("plan.toml"))


@pytest.mark.slow
def test_the_workflow_fails_for_a_lost_camera_and_says_where(folder, capsys):
    """Its steps, as the server of GitHub runs them: the shell, the condition, the summary."""
    for line in text_of("ci", "sh").splitlines()[:2]:
        run(line, capsys)
    rig = json.loads(Path("rig.json").read_text())
    rows = ("world_from_camera", "camera", "images")
    Path("rig.json").write_text(json.dumps(rig | {name: rig[name][:1] for name in rows}))
    job = yaml.safe_load(text_of("ci", "yaml"))["jobs"]["check"]
    bin_ = Path("bin")
    bin_.mkdir()
    program = f'#!/bin/sh\nexec "{sys.executable}" -m rastercov "$@"\n'
    (bin_ / "rastercov").write_text(program)
    (bin_ / "rastercov").chmod(0o755)
    own = {"PATH": f"{bin_.resolve()}:{os.environ['PATH']}", "GITHUB_STEP_SUMMARY": "page.md"}
    failed, said = False, {}
    for step in (each for each in job["steps"] if "run" in each and "pip" not in each["run"]):
        if failed or step.get("if") != "failure()":
            options = ["-eo", "pipefail"] if step.get("shell") == "bash" else ["-e"]
            done = subprocess.run(
                ["bash", *options, "-c", step["run"]],
                env=os.environ | own, capture_output=True, text=True, check=False,
            )  # fmt: skip
            failed |= done.returncode != 0
            said[step.get("if")] = done.stdout
    assert failed
    line = r"::error file=rig.json::worse: whole task: down [\d.]+ percentage points"
    assert re.search(line, said["failure()"])
    missed = ["check", "plan.toml", "--poses", "rig.json", "--min-coverage", "0.99"]
    pattern = re.search(r"grep -E '([^']+)'", text_of("ci", "yaml"))[1]
    lines = call(capsys, missed)[1].splitlines()
    assert any(re.search(pattern, line) for line in lines if line.startswith("goal"))
    assert Path("page.md").read_text().startswith("## rastercov check plan.toml: fails")
    kept = job["steps"][-1]["with"]["path"].split()
    assert all(Path(name).exists() for name in kept)
    assert "data:image/png" in Path("report/check.html").read_text(encoding="utf-8")


def words(text):
    """Number of words: marks of lists and tables are none."""
    return sum(any(map(str.isalnum, word)) for word in text.split())


def test_pages_keep_to_the_time_of_their_reader():
    """200 words a minute: five minutes a guide without its code, three the changelog."""
    everything = {page: words(path.read_text(encoding="utf-8")) for page, path in PAGES.items()}
    prose = {
        page: everything[page] - sum(words(text) for _, text in blocks(page)) for page in HOW_TO
    }
    assert {page: count for page, count in prose.items() if count > 1000} == {}
    assert sum(everything.values()) <= 28_700
    appendix = (path.read_text(encoding="utf-8") for path in (DOCS / "appendix").glob("*.md"))
    assert sum(everything.values()) + sum(map(words, appendix)) <= 45_000
    assert words((ROOT / "CHANGELOG.md").read_text(encoding="utf-8")) <= 750


def test_links_of_the_first_pages_lead_somewhere():
    """Sphinx follows those of docs/, and reads neither README nor SECURITY."""
    for name in ("README.md", "SECURITY.md", "CONTRIBUTING.md", "CHANGELOG.md"):
        text = (ROOT / name).read_text(encoding="utf-8")
        for target in re.findall(r"\]\(([^)]+)\)", text):
            path, _, anchor = target.partition("#")
            if "://" not in target:
                assert (ROOT / path).exists(), f"{name}: {target}"
            if anchor and "://" not in target:
                assert anchor in anchors(ROOT / path), f"{name}: {target}"


def test_files_that_a_contributor_is_sent_to_are_there():
    text = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    named = re.findall(r"`([a-z_]+(?:/[a-z_]+)*(?:\.py|/))`", text)
    assert len(named) > 15
    assert [name for name in named if not any((base / name).exists() for base in BASES)] == []


def anchors(path):
    heads = re.findall(r"^#+ (.*)$", path.read_text(encoding="utf-8"), re.MULTILINE)
    return {re.sub(r"[^\w -]", "", head.lower()).replace(" ", "-") for head in heads}


@nightly
@pytest.mark.slow
def test_the_site_is_whole_and_asks_nothing_of_the_network(tmp_path):
    done = python(
        "-m", "sphinx", "-q", "-W", "--keep-going", "-d", tmp_path / "d", DOCS, tmp_path / "site"
    )
    assert (done.returncode, done.stderr) == (0, "")
    site = tmp_path / "site"
    pages = [f"api/rastercov.{name}" for name in rc.__all__] + [
        f"commands/{name}" for name in COMMANDS
    ]
    assert {page for page in pages if not (site / "reference" / f"{page}.html").exists()} == set()
    asked = r'<(?:script|img|link|iframe|source)[^>]*(?:src|href)="(?:https?:)?//[^"]*"'
    for path in site.rglob("*.html"):
        assert re.findall(asked, path.read_text(encoding="utf-8")) == [], path
