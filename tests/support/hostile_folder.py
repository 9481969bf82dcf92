"""A folder with a Python file for every module that a program could import by name.

Each of them writes its name and the program into a file when it is executed.
"""

import subprocess
import sys
from importlib.metadata import packages_distributions

INPUTS = {
    "camera.toml": "width = 96\nheight = 72\nfx = 90\nfy = 90\n",
    "part.obj": "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n",
    "part.step": "ISO-10303-21;\n",
    "plan.toml": """
[[meshes]]
built_in = "box"
[camera]
file = "camera.toml"
[[candidates]]
generator = "on_sphere"
count = 12
[selection]
goal = "fewest_cameras"
coverage = 0.2
of_reachable = true
[outputs]
page = false
""",
}
COMMANDS = (
    "convert model transforms.json",  # a COLMAP folder
    "evaluate part.obj -c camera.toml -p sphere:2 -o evaluated",
    "evaluate box -c camera.toml -p sphere:3 -o workers --pictures 0 --workers 2",
    "evaluate part.step -c camera.toml -p sphere:2 -o step",  # refused, by Open CASCADE
    "render box -c camera.toml -p sphere:1 -o drawn",
    "render box -c camera.toml -p sphere:1 -o gl --device surfaceless",
    "compare box -c camera.toml -p sphere:2 -o compared",
    "place plan.toml -o plan --workers 2",
    "check plan.toml -p model --pose-unit 1",
    "audit model part.obj --pose-unit 1 -o audited",
    "view box -c camera.toml -p sphere:2 --export page.html",
    "doctor",
    "validate markers -o markers",
    "demo --shape box --poses 2 -o demo",
)
"""Lines with every command, each with all that it reads."""
ENTRY = "import sys\nfrom rastercov.cli import main\nsys.argv[0] = 'rastercov'\nmain()\n"
SCRIPT = ".programs/rastercov"
MARK = """
import os, sys
with open({place!r}, "a") as file:
    file.write({name!r} + " in " + repr(sys.orig_argv) + os.linesep)
"""


def fill(folder):
    """Files named after the modules of Python, of all packages installed, and of ours."""
    (folder / SCRIPT).parent.mkdir()
    for name, text in {**INPUTS, SCRIPT: ENTRY}.items():
        (folder / name).write_text(text, encoding="utf-8")
    names = {*sys.stdlib_module_names, *packages_distributions(), "rastercov", "reference"}
    names |= {"sitecustomize", "usercustomize", "shaders"}
    for name in sorted(names):
        if name.isidentifier() and not (folder / name).exists():
            code = MARK.format(place=str(_place(folder)), name=name)
            (folder / f"{name}.py").write_text(code, encoding="utf-8")


def command(folder, words):
    """Run a command in a folder, as its script in a folder of programs does."""
    return subprocess.run(
        [sys.executable, folder / SCRIPT, *words], cwd=folder, capture_output=True, text=True,
        check=False, stdin=subprocess.DEVNULL, timeout=600,
    )  # fmt: skip


def executed(folder):
    """Lines that they wrote, one each time that one of them was executed."""
    return _place(folder).read_text().splitlines() if _place(folder).exists() else []


def _place(folder):
    return folder / "executed.txt"
