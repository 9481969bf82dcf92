"""Pictures of reports for README.md and docs/, taken from the files that the commands write.

    python benchmarks/report_pictures.py [--out docs]

demo.png        dead zones of `rastercov demo`
placement.png   first picture of the page of `rastercov place`, of the part of the examples
sensors.png     overview of the fringe sensor of docs/sensors.md, hatched by the device that fails
plan_sheet.svg  sheet of the room of the examples, with the cameras of `rastercov place`
"""

import argparse
import base64
import re
import shutil
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

ROOT = Path(__file__).resolve().parent.parent
PLANS = ROOT / "examples" / "plans"


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=ROOT / "docs")
    out = parser.parse_args().out
    with TemporaryDirectory() as folder:
        work = Path(folder)
        run("demo", "--out", work / "demo")
        shutil.copy(work / "demo" / "zones.png", out / "demo.png")
        run("place", PLANS / "inspect_part.toml", "--out", work / "part")
        page = (work / "part" / "page.html").read_text()
        first = re.search(r'src="data:image/png;base64,([^"]+)"', page)
        (out / "placement.png").write_bytes(base64.b64decode(first[1]))
        page = (ROOT / "docs" / "sensors.md").read_text()
        (work / "fringe.toml").write_text(re.search(r"```toml\n(.*?)```", page, re.DOTALL)[1])
        turn = ["-p", "turntable:12@20", "--max-incidence-deg", 75]
        run("evaluate", "teapot", "-c", work / "fringe.toml", *turn, "-o", work / "scan")
        shutil.copy(work / "scan" / "overview.png", out / "sensors.png")
        room = PLANS / "watch_room.toml"
        run("place", room, "--out", work / "room")
        sheet = ["--north", 75, "--project", "Depot", "--customer", "Example Ltd"]
        sheet += ["--author", "A. Planner", "--revision", "A", "--out", out / "plan_sheet.svg"]
        run("sheet", room, "--poses", work / "room" / "poses.json", *sheet)


def run(*words):
    """Run a command of rastercov."""
    subprocess.run([sys.executable, "-m", "rastercov", *map(str, words)], check=True)


if __name__ == "__main__":
    main()
