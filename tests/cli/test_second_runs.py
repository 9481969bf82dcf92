"""A second run of a command compiles nothing, and says nothing of it."""

import shlex
from pathlib import Path

import pytest
from commands import ENTRY
from notices import NOTICE
from processes import python

ROOT = Path(__file__).parents[2]
PLANS = ROOT / "examples" / "plans"
SCENE = "torus --camera khepra --poses sphere:3"
LENS = (
    "width = 320, height = 240, fx = 200, fy = 200, model = 'opencv', distortion = [-0.1, 0, 0, 0]"
)
COMMANDS = {
    "demo": "demo --shape box --poses 3 --out",
    "evaluate": f"evaluate {SCENE} --views 2 --out",
    "by_face": f"evaluate {SCENE} --by face --out",
    "sampled": f"evaluate {SCENE} --method sampled:cpu --out",
    "workers": f"evaluate {SCENE} --workers 2 --out",
    "lens": f'evaluate torus --camera "{LENS}" --poses sphere:3 --out',
    "render": f"render {SCENE} --device cpu --out",
    "place": f"place {PLANS / 'inspect_part.toml'} --out",
    "room": f"place {PLANS / 'watch_room.toml'} --out",
    "rig": f"place {PLANS / 'audit_rig.toml'} --out",
    "check": f"check {PLANS / 'audit_rig.toml'} --poses {PLANS / 'rig.json'} --junit",
}


@pytest.mark.slow
@pytest.mark.compile
@pytest.mark.parametrize("name", COMMANDS)
def test_no_second_run_says_that_it_compiles(name, tmp_path):
    for out in ("first", "second"):
        done = python("-c", ENTRY, *shlex.split(COMMANDS[name]), out, cwd=tmp_path, timeout=None)
        assert done.returncode in (0, 1), done.stderr
    assert NOTICE not in done.stderr
