"""Plans as mappings: what a placement of them is, and the files that it reads and writes."""

import json
from pathlib import Path

import rastercov as rc


def write_obj(path, mesh, groups=()):
    """A mesh as OBJ; `groups` is the first face of each group by its name."""
    starts = {face: name for name, face in dict(groups).items()}
    lines = ["v {!r} {!r} {!r}".format(*point) for point in mesh.vertices.tolist()]
    for row, face in enumerate((mesh.faces + 1).tolist()):
        lines += [f"g {starts[row]}"] if row in starts else []
        lines.append("f {} {} {}".format(*face))
    Path(path).write_text("\n".join(lines))


def placed(plan, **sections):
    """Placement of a plan with other sections, whose report is in the folder `out`."""
    return rc.place(plan | sections, out="out")


def told(name="plan.json"):
    """Content of a file of that report."""
    return json.loads(Path("out", name).read_text())
