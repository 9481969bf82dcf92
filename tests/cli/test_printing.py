"""Pages in a browser: no request, no fault, headings in order, few screens; and on paper."""

import re
import shutil
import sys
from itertools import pairwise
from pathlib import Path
from unicodedata import normalize

import pytest
from commands import call
from pypdf import PdfReader

from rastercov import look_at, write_poses
from rastercov.base.errors import ConfigError
from rastercov.cli.console import warn
from rastercov.report.folder import ReportFolder, ReportKind
from rastercov.report.printing import write_page

BROWSER = next(filter(None, map(shutil.which, ("chromium", "chromium-browser"))), None)
RIG = "width = 320\nheight = 240\nfx = 300\nfy = 300\n"
PLAN = f"""
meshes = [{{ built_in = "torus" }}]
task = {{ min_facing_density = 90 }}
candidates = [{{ generator = "on_sphere", count = 12, distances = [4.0] }}]
selection = {{ goal = "best_coverage", cameras = 3 }}
[camera]
{RIG}
"""
LINES = {
    "report": "evaluate torus -c camera.toml -p sphere:14 -o out --pdf",
    "page": "place plan.toml -o out --pdf",
    "check": "check plan.toml -p place/poses.json --min-coverage 0.9 -o out --pdf",
    "audit": "audit evaluate/rig.json torus -o out --pdf",
}
"""Pages and their commands; a later one reads what an earlier one wrote."""


def packed(text):
    """A text without its spaces and ligatures, which a file of paper does not keep."""
    return "".join(normalize("NFKC", text).split())


def empty_below(page):
    """Share of a page of A4 between its margins that is below all text and pictures."""
    heights = []

    def of_text(text, transform, matrix, *_):
        if text.strip():
            heights.append(transform[1] * matrix[4] + transform[3] * matrix[5] + transform[5])

    def of_picture(operator, _, transform, *__):
        if operator == b"Do":
            heights.extend((transform[5], transform[5] + transform[3]))

    page.extract_text(visitor_text=of_text, visitor_operand_before=of_picture)
    return (min(each for each in heights if each > 45) - 40) / (841 - 80)


@pytest.mark.matter("page")
@pytest.mark.slow
@pytest.mark.skipif(BROWSER is None, reason="no Chromium to open pages; see `make chromium`")
def test_pages_are_read_in_a_browser_and_on_paper(here, capsys):
    sync_api = pytest.importorskip("playwright.sync_api", reason="no Playwright to open pages")
    (here / "camera.toml").write_text(RIG)
    (here / "plan.toml").write_text(PLAN)
    for line in LINES.values():
        call(capsys, line.replace("-o out", f"-o {line.split()[0]}"))
    with sync_api.sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=BROWSER, args=["--no-sandbox"])
        page = browser.new_page(viewport={"width": 1280, "height": 800})
        faults, asked = [], []
        page.on("console", lambda message: faults.append(message.text))
        page.on("pageerror", lambda error: faults.append(str(error)))
        page.on("request", lambda request: asked.append(request.url))
        for name, line in LINES.items():
            path = Path(line.split()[0], f"{name}.html").resolve()
            page.goto(path.as_uri())
            levels = page.eval_on_selector_all("h1,h2,h3", "all => all.map(e => +e.tagName[1])")
            assert levels[0] == 1
            assert all(b <= a + 1 for a, b in pairwise(levels))
            assert page.locator("img:not([alt])").count() == 0
            assert page.evaluate("document.documentElement.scrollHeight") <= 3200  # four screens
            shown = page.locator("tr:visible").count()
            assert page.locator(".more").count() == (
                is_long := name in ("report", "audit")
            )  # 14 poses
            page.eval_on_selector_all(".more", "all => all.map(e => e.open = true)")
            assert page.locator("tr:visible").count() == shown + 2 * is_long
            if name != "audit":
                page.locator(".scene summary").click()
                page.frame_locator(".scene iframe").locator("canvas.scene").wait_for()
            page.reload()
            page.set_viewport_size({"width": 390, "height": 844})
            assert page.evaluate("document.documentElement.scrollWidth") <= 390
            assert page.evaluate("document.documentElement.scrollHeight") <= 4 * 844
            page.set_viewport_size({"width": 703, "height": 1000})  # of A4 between its margins
            page.emulate_media(media="print", color_scheme="dark")
            assert page.eval_on_selector_all(".wide", "all => all.every(e => e.scrollWidth <= 703)")
            whole = "all => all.every(e => getComputedStyle(e).breakInside === 'avoid')"
            assert page.eval_on_selector_all("figure, .card, tr", whole)
            heads = "all => all.every(e => getComputedStyle(e).display === 'table-header-group')"
            assert page.eval_on_selector_all("thead", heads)
            paper = "body => getComputedStyle(body).backgroundColor"
            assert page.eval_on_selector("body", paper) == "rgb(255, 255, 255)"
            page.emulate_media(media="screen", color_scheme="light")
            pdf = PdfReader(path.with_suffix(".pdf"))
            sheets = [packed(each.extract_text()) for each in pdf.pages]
            assert {tuple(map(int, each.mediabox[2:])) for each in pdf.pages} == {(594, 841)}
            assert all(empty_below(each) < 1 / 3 for each in list(pdf.pages)[:-1]), name
            for number, text in enumerate(sheets, 1):
                assert f"{number}/{len(sheets)}" in text
            said = "h1, h2, h3, .verdict strong, .verdict li, p:not(.screen):not(.paper), tbody tr"
            for words in page.locator(said).all_text_contents():
                assert any(packed(words) in text for text in sheets), words
            page.set_viewport_size({"width": 1280, "height": 800})
        browser.close()
    assert [text for text in faults if "GL Driver Message" not in text] == []  # slow OpenGL
    assert {url.split(":")[0] for url in asked} <= {"file", "data", "blob"}


@pytest.mark.slow
@pytest.mark.skipif(BROWSER is None, reason="no Chromium to open pages; see `make chromium`")
def test_paper_has_no_more_pages_for_more_images(here, capsys):
    (here / "camera.toml").write_text(RIG)
    call(capsys, "evaluate box -c camera.toml -p sphere:100 --pictures 0 -o evaluate")
    call(capsys, "audit evaluate/rig.json box -o out --pdf")
    sheets = [packed(each.extract_text()) for each in PdfReader("out/audit.pdf").pages]
    assert len(sheets) < 15
    assert sum("Thefirst80of100rows" in text for text in sheets) >= 1


def test_without_a_browser_nothing_is_done(here, capsys, monkeypatch):
    monkeypatch.setattr("rastercov.report.printing.BROWSERS", ())
    monkeypatch.setitem(sys.modules, "playwright.sync_api", None)
    code, _, err = call(capsys, "evaluate box -c khepra -p sphere:2 -o out --pdf")
    assert code == 2
    assert "expected Chromium or Chrome" in err
    assert ("apt-get install -y chromium)," in err) == (sys.platform == "linux")
    assert not Path("out").exists()


def test_paper_without_a_page_is_refused(here, capsys):
    line = "evaluate torus -c khepra -p sphere:2 --pictures 0 -o out --pdf"
    code, _, error = call(capsys, line)
    assert (code, error.count("\n")) == (2, 1)
    assert "--pdf: expected a page, got --pictures 0" in error
    assert not Path("out").exists()


SHELL = """#!/bin/sh
case "$*" in *--no-sandbox*) ;; *) echo "FATAL: No usable sandbox! See docs" >&2; exit 1; esac
for word; do case $word in --print-to-pdf=*) echo "%PDF" > "${word#*=}";; esac; done
"""


@pytest.mark.parametrize("is_root", [True, False])
def test_a_browser_in_a_container_prints_without_its_sandbox(here, is_root, monkeypatch):
    """A stand-in for Chromium where the system grants no namespaces to its sandbox."""
    program = here / "browser"
    program.write_text(SHELL)
    program.chmod(0o755)
    monkeypatch.setattr("rastercov.report.printing.BROWSERS", (str(program),))
    monkeypatch.setattr("os.geteuid", lambda: 0 if is_root else 1000, raising=False)
    with ReportFolder(here / "out", ReportKind("x", re.compile("x.(html|pdf)"), "x.html")) as out:
        write_page(out, "x", "<p>page</p>", pdf=True)
        assert out.file("x.pdf").read_text() == "%PDF\n"
    program.write_text("#!/bin/sh\necho no display >&2\n")
    with (
        pytest.raises(ConfigError, match=r"expected a PDF by .*, got no display; leave out --pdf"),
        ReportFolder(here / "out", ReportKind("x", re.compile("x.(html|pdf)"), "x.html")) as out,
    ):
        write_page(out, "x", "<p>page</p>", pdf=True)


def test_equal_warnings_of_one_answer_are_printed_once(capsys):
    warn("a", "b", "a", "c", "b")
    assert capsys.readouterr().err.splitlines() == [f"warning: {each}" for each in "abc"]


@pytest.mark.slow
@pytest.mark.skipif(BROWSER is None, reason="no Chromium to open pages; see `make chromium`")
def test_no_page_of_paper_but_the_last_is_a_third_empty(here, capsys):
    """Cards and long tables that moved on as wholes left up to 77 % of a page."""
    lines = []
    for row in range(48):
        (x, y), n = divmod(row, 8), 4 * row
        lines += [f"v {x + dx} {y + dy} 0" for dx, dy in ((0, 0), (0.8, 0), (0.8, 0.8), (0, 0.8))]
        lines += [f"g plate {row}", f"f {n + 1} {n + 2} {n + 3} {n + 4}"]
    (here / "plates.obj").write_text("\n".join([*lines, ""]))
    (here / "camera.toml").write_text(RIG)
    poses = look_at([(1, 1, 3), (3, 5, 4)], [(1, 1, 0), (3, 5, 0)], up=(0, 1, 0))
    write_poses(here / "rig.json", poses)
    line = "evaluate plates.obj -c camera.toml -p rig.json --max-incidence-deg 30 -o out --pdf"
    assert call(capsys, line)[0] == 0
    pages = PdfReader("out/report.pdf").pages
    shares = [empty_below(each) for each in list(pages)[:-1]]
    assert len(shares) > 2
    assert max(shares) < 1 / 3
