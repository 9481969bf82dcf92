"""Report of sunlight: a page, a picture, a table of groups, the hours of faces.

sun.html        answer, picture, hours and energy by group, by month for a year
sun.png         the surface by hours of sun
view.html       the same in 3-D
sun.npz         figures of each face
sun.csv         hours and energy by part and group with their bounds
sun.json        the same, and the provenance
"""

import csv
import io
import re
from collections.abc import Callable, Mapping, Sequence
from datetime import datetime
from pathlib import Path
from typing import NamedTuple

import numpy as np

from rastercov.base import ByName, ReadByName, plural, write_bytes, write_json, write_text
from rastercov.base.format import text_with_bound
from rastercov.base.interrupts import hold_interrupts
from rastercov.base.output import write_npz
from rastercov.core.camera import Poses
from rastercov.core.coverage.provenance import provenance_of
from rastercov.light.sun import views_from
from rastercov.light.sunlight import Sunlight
from rastercov.report.folder import ReportFolder, ReportKind
from rastercov.report.modes import mode_picture
from rastercov.report.pages import Picture, render, view_page
from rastercov.report.printing import browser, write_page

SUN = ReportKind("sun", re.compile(r"sun\.(html|pdf|png|npz|csv|json)|view\.html"), last="sun.json")
ARRAYS = "hours", "hours_bound", "energy", "energy_bound"
"""Figures of faces, hours and Wh."""


class Study(NamedTuple):
    """Sunlight over a period.

    Attributes
    ----------
    ways : mapping of str to Sunlight
        By the middle of the sun, and where asked for by all and some of its disc; see `LIT_BY`.
    times : (N,) sequence of datetime
        Of its directions.
    period : str
        A day or a year in words.
    step : int
        Minutes from one time to the next.
    least : float or None
        Hours that each group must get.
    """

    ways: Mapping[str, Sunlight]
    times: Sequence[datetime]
    period: str
    step: int
    least: float | None

    def parts(self) -> list[ByName]:
        """Figures of outermost parts, then of groups, the least hours first."""
        directions = self.ways["middle"]
        groups = {group.name for group in directions.mesh.groups}
        months = np.array([time.month - 1 for time in self.times], np.int64)
        columns = {
            "hours": directions.part_hours,
            "bound_hours": directions.part_hours_bound,
            "energy_kwh": directions.part_energy / 1e3,
            "bound_kwh": directions.part_energy_bound / 1e3,
            "least_piece_hours": directions.least_hours,
            "least_piece_bound_hours": directions.least_hours_bound,
        }
        for way, each in self.ways.items():
            if way != "middle":
                columns[f"hours_lit_by_{way}"] = each.part_hours
                columns[f"bound_hours_lit_by_{way}"] = each.part_hours_bound
        rows = []
        for row, name in enumerate(directions.names):
            entry: ByName = {"name": name, "is_group": name in groups}
            entry |= {key: float(each[row]) for key, each in columns.items()}
            entry |= {
                "pieces": int(directions.n_pieces[row]),
                "least_piece_at": directions.least_at[row].tolist(),
            }
            if len(np.unique(months)) > 1:
                hours = directions.weights * directions.share[:, row]
                entry["hours_by_month"] = np.bincount(months, hours, 12).tolist()
            if self.least is not None:
                most = directions.least_hours[row] + directions.least_hours_bound[row]
                entry["reached"] = bool(most >= self.least)
            rows.append(entry)
        return sorted(rows, key=lambda each: (each["is_group"], each["least_piece_hours"]))

    def summary(self, options: ReadByName) -> ByName:
        """Content of `sun.json`; groups pass that get the least hours, within bounds."""
        directions, parts = self.ways["middle"], self.parts()
        groups = [each for each in parts if each["is_group"]]
        words = plural(len(groups), "group")
        ends = (chosen(groups, key=lambda each: each["hours"]) for chosen in (min, max))
        span = " to ".join(
            dict.fromkeys(text_with_bound(each["hours"], each["bound_hours"]) for each in ends)
        )
        answer = f"{span} h of sun (lit share of the silhouette, over time) for {words}"
        passed: bool | None = None
        if self.least is not None:
            n = sum(each["reached"] for each in groups)
            get = "gets" if 1 in (n, len(groups)) else "get"
            answer = f"{n} of {words} {get} {self.least:,g} h of sun or more"
            n_near = sum(
                abs(each["least_piece_hours"] - self.least) <= each["least_piece_bound_hours"]
                for each in groups
            )
            answer += f" ({n_near} to within half a --step)" if n_near else ""
            passed = n == len(groups)
        camera, poses = views_from(directions.directions, directions.mesh.bounds)
        return {
            "answer": f"{answer} {'on' if '-' in self.period else 'in'} {self.period}",
            "period": self.period,
            "step_min": self.step,
            "directions": len(directions.directions),
            "sun_hours": float(directions.weights.sum()),
            "least_hours": self.least,
            "passed": passed,
            "parts": parts,
            "run": provenance_of(directions.mesh, camera, poses, options=options),
        }


def _table(parts: Sequence[ReadByName]) -> str:
    """Parts as CSV, with a column for each number of a list."""
    lists = [key for key, each in parts[0].items() if isinstance(each, list)]
    rows = [
        {**part, **{f"{key}_{n}": x for key in lists for n, x in enumerate(part[key], 1)}}
        for part in parts
    ]
    columns = [key for key in rows[0] if key not in lists]
    file = io.StringIO()
    table = csv.DictWriter(file, columns, extrasaction="ignore", lineterminator="\n")
    table.writeheader()
    table.writerows(rows)
    return file.getvalue()


def write(
    made: Callable[[], Study], out: Path, options: ReadByName, *, pdf: bool
) -> tuple[Study, ByName]:
    """Make a study and write its report to a folder; the study, and the content of `sun.json`."""
    with ReportFolder(out, SUN) as folder:
        if pdf:
            browser()  # none fails before the work
        study = made()
        directions = study.ways["middle"]
        summary, mesh, hours = study.summary(options), directions.mesh, directions.hours
        picture = Picture.of("Hours of sun, from two sides", mode_picture("sun", mesh, hours))
        camera, poses = views_from(directions.directions[:0], mesh.bounds)
        title = f"Sunlight, {study.period}"
        view = view_page(title, mesh, camera, Poses.of(poses), [], {"sun": hours}, summary)
        text = render(
            "sunlight.html",
            "rastercov.light",
            title=title,
            heading=title,
            summary=summary,
            bounded=text_with_bound,
            picture=picture,
            view=view,
        )
        arrays = {f"hours_lit_by_{name}": each.hours for name, each in study.ways.items()}
        arrays |= {name: getattr(directions, name) for name in ARRAYS} | {"area_m2": mesh.areas}
        with hold_interrupts():
            write_bytes(folder.file("sun.png"), picture.light)
            write_page(folder, "sun", text, pdf=pdf)
            if view is not None:
                write_text(folder.file("view.html"), view)
            write_npz(folder.file("sun.npz"), **arrays)
            write_text(folder.file("sun.csv"), _table(summary["parts"]))
            write_json(folder.file("sun.json"), summary)
            folder.publish()
    return study, summary
