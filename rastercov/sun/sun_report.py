"""Report of sunlight: a page, a picture, a table of groups, the hours of faces.

sun.html        answer, picture, hours and energy by group, by month for a year
sun.png         the surface by hours of sun
view.html       the same in 3-D
sun.npz         figures of each face
sun.csv         hours and energy by part and group with their bounds
sun.json        the same, and the provenance
"""

import math
import re
from collections.abc import Callable, Mapping, Sequence
from datetime import date, datetime, timedelta
from pathlib import Path
from typing import NamedTuple

import numpy as np

from rastercov.base import (
    BoolArray,
    ByName,
    FloatArray,
    ReadByName,
    dots,
    plural,
    sort_order,
    write_bytes,
    write_json,
    write_text,
)
from rastercov.base.format import exponent, text_with_bound
from rastercov.base.interrupts import hold_interrupts
from rastercov.base.output import csv_text, write_npz
from rastercov.core.camera import Poses
from rastercov.core.camera.parallel import SUN_RADIUS_DEG
from rastercov.core.camera.sun import views_from
from rastercov.core.coverage.shards import provenance_of
from rastercov.report.folder import ReportFolder, ReportKind
from rastercov.report.modes import mode_picture
from rastercov.report.openings import Openings, compass, levels_of
from rastercov.report.pages import Picture, render, view_page
from rastercov.report.panorama import Marks
from rastercov.report.printing import browser, write_page
from rastercov.sun.sunlight import Sunlight, step_error

SUN = ReportKind("sun", re.compile(r"sun\.(html|pdf|png|npz|csv|json)|view\.html"), last="sun.json")
ARRAYS = "hours", "hours_bound", "energy", "energy_bound"
"""Figures of faces, hours and Wh."""
LEVELS = {"minimum": 1.5, "medium": 3.0, "high": 4.0}
"""Hours of the levels of exposure to sunlight, EN 17037."""
DISC_HOURS = SUN_RADIUS_DEG / 15
"""Hours in which the radius of the sun passes an edge across its path."""
LEAST_ERROR = 0.005
"""Hours from which on an error is printed."""
LIT = 1 - 1e-9
"""Lit share from which on nothing shades a piece."""
MOST_SHADING, MOST_MARKS = 3, 100
"""Groups that are named as shading a piece, and pieces that pictures number."""
POINTS, MOST_RAYS = 32, 4_000_000
"""Points of a piece from which what shades it is looked for, and rays at most."""


class Study(NamedTuple):
    """Sunlight over a period.

    Attributes
    ----------
    ways : mapping of str to Sunlight
        By the middle of the sun, and where asked for by all and some of its disc; see `LIT_BY`.
    times : (N,) sequence of datetime
        Of its directions.
    starts : (N,) bool
        Directions after a night.
    period : str
        A day or a year in words.
    step : int
        Minutes from one time to the next.
    least : float or None
        Hours that each piece must get.
    level : str
        Level of EN 17037 whose hours they are, one of `LEVELS`; each room must get them.
    north : float
        Direction of north, degrees from +x towards +y.
    is_fine : bool
        True where faces are divided, and are shown by themselves.
    diffuse : list of dict, optional
        Diffuse energy on groups, of a year of weather.
    """

    ways: Mapping[str, Sunlight]
    times: Sequence[datetime]
    starts: BoolArray
    period: str
    step: int
    least: float | None
    level: str
    north: float
    is_fine: bool
    diffuse: list[ByName] | None = None

    def parts(self) -> list[ByName]:
        """Figures of outermost parts, then of groups, the least hours first."""
        sunlit = self.ways["middle"]
        groups = {group.name for group in sunlit.mesh.groups}
        months = np.array([time.month - 1 for time in self.times], np.int64)
        columns = {
            "hours": sunlit.part_hours,
            "bound_hours": sunlit.part_hours_bound,
            "energy_kwh": sunlit.part_energy / 1e3,
            "bound_kwh": sunlit.part_energy_bound / 1e3,
            "least_piece_hours": sunlit.pieces.hours[sunlit.least],
            "least_piece_bound_hours": sunlit.pieces.hours_bound[sunlit.least],
        }
        for way, each in self.ways.items():
            if way != "middle":
                columns[f"hours_lit_by_{way}"] = each.part_hours
                columns[f"bound_hours_lit_by_{way}"] = each.part_hours_bound
        errors, rows = self._errors(self._every()), list[ByName]()
        for row, name in enumerate(sunlit.names):
            entry: ByName = {"name": name, "is_group": name in groups}
            entry |= {key: float(each[row]) for key, each in columns.items()}
            at = sunlit.pieces.at[sunlit.least[row]].tolist()
            entry |= {"pieces": len(sunlit.part_pieces[row]), "least_piece_at": at}
            if len(np.unique(months)) > 1:
                hours = sunlit.weights * sunlit.share[:, row]
                entry["hours_by_month"] = np.bincount(months, hours, 12).tolist()
            if self.least is not None:
                own = self._entry(name, entry["least_piece_hours"], errors[sunlit.least[row]])
                entry["reached"] = own["verdict"] == "yes"
            rows.append(entry)
        return sorted(rows, key=lambda each: (each["is_group"], each["least_piece_hours"]))

    def _every(self) -> list[FloatArray]:
        """Hours of the pieces and their bounds, (2, M), by the ways."""
        return [np.stack((e.pieces.hours, e.pieces.hours_bound)) for e in self.ways.values()]

    def _errors(self, values: Sequence[FloatArray]) -> FloatArray:
        """Errors of hours and bounds, (2, M), by the ways, that count the step and the disc.

        Without the ways of the disc it takes `DISC_HOURS` at each change of the light.
        """
        (hours, bound), *disc = values
        if disc:
            (whole, of_whole), (some, of_some) = disc
            return np.maximum(np.maximum(hours - whole + of_whole, some + of_some - hours), bound)
        return bound * (1 + 2 * DISC_HOURS / (self.step / 60))

    def _entry(self, name: str, hours: float, error: float) -> ByName:
        """Figures of a piece or room, and whether it gets enough."""
        entry: ByName = {"name": name, "hours": float(hours), "error_hours": float(error)}
        if self.least is not None:
            is_sure = abs(hours - self.least) >= error
            entry["verdict"] = ("yes" if hours >= self.least else "no") if is_sure else "open"
        return entry

    def pieces(self) -> tuple[list[ByName], list[ByName], Openings]:
        """Figures of pieces, and of rooms, the least hours first; pieces in that order."""
        sunlit = self.ways["middle"]
        openings = Openings(sunlit.mesh, sunlit.pieces.of_face, sunlit.pieces.at)
        normals, rooms = openings.sides()
        errors, names = self._errors(self._every()), openings.names(rooms)
        faces = compass(normals, self.north)
        is_before = (sunlit.directions @ normals.T > 0) | ~normals.any(axis=1)
        is_before &= sunlit.weights[:, None] > 0
        shading, points = self._shading(openings, normals, is_before), openings.prescribed(rooms)
        entries = list[ByName]()
        for row in sort_order(sunlit.pieces.hours).tolist():
            entry = self._entry(names[row], sunlit.pieces.hours[row], errors[row])
            entry |= {"number": len(entries) + 1, "row": row, "room": rooms[row]}
            entry |= {"faces": faces[row], "at": sunlit.pieces.at[row].tolist()}
            entry["energy_kwh"] = float(sunlit.pieces.energy[row]) / 1e3
            entry["bound_kwh"] = float(sunlit.pieces.energy_bound[row]) / 1e3
            entry["hours_in_front"] = float(sunlit.weights @ is_before[:, row])
            entry |= {"shaded_by": shading[row], "point": points[row]}
            entries.append(entry)
        of_rooms, of_room = [], openings.are_of_rooms()
        for name in dict.fromkeys(filter(None, rooms)):
            own = [each for each in entries if each["room"] == name and of_room[each["row"]]]
            if not own:
                continue
            figures = [self._of_union(each, [e["row"] for e in own]) for each in self.ways.values()]
            entry = self._entry(
                ", ".join(name.split("/")), float(figures[0][0]), float(self._errors(figures))
            )
            of_rooms.append(entry | {"pieces": [each["number"] for each in own]})
        return entries, sorted(of_rooms, key=lambda each: each["hours"]), openings

    def clock(self, rows: Sequence[int]) -> list[str]:
        """Zone, and first and last sun above the least elevation, then on pieces; "" by a year.

        To within a step, whose middles `times` are.
        """
        if len({time.date() for time in self.times}) != 1:
            return [""] * (2 + len(rows))
        half, sunlit = timedelta(minutes=self.step / 2), self.ways["middle"]
        is_lit = (sunlit.pieces.share > sunlit.pieces.share_bound).T[list(rows)]
        is_lit = np.insert(is_lit, 0, True, axis=0) & (sunlit.weights > 0)
        every = [[self.times[at] for at in np.flatnonzero(each).tolist()] for each in is_lit]
        return [f"{self.times[0]:%Z}"] + [
            f"{lit[0] - half:%H:%M} to {lit[-1] + half:%H:%M}" if lit else "-" for lit in every
        ]

    def _of_union(self, sunlit: Sunlight, rows: list[int]) -> FloatArray:
        """Hours, and their bound, of the piece of the largest lit share at each time."""
        share, bound, turned = (
            each[:, rows].max(axis=1, keepdims=True) for each in sunlit.pieces[5:8]
        )
        error = step_error(share[None], self.step / 60, self.starts, turned)[0]
        return np.array((sunlit.weights @ share, sunlit.weights @ bound + error))[:, 0]

    def _shading(
        self, openings: Openings, normals: FloatArray, is_before: BoolArray
    ) -> list[list[ByName]]:
        """Hours that each group shades each piece from a sun in front of it, the most first.

        By what is first from points of the piece that are in shade; its reveal is apart.
        """
        sunlit, mesh = self.ways["middle"], openings.mesh
        time, row = np.nonzero(is_before & (sunlit.pieces.share < LIT))
        n = min(max(MOST_RAYS // max(len(time), 1), 1), POINTS)
        starts = openings.points(normals, n)[row].reshape(-1, 3)
        rays, of = np.repeat(sunlit.directions[time], n, axis=0), np.repeat(np.arange(len(time)), n)
        face = openings.first_faces(starts, rays)
        met = np.flatnonzero(face >= 0)
        starts, rays, of, face = starts[met], rays[met], of[met], face[met]
        with np.errstate(divide="ignore", invalid="ignore"):
            away = dots(mesh.normals[face], mesh.vertices[mesh.faces[face, 0]] - starts)
            places = starts + (away / dots(mesh.normals[face], rays))[:, None] * rays
        is_own = openings.of_reveal(row[of], places, normals)
        keys = (row[of] * len(mesh.groups) + mesh.face_group[face]) * 2 + is_own
        hours = sunlit.weights[time] * (1 - sunlit.pieces.share[time, row])
        hours /= np.maximum(np.bincount(of, minlength=len(time)), 1)
        known, at = np.unique(keys, return_inverse=True)
        sums, items = np.bincount(at, hours[of]), [list[ByName]() for _ in openings.at]
        for each in sort_order(-sums).tolist():
            piece, key = divmod(int(known[each]), 2 * len(mesh.groups))
            name = ", ".join(levels_of(mesh, key // 2)) + " (reveal)" * (key % 2)
            items[piece].append({"name": name, "hours": float(sums[each])})
        return [each[:MOST_SHADING] for each in items]

    def colours(self) -> FloatArray:
        """(F,) hours that a picture shows: those of pieces, or of faces where there is one piece.

        Of faces, too, if they are divided.
        """
        sunlit = self.ways["middle"]
        if self.is_fine or len(sunlit.pieces.hours) < 2:
            return sunlit.hours
        return np.append(sunlit.pieces.hours, 0.0)[sunlit.pieces.of_face]

    def summary(self, options: ReadByName) -> tuple[ByName, Openings]:
        """Content of `sun.json`; pieces, or rooms, pass that surely get the least hours."""
        sunlit, parts = self.ways["middle"], self.parts()
        pieces, rooms, openings = self.pieces()
        groups = [each["name"] for each in parts if each["is_group"]]
        noun = "window" if all("window" in name.casefold() for name in groups) else "piece"
        noun = "group" if noun == "piece" and len(pieces) == len(groups) else noun
        judged, noun = (rooms, "room") if self.level and rooms else (pieces, noun)
        words = plural(len(judged), noun)
        ends = (judged[0], judged[-1]) if judged else ()
        span = " to ".join(dict.fromkeys(hours_text(each) for each in ends))
        answer = f"{span} h of sun (lit share of the silhouette, over time) for {words}"
        passed: bool | None = None
        if self.least is not None:
            verdicts = [each["verdict"] for each in judged]
            n, n_open = verdicts.count("yes"), verdicts.count("open")
            get = "gets" if 1 in (n, len(judged)) else "get"
            answer = f"{n} of {words} {get} {self.least:,g} h of sun or more"
            answer += f" ({n_open} undecided: a smaller --step decides)" if n_open else ""
            passed = n == len(judged)
        camera, poses = views_from(sunlit.directions, sunlit.mesh.bounds)
        summary = {
            "answer": f"{answer} {'on' if '-' in self.period else 'in'} {self.period}",
            "period": self.period,
            "step_min": self.step,
            "directions": len(np.flatnonzero(sunlit.weights)),
            "sun_hours": float(sunlit.weights.sum()),
            "least_hours": self.least,
            "level": self.level,
            "passed": passed,
            "noun": noun,
            "pieces": pieces,
            "rooms": rooms,
            "parts": parts,
            "run": provenance_of(sunlit.mesh, camera, poses, options=options),
        }
        return summary | ({} if self.diffuse is None else {"diffuse": self.diffuse}), openings


def hours_text(entry: ReadByName) -> str:
    """Hours with their error in the digits that it leaves, such as "3.5 ± 0.2"."""
    hours, error = entry["hours"], entry["error_hours"]
    digits = max(-exponent(error), 0) if error > LEAST_ERROR else 2
    unit = 10.0**-digits
    shown = f"{math.ceil(error / unit) * unit:.{digits}f}"
    return f"{hours:.{digits}f} ± {shown}" if error > LEAST_ERROR else text_with_bound(hours, unit)


def _table(parts: Sequence[ReadByName]) -> str:
    """Parts as CSV, with a column for each number of a list."""
    lists = [key for key, each in parts[0].items() if isinstance(each, list)]
    rows = [
        {**part, **{f"{key}_{n}": x for key in lists for n, x in enumerate(part[key], 1)}}
        for part in parts
    ]
    return csv_text([key for key in rows[0] if key not in lists], rows)


def write(
    made: Callable[[], Study], out: Path, options: ReadByName, *, pdf: bool
) -> tuple[Study, ByName]:
    """Make a study and write its report to a folder; the study, and the content of `sun.json`."""
    with ReportFolder(out, SUN) as folder:
        if pdf:
            browser()  # none fails before the work
        study = made()
        sunlit = study.ways["middle"]
        (summary, openings), mesh, hours = study.summary(options), sunlit.mesh, study.colours()
        order = [each.pop("row") for each in summary["pieces"]]
        numbers = (sort_order(order) + 1).tolist()
        marks = Marks([str(each) for each in numbers], sunlit.pieces.of_face) if order[1:] else None
        image = mode_picture("sun", mesh, hours, marks=marks, unit="m")
        picture = Picture.of("Hours of sun, from two sides", image)
        names = [summary["pieces"][each - 1]["name"] for each in numbers]
        has_plans = 1 < len(order) <= MOST_MARKS
        plans = openings.plans(numbers, names, study.north) if has_plans else []
        camera, poses = views_from(sunlit.directions[:0], mesh.bounds)
        title = f"Sunlight, {study.period}"
        view = view_page(title, mesh, camera, Poses.of(poses), [], {"sun": hours}, summary)
        text = render(
            "sunlight.html",
            "rastercov.sun",
            title=title,
            today=date.today(),
            summary=summary,
            bounded=text_with_bound,
            hours_text=hours_text,
            picture=picture,
            clock=study.clock(order),
            plans=[(each["title"], render("floor_plan.svg", plan=each)) for each in plans],
            view=view,
        )
        arrays = {f"hours_lit_by_{name}": each.hours for name, each in study.ways.items()}
        arrays |= {name: getattr(sunlit, name) for name in ARRAYS} | {"area_m2": mesh.areas}
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
