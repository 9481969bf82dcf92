"""Report of sunlight: a page, a picture, a table of groups, the hours of faces, a coloured mesh.

sun.html        answer, picture, hours and energy by group, by month for a year
sun.png         the surface by hours of sun
view.html       the same in 3-D
sun.npz         figures of each face
sun.glb         the surface coloured by hours of sun
sun.json        hours and energy by group with their bounds, and the provenance
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import KW_ONLY, dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np

from rastercov.base.format import number, plural
from rastercov.base.interrupts import interrupts_held
from rastercov.base.output import write_bytes, write_json, write_npz, write_text
from rastercov.camera.pose import Poses
from rastercov.camera.sun import views_from
from rastercov.coverage.provenance import provenance_of
from rastercov.coverage.sunlight import Sunlight
from rastercov.report.coverage_files import write_coloured_mesh
from rastercov.report.folder import ReportFolder, ReportKind
from rastercov.report.modes import mode_picture
from rastercov.report.pages import Picture, rendered, view_page
from rastercov.report.printing import browser, write_page

SUN = ReportKind("sun", re.compile(r"sun\.(html|pdf|png|npz|glb|json)|view\.html"), last="sun.json")
MONTHS = ["Jan", "Feb", "Mar", "Apr", "May", "Jun", "Jul", "Aug", "Sep", "Oct", "Nov", "Dec"]


@dataclass(frozen=True, eq=False)
class Study:
    """Sunlight over a period.

    Attributes
    ----------
    found : Sunlight
    by_all, by_some : Sunlight or None
        The same by all of the disc of the sun, and by some of it.
    times : (N,) sequence of datetime
        Of its directions.
    period : str
        A day or a year in words.
    step : int
        Minutes from one time to the next.
    least : float or None
        Hours that each group must get.
    """

    found: Sunlight
    by_all: Sunlight | None = None
    by_some: Sunlight | None = None
    _: KW_ONLY
    times: Sequence[datetime]
    period: str
    step: int
    least: float | None = None

    @property
    def passed(self) -> bool | None:
        """True where all groups get the least hours, within bounds; None where none are asked."""
        if self.least is None:
            return None
        groups = [each for each in self.parts() if each["is_group"]]
        return all(each["reached"] for each in groups)

    def parts(self) -> list[dict[str, Any]]:
        """Figures of groups and outermost parts, the least hours first."""
        found, groups = self.found, {group.name for group in self.found.mesh.groups}
        months = np.array([time.month - 1 for time in self.times], np.int64)
        rows = []
        for row, name in enumerate(found.names):
            hours = found.weights * found.share[:, row]
            bound = float(found.part_hours_bound[row])
            entry: dict[str, Any] = {"name": name, "is_group": name in groups}
            entry |= {"hours": float(found.part_hours[row]), "bound_hours": bound}
            for key, other in (("lit_by_all", self.by_all), ("lit_by_some", self.by_some)):
                if other is not None:
                    entry[f"hours_{key}"] = float(other.part_hours[row])
            entry["energy_kwh"] = float(found.part_energy[row]) / 1e3
            entry["bound_kwh"] = float(found.part_energy_bound[row]) / 1e3
            if len(set(months.tolist())) > 1:
                entry["hours_by_month"] = np.bincount(months, hours, 12).tolist()
            if self.least is not None:
                entry["reached"] = bool(entry["hours"] + bound >= self.least)
            rows.append(entry)
        return sorted(rows, key=lambda each: (each["is_group"], float(each["hours"])))

    @property
    def answer(self) -> str:
        """First line of the result."""
        groups = [each for each in self.parts() if each["is_group"]]
        if self.least is not None:
            n = sum(each["reached"] for each in groups)
            return (
                f"{n} of {plural(len(groups), 'group')} get {number(self.least)} h of sun or more, "
                f"{self.period}"
            )
        hours = [each["hours"] for each in groups] or [0.0]
        return (
            f"{number(min(hours))} to {number(max(hours))} h of sun on "
            f"{plural(len(groups), 'group')}, {self.period}"
        )

    def summary(self, options: Mapping[str, Any]) -> dict[str, Any]:
        """Content of `sun.json`."""
        found = self.found
        camera, poses = views_from(found.directions, found.mesh.bounds)
        return {
            "answer": self.answer,
            "period": self.period,
            "step_min": self.step,
            "directions": len(found.directions),
            "sun_hours": float(found.weights.sum()),
            "least_hours": self.least,
            "passed": self.passed,
            "parts": self.parts(),
            "run": provenance_of(found.mesh, camera, poses, options=options),
        }


def write(study: Study, out: Path, options: Mapping[str, Any], *, pdf: bool) -> dict[str, Any]:
    """Write the report of a study to a folder; the content of `sun.json`."""
    found, mesh = study.found, study.found.mesh
    with ReportFolder(out, SUN) as folder:
        if pdf:
            browser()  # none fails before the work
        summary = study.summary(options)
        image = mode_picture("sun", mesh, found.hours)
        picture = Picture.of(f"Hours of sun, {study.period}, from two sides", image)
        camera, poses = views_from(found.directions[:0], mesh.bounds)
        shown = {"sun": found.hours}
        view = view_page(study.period, mesh, camera, Poses.of(poses), [], shown, summary)
        text = rendered(
            "sunlight.html",
            title=f"Sunlight, {study.period}",
            heading=f"Sunlight, {study.period}",
            summary=summary,
            picture=picture,
            view=view,
            months=MONTHS,
        )
        with interrupts_held():
            write_bytes(folder.file("sun.png"), picture.light)
            write_page(folder, "sun", text, pdf=pdf)
            if view is not None:
                write_text(folder.file("view.html"), view)
            most = max(float(found.hours.max(initial=0.0)), 1e-300)
            write_coloured_mesh(folder.file("sun.glb"), mesh, found.hours / most)
            write_npz(folder.file("sun.npz"), **figures_of_faces(study))
            write_json(folder.file("sun.json"), summary)
            folder.publish()
    return summary


def figures_of_faces(study: Study) -> dict[str, np.ndarray[Any, Any]]:
    """Figures of each face."""
    found = study.found
    arrays = {
        "hours": found.hours,
        "hours_bound": found.hours_bound,
        "energy_wh": found.energy,
        "energy_bound_wh": found.energy_bound,
        "area_m2": np.asarray(found.mesh.areas),
    }
    for name, other in (("hours_lit_by_all", study.by_all), ("hours_lit_by_some", study.by_some)):
        if other is not None:
            arrays[name] = other.hours
    return arrays
