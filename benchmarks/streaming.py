"""10,000 poses x 10,000 faces evaluated to a report: peak memory, time, size of the table."""

import tempfile
import time
from pathlib import Path

import pyarrow.parquet as pq
from contest import peak_of
from rows import Report, arguments

import rastercov as rc
from rastercov.core.mesh import shapes
from rastercov.report.coverage import Options, run


def main() -> None:
    parser = arguments(__doc__)
    parser.add_argument("--poses", type=int, default=10_000)
    parser.add_argument("--side", type=int, default=256, help="image side in pixels")
    args = parser.parse_args()
    mesh = shapes.torus()
    camera = rc.Camera(width=args.side, height=args.side, fx=1.2 * args.side, fy=1.2 * args.side)
    poses = rc.sphere_of_poses((0, 0, 0), 4.2, args.poses)
    report = Report()
    before = peak_of("self")
    with tempfile.TemporaryDirectory() as folder:
        started = time.perf_counter()
        options = Options(pictures=4, table="seen")
        summary = run(mesh, camera, poses, rc.Task(), Path(folder), options)
        seconds = time.perf_counter() - started
        table = Path(folder) / "coverage.parquet"
        rows = pq.ParquetFile(table).metadata.num_rows
        size = table.stat().st_size / 2**20
    report.check("every pose is in the summary", summary["poses"] == args.poses)
    report.add("peak memory over an idle process", peak_of("self") - before, "MiB", at_most=400)
    report.add("peak memory", peak_of("self"), "MiB")
    report.add("time, report included", seconds, "s")
    report.add("rows of the table", rows, "rows")
    report.add("size of the table", size, "MiB")
    report.finish(args.json)


if __name__ == "__main__":
    main()
