"""A rig as built: photographs of its cameras, their poses, and what is covered now."""

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from rastercov.asbuilt.located import Located, Tolerance, locate
from rastercov.asbuilt.resection import difference, displaced
from rastercov.base import (
    ByName,
    ConfigError,
    FloatArray,
    IntArray,
    check_choice,
    first_of,
    plural,
    shown,
)
from rastercov.core.camera import Camera, Poses
from rastercov.core.camera.conventions import metres_per
from rastercov.core.mesh import Mesh
from rastercov.placement.plan import check as plan_check
from rastercov.placement.plan.baseline import NOTHING
from rastercov.placement.plan.check import Checked
from rastercov.placement.plan.file import Plan
from rastercov.placement.plan.outcome import Case, cases
from rastercov.placement.plan.phases import demand_of

PICTURES = (".jpg", ".jpeg", ".png", ".tif", ".tiff", ".bmp", ".webp")
"""Suffixes of photographs in a folder."""
APART = 3.0
"""Deviations by which poses of a rigid rig may differ from one displacement."""
OPEN = 1e6
"""Variance of a distance that is open, m^2."""
WITHIN = re.compile(r"(\d+\.?\d*) *(mm|cm|m) *, *(\d+\.?\d*) *(?:deg|degrees|°)")
"""A length and an angle."""


@dataclass(frozen=True)
class AsBuilt:
    """A rig as built.

    Attributes
    ----------
    planned, built : Checked
        The rig of the plan, and that in which located cameras have their poses as built.
    found : mapping of int to Located
        By the row of the camera in the rig.
    photos : mapping of int to Path
    tolerances : mapping of int to Tolerance
        Of each located camera: 1 % of its own distance, where nothing else is given.
    notes : tuple of str
        What could not be computed, and why.
    missing : tuple of str
        Cameras of a folder of photographs that have none, and did not move with one that has.
    """

    planned: Checked
    built: Checked
    found: Mapping[int, Located]
    photos: Mapping[int, Path]
    tolerances: Mapping[int, Tolerance]
    notes: tuple[str, ...] = ()
    missing: tuple[str, ...] = ()

    @property
    def verdicts(self) -> dict[int, str]:
        """Verdict "as planned", "moved" or "undecided" of each located camera."""
        return {row: self.tolerances[row].verdict(each) for row, each in self.found.items()}

    @property
    def is_located(self) -> bool:
        """True where a pose was found, without which nothing is known of the rig as built."""
        return any(each.accepted for each in self.found.values())

    @property
    def status(self) -> int:
        """0 where all located cameras are as planned, 1 where one has moved, otherwise 2."""
        verdicts = self.verdicts.values()
        return 1 if "moved" in verdicts else 2 * ("undecided" in verdicts or self.missing != ())

    def lines(self) -> list[str]:
        """The result in words: each camera, then what is lost."""
        said = [
            f"{self.planned.names[row]}: {verdict}; {self.tolerances[row].words(self.found[row])}"
            for row, verdict in self.verdicts.items()
        ]
        said += [f"{each}: undecided; no photograph" for each in self.missing]
        against, assured = self.built.against, self.built.assured
        known = not self.missing and all(each.accepted for each in self.found.values())
        none = "nothing is lost" if known else "what is lost is not known"
        said += against.losses() or [none] if against else []
        said += assured.lines() if assured else []
        return said + list(self.notes)

    def cases(self) -> list[Case]:
        """Each located camera, and requirements as built, for build servers."""
        items = [
            Case(
                f"pose of {self.planned.names[row]}",
                "" if verdict == "as planned" else verdict,
                [self.tolerances[row].words(self.found[row])],
            )
            for row, verdict in self.verdicts.items()
        ]
        items += [Case(f"pose of {each}", "undecided", ["no photograph"]) for each in self.missing]
        return items + cases(self.built)

    def to_json(self) -> ByName:
        """The record of `locate.json`."""
        against = self.built.against
        return {
            "status": ("as planned", "moved", "undecided")[self.status],
            "cameras": [
                {
                    "name": self.planned.names[row],
                    "photo": self.photos[row].name,
                    "verdict": self.verdicts[row],
                    "tolerance": self.tolerances[row].to_json(),
                    **each.to_json(),
                }
                for row, each in self.found.items()
            ],
            "requirements_planned": [each.words() for each in self.planned.requirements],
            "requirements_as_built": [
                each.words() for each in self.built.requirements if self.is_located
            ],
            "missing": self.missing,
            "lost": [] if against is None else against.losses(),
            **({"uncertain": self.built.assured.summary()} if self.built.assured else {}),
        }


def match_photographs(photo: Path, names: Sequence[str], camera: str | None) -> dict[int, Path]:
    """Photograph of each camera, by its row: one file of one camera, or a folder by file names.

    Raises
    ------
    ConfigError
        For a file without a camera, a camera that the rig does not have, and a folder without
        photographs, or with one of no camera, or with two of a camera.
    """
    if photo.is_dir():
        found: dict[int, Path] = {}
        pictures = [each for each in sorted(photo.iterdir()) if each.suffix.lower() in PICTURES]
        others = [each.name for each in pictures if each.stem not in names]
        if others or not pictures:
            raise ConfigError(
                f"{photo}: expected photographs named as cameras ({names[0]}.jpg, ...), got "
                f"{first_of(others) or 'none'}"
            )
        for each in pictures:
            row = names.index(each.stem)
            if row in found:
                raise ConfigError(
                    f"{photo}: expected one photograph of {each.stem}, got {found[row].name} "
                    f"and {each.name}; remove one"
                )
            found[row] = each
        return found
    if camera is None:
        if len(names) != 1:
            raise ConfigError(
                f"expected the camera of {photo.name} among {plural(len(names), 'camera')}, got "
                "none; name it with --of"
            )
        return {0: photo}
    choices = [*names, *(str(row + 1) for row in range(len(names)))]
    check_choice("--of", camera, choices)
    return {choices.index(camera) % len(names): photo}


def locate_rig(
    planned: Checked,
    photos: Mapping[int, Path],
    points: FloatArray | None,
    tolerance: Callable[[Located], Tolerance],
    pixel_error: float = 1.0,
    *,
    is_rigid: bool = False,
    is_all: bool = False,
) -> AsBuilt:
    """Poses as built of the cameras of a checked rig, and the rig checked with them.

    Cameras whose pose is undecided stay as planned. With `is_all` those without a photograph are
    `missing`, unless they follow others. Those of a rigid rig, and of each sensor head
    of the plan, move together, by the displacement that the decided ones have in common.
    """
    if points is not None and len(photos) > 1:
        raise ConfigError(f"expected one photograph for --points, got {len(photos)}")
    mesh, poses, cameras = scene_of(planned)
    found = {
        row: locate(mesh, cameras[row], photo, poses[row], points, pixel_error=pixel_error)
        for row, photo in photos.items()
    }
    missing = set(range(len(poses) * is_all)) - set(found)
    for rows in _heads(planned, is_rigid=is_rigid):
        own = {row: each for row, each in found.items() if row in rows}
        together, moved = _move_together(own, poses)
        found |= together
        missing -= set(rows.tolist() * (moved is not poses))  # they follow a decided one
        poses[rows] = moved[rows]
    for row, each in found.items():
        if each.accepted:
            poses[row] = each.pose
    placed = Poses.of(poses, camera=planned.cameras.placed.camera)
    built, notes = _check_built(planned, placed, found)
    tolerances = {row: tolerance(each) for row, each in found.items()}
    names = tuple(planned.names[row] for row in sorted(missing))
    return AsBuilt(planned, built, found, photos, tolerances, notes, names)


def _heads(planned: Checked, *, is_rigid: bool) -> list[IntArray]:
    """Rows of cameras that move together: all of a rigid rig, or those of each head of the plan.

    Those of a head follow each other in the rig, at the places that its mount gives them.
    """
    rig, placed = planned.plan.rig, planned.cameras.placed
    camera = placed.camera
    places = placed.world_from_camera @ np.linalg.inv(rig.rig_from_camera[camera])
    mounts = np.array([name.rpartition("/")[0] for name in rig.names])[camera]
    is_next = (mounts[1:] == mounts[:-1]) & (mounts[1:] != "") & (np.diff(camera) == 1)
    is_next &= np.isclose(places[1:], places[:-1], atol=1e-6).all(axis=(1, 2))
    head = np.cumsum(np.append(0, ~is_next)) * (not is_rigid)
    heads = (np.flatnonzero((head == each) & ~rig.is_fixed[camera]) for each in np.unique(head))
    return [rows for rows in heads if len(rows) > 1]


def _move_together(
    found: Mapping[int, Located], planned: FloatArray
) -> tuple[dict[int, Located], FloatArray]:
    """Cameras of a rigid rig, and all of its poses (P, 4, 4), by one displacement.

    It minimises the sum of the squares of the differences to the poses found, in standard
    deviations; their covariances grow where they disagree by more than one.
    """
    rows = [row for row, each in found.items() if each.accepted]
    if not rows:
        return dict(found), planned
    scales = {
        row: np.linalg.inv(
            np.linalg.cholesky(
                np.where(np.isinf(found[row].covariance), OPEN, found[row].covariance)
            )
        )
        for row in rows
    }
    first = planned[rows[0]]
    beside = np.linalg.inv(first) @ planned
    carried = {row: _carried(beside[row]) for row in found}
    jacobian = np.concatenate([scales[row] @ carried[row] for row in rows])
    for _ in range(10):
        parts = [scales[row] @ difference(found[row].pose, first @ beside[row]) for row in rows]
        apart = np.concatenate(parts)
        first = displaced(first, -np.linalg.lstsq(jacobian, apart, rcond=None)[0])
    excess = float((apart**2).sum()) / max(6 * len(rows) - 6, 1)
    if excess > APART**2:
        why = f"the cameras did not move as one: they differ by {excess**0.5:.2g} deviations"
        return {row: replace(each, accepted=False, why=why) for row, each in found.items()}, planned
    covariance = np.linalg.pinv(jacobian.T @ jacobian) * max(excess, 1.0)
    poses = first @ beside
    together = {
        row: replace(
            each,
            pose=poses[row],
            covariance=carried[row] @ covariance @ carried[row].T,
            accepted=True,
            why="",
        )
        for row, each in found.items()
    }
    return together, poses


def _carried(beside: FloatArray) -> FloatArray:
    """Steps (6, 6) of a camera for those of one beside which it is, each in its own axes."""
    turn, arm = beside[:3, :3].T, np.cross(np.eye(3), beside[:3, 3])
    return np.block([[turn, np.zeros((3, 3))], [turn @ arm.T, turn]])


def _check_built(
    planned: Checked, poses: Poses, found: Mapping[int, Located]
) -> tuple[Checked, tuple[str, ...]]:
    """A rig checked with its poses as built, under their uncertainty where that can be proved."""
    before = {**plan_check.record(planned), "file": "the plan", "tolerated": NOTHING}
    made = partial(
        plan_check.check,
        planned.plan,
        planned.poses_file,
        plan_check.limits(planned.plan, None, {}, may_be_none=True),
        planned.asked_views,
        poses=poses,
        baseline=before,
    )
    if (errors := errors_of(found)) is None:
        return made(), ()
    try:
        return made(demand=demand_of("tolerance", errors)), ()
    except ConfigError as error:
        return made(), (f"coverage is that of the poses found, without their uncertainty: {error}",)


def errors_of(found: Mapping[int, Located]) -> str | None:
    """Largest standard deviations of poses along and about any axis, as a text on tolerances."""
    known = [
        np.where(np.isinf(each.covariance), 0, each.covariance)  # distances of parallel rays
        for each in found.values()
        if each.accepted
    ]
    if not known:
        return None
    turn, place = [
        max(float(np.sqrt(np.linalg.eigvalsh(each[part, part]).max())) for each in known)
        for part in (slice(3), slice(3, 6))
    ]
    return f"{place * 1000:.3g} mm, {np.degrees(turn):.3g} deg, normal"


def tolerance_of(plan: Plan, within: str | None) -> Callable[[Located], Tolerance]:
    """Accepted deviation: that asked for, that of the plan, or 1 % of the distance and 1 degree."""
    if within is not None:
        match = WITHIN.fullmatch(within.strip())
        if match is None:
            raise ConfigError(
                '--within: expected a length and an angle, such as "10 mm, 0.5 deg", got '
                f"{shown(within)}"
            )
        given = Tolerance(float(match[1]) * metres_per(match[2]), float(match[3]))
        return lambda found: given
    asked = getattr(plan.selection, "tolerance", None)
    if asked is not None:
        times = 1.0 if asked.distribution == "uniform" else 3.0
        own = Tolerance(times * asked.position_mm / 1000, times * asked.angle_deg)
        return lambda found: own
    return lambda found: Tolerance(0.01 * found.distance, 1.0)


def scene_of(checked: Checked) -> tuple[Mesh, FloatArray, list[Camera]]:
    """Scene, poses and camera of each pose of a check."""
    placed = checked.cameras.placed
    cameras = [checked.plan.rig.cameras[row] for row in placed.camera.tolist()]
    mesh = checked.mesh if checked.scene is None else checked.scene
    return mesh, placed.world_from_camera.copy(), cameras
