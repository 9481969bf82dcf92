"""Coverage from any program: a client of `rastercov serve --stdio` for Python 3.9, without numpy.

python3 examples/serve_client.py [PLAN.toml RIG.json]
"""

import array
import ast
import json
import shutil
import struct
import subprocess
import sys
import tempfile
from pathlib import Path

PLAN = {"meshes": [{"built_in": "teapot-5"}], "camera": {"preset": "khepra"}}
DOWN = [[1, 0, 0, 0], [0, -1, 0, 0], [0, 0, -1, 0.6], [0, 0, 0, 1]]  # 0.6 m above, looking down
FOUND = shutil.which("rastercov")
OWN = [FOUND] if FOUND else [sys.executable, "-m", "rastercov"]


class Coverage:
    """A process of rastercov; `ask` sends a request and returns its result."""

    def __init__(self, command=(*OWN, "serve", "--stdio")):
        pipe = subprocess.PIPE
        self.process = subprocess.Popen(command, stdin=pipe, stdout=pipe, encoding="utf-8")

    def ask(self, verb, **entries):
        """Result of a request."""
        self.process.stdin.write(json.dumps({"do": verb, **entries}) + "\n")
        self.process.stdin.flush()
        line = self.process.stdout.readline()
        if not line:
            raise OSError(f"rastercov ended with exit code {self.process.wait()}")
        answer = json.loads(line)
        if "error" in answer:
            raise ValueError("\n".join(answer["error"]))
        return answer["result"]

    def close(self):
        """End the process; its exit code."""
        self.process.stdin.close()
        self.process.stdout.close()
        return self.process.wait()


def read_npy(path):
    """Values of an array of doubles, row by row."""
    data = Path(path).read_bytes()
    (size,) = struct.unpack_from("<H", data, 8)
    header = ast.literal_eval(data[10 : 10 + size].decode("latin-1"))
    if header["descr"] != "<f8" or header["fortran_order"]:
        raise ValueError(f"{path}: expected doubles, row by row, got {header}")
    return array.array("d", data[10 + size :])


def main(plan=PLAN, poses=DOWN):
    coverage = Coverage()
    scene = coverage.ask("open", plan=plan)
    with tempfile.TemporaryDirectory() as folder:
        covered = coverage.ask("evaluate", poses=poses, arrays=folder)["covered_area"]
        areas = read_npy(Path(folder) / "area.npy")[: scene["faces"]]
    print(f"{covered['percent']:.3f} % of {covered['of_m2']:.4f} m2 is covered")
    print(f"{len(areas)} faces: {sum(areas):.6f} m2, within {covered['bound_m2']:.1e} m2")
    return coverage.close()


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
