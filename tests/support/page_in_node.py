"""Node with the modules of the page by their bare names."""

import json
import shutil
import subprocess
from pathlib import Path

import pytest

import rastercov
from rastercov.report.pages import static_file

PAGE = Path(rastercov.__file__).parent / "page/web"
HERE = Path(__file__).parents[1] / "native/wasm"
NODE = shutil.which("node")
NEEDS_NODE = pytest.mark.skipif(NODE is None, reason="no Node; as root: apt-get install -y nodejs")


@pytest.fixture(scope="module")
def node(tmp_path_factory):
    """Runs a script of tests/native/wasm; gives the JSON of the lines that it prints."""
    return runner_in(tmp_path_factory.mktemp("node"))


def runner_in(folder):
    """The same, in an empty folder."""
    package = folder / "node_modules/rastercov"
    package.mkdir(parents=True)
    (package / "package.json").write_text('{"type": "module", "exports": {"./*": "./*"}}')
    for path in [*PAGE.glob("*.js"), *HERE.glob("*.mjs")]:
        target = folder if path.suffix == ".mjs" else package
        (target / path.name).write_bytes(path.read_bytes())
    for name in ("features.js", "texts.js"):
        (package / name).write_bytes(static_file(name))

    def run(script, *words):
        command = [NODE, str(folder / script), *map(str, words)]
        ended = subprocess.run(command, capture_output=True, text=True, check=False)
        assert ended.returncode == 0, ended.stderr[-600:]
        return [json.loads(line) for line in ended.stdout.splitlines()]

    return run
