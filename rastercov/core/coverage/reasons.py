"""Reasons of faces, points and zones that are not covered, with the words and colour of each.

A reason is one criterion where meeting it alone would cover the point or
face, otherwise the fewest that must be met together, of any camera, all of which are named. From
behind a face, and of what lies behind a camera, no other criterion has a value: these reasons are
of one criterion.
"""

from collections.abc import Iterable
from enum import IntEnum

import numpy as np

from rastercov.base import BoolArray, ByteArray, IntArray, WholeArray, hooks_of
from rastercov.core.coverage.task import CRITERIA_OF_TASK
from rastercov.core.coverage.words import Wording, Words


class _Several(IntEnum):
    """Numbers of which some are rows of several reasons, with their names."""

    @classmethod
    def _combine(cls, value: object) -> "_Several | None":
        """Member for several reasons."""
        if not isinstance(value, int | np.integer) or value not in range(
            FIRST_OF_SEVERAL, len(ROWS)
        ):
            return None
        made = int.__new__(cls, int(value))
        made._name_, made._value_ = ROWS[value].upper(), int(value)
        return made

    _missing_ = _combine


class Reason(_Several):
    """Criterion that a face fails; COVERED if it fails none.

    Where it fails several, its number is that of a row of `rastercov.core.coverage.reasons.NAMES`
    such as "too_oblique+occluded", and `Reason(number)` has this name. Criteria after one from
    BACK_FACING to UNSAMPLED, but OUT_OF_FOCUS, are not asked.

    A face is DEGENERATE if it has no area, BACK_FACING if the camera is behind it, OUTSIDE if a
    vertex is outside the image or nearer than the near plane, OUT_OF_FOCUS if it is not within the
    depth of field, UNSAMPLED if it is in view but no sample hits it, TOO_COARSE if it has too few
    pixels, or too few per metre, OCCLUDED if too much of it is occluded, and TOO_OBLIQUE if its
    angle of incidence is too large.

    Examples
    --------
    >>> import rastercov as rc
    >>> mesh = rc.shapes.box((0.2, 0.2, 0.2))
    >>> camera = rc.Camera.from_fov(640, 480, hfov_deg=60)
    >>> result = rc.evaluate(mesh, camera, rc.look_at((0.6, 0, 0), (0, 0, 0)))
    >>> int((result.reason == rc.Reason.BACK_FACING).sum())  # of 12 faces
    10
    >>> rc.Reason(result.reason[0, 2]).name
    'COVERED'
    """

    DEGENERATE = 0
    """The face has no area."""
    BACK_FACING = 1
    """The camera is behind it."""
    OUTSIDE = 2
    """A vertex is outside the image or nearer than the near plane."""
    OUT_OF_FOCUS = 3
    """It is not within the depth of field."""
    UNSAMPLED = 4
    """It is in view, but no sample hits it, or its image is within rounding error; its visibility
    is unknown."""
    TOO_COARSE = 5
    """Too few pixels, or too few per metre."""
    OCCLUDED = 6
    """Too much of it is occluded."""
    TOO_OBLIQUE = 7
    """Its angle of incidence is too large."""
    COVERED = 8
    """Every criterion holds."""


FIRST_OF_SEVERAL = Reason.COVERED + 1
TOGETHER = ("outside", "out_of_focus", "too_coarse", "occluded", "too_oblique")
"""Reasons of which a camera may have several; the bits of a row of several are in this order."""
SETS = sorted(
    (bits for bits in range(1 << len(TOGETHER)) if bits.bit_count() > 1),
    key=lambda bits: (-bits.bit_count(), bits),
)
"""Bits of the rows from `FIRST_OF_SEVERAL` on: the more criteria fail, the earlier."""
BETWEEN = "+"


class _Reasons(dict[str, Words]):
    """Words by the name of a reason; those of several reasons are made of theirs."""

    def __missing__(self, name: str) -> Words:
        names = name.split(BETWEEN)
        if len(names) < 2:
            raise KeyError(name)
        every = [self[each] for each in names]
        labels, sentences = [each.label for each in every], [each.sentence for each in every]
        advice = "no one change helps: another camera must meet all of these criteria"
        bits = sum(1 << TOGETHER.index(each) for each in names if each in TOGETHER)
        return Words(
            _text_list(labels),
            _text_list(sentences),
            advice,
            every[0].colour,
            bits or every[0].hatch,
        )


def _text_list(texts: list[str]) -> str:
    return f"{', '.join(texts[:-1])} and {texts[-1]}"


OF_CAMERA = {
    "degenerate": Words(
        "zero area", "have zero area", "a face of zero area cannot be covered", (84, 96, 100), 10
    ),
    "back_facing": Words(
        "back-facing",
        "are back-facing",
        "move the camera to the front of the face",
        (136, 84, 164),
        1,
    ),
    "outside": Words(
        "outside the image",
        "are not fully in the image",
        "rotate the camera towards it{wider}",
        (0, 114, 178),
        4,
    ),
    "out_of_focus": Words(
        "out of focus",
        "are out of focus",
        "its depth is {depth}, the depth of field {in_focus}: refocus or move the camera",
        (86, 180, 233),
        8,
    ),
    "unsampled": Words(
        "below sampling resolution",
        "are below the sampling resolution",
        "move the camera closer",
        (120, 94, 60),
        5,
    ),
    "too_coarse": Words(
        "resolution too low",
        "have too low a resolution",
        "{found} at {distance}; {wanted} needs a distance of {nearer} or {times} the focal length",
        (240, 160, 0),
        2,
    ),
    "occluded": Words(
        "occluded",
        "are occluded",
        "move the camera so that {hider} no longer blocks the view",
        (214, 39, 40),
        3,
    ),
    "too_oblique": Words(
        "too oblique",
        "are too oblique",
        "incidence {angle}°, at most {max_angle}° allowed: move the camera closer to the face "
        "normal",
        (0, 158, 115),
        12,
    ),
    "covered": Words("covered", "are covered", "", (214, 220, 226)),
}
"""Words of the members of `Reason`."""
REASONS: dict[str, Words] = _Reasons(OF_CAMERA)
for _bits in SETS:
    _names = [each for at, each in enumerate(TOGETHER) if _bits >> at & 1]
    _name = BETWEEN.join(reversed(_names))  # the last criterion first
    REASONS[_name] = REASONS[_name]
REASONS |= {
    "too_few_views": Words(
        "too few cameras",
        "are covered by too few cameras",
        "add cameras that see this surface",
        (230, 120, 180),
        6,
    ),
    "no_cameras": Words(
        "no cameras",
        "have no camera",
        "add a camera; if no candidate covers it, check unit, camera and thresholds",
        (218, 198, 176),
        9,
    ),
    "baseline": Words(
        "ray angle out of range",
        "have a ray angle out of range",
        "change the baseline of the rig or its distance",
        (150, 160, 60),
        7,
    ),
    "uncertain": Words(
        "too uncertain",
        "are too uncertain",
        "widen the baseline of the rig, move it closer, or use more pixels",
        (130, 20, 20),
        17,
    ),
    "unseeable": Words(
        "not visible from anywhere (proved)",
        "are not visible from anywhere (proved)",
        "it lies inside a body or touches another: exclude it from the evaluation",
        (150, 150, 158),
        16,
    ),
}
"""By the name of the reason: the members of `Reason`, in their order, several of these together,
those of networks, and those of features."""
OF_FEATURES: dict[str, Words] = {}
WORDINGS = (*hooks_of(Wording), *(each._wording for each in CRITERIA_OF_TASK))
"""Words of features, and of criteria of the surface."""
for _each in WORDINGS:
    OF_FEATURES |= _each.reasons
REASONS |= OF_FEATURES
NAMES = tuple(REASONS)
TOO_FEW_VIEWS, NO_CAMERAS = NAMES.index("too_few_views"), NAMES.index("no_cameras")
BASELINE, UNCERTAIN = NAMES.index("baseline"), NAMES.index("uncertain")
"""Rows of the reasons of a network, and of a rig with a rule."""
UNSEEABLE = NAMES.index("unseeable")
ROWS = NAMES
CRITERIA = (*map(NAMES.index, TOGETHER), BASELINE, UNCERTAIN, *map(NAMES.index, OF_FEATURES))
"""Rows of the reasons that are criteria, in the order in which they are asked; that of the surface
itself is one of those of features."""
SEVERAL = 1 << 31
"""Bit of the code of several reasons without a row of their own; lower bits are of `CRITERIA`."""
BITS = np.zeros(256, np.uint32)
"""Bits of the criteria of each row, 0 for the others."""
for _at, _row in enumerate(CRITERIA):
    BITS[_row] = 1 << _at
for _at, _bits in enumerate(SETS):
    BITS[FIRST_OF_SEVERAL + _at] = _bits
ROW_OF = {int(bits): row for row, bits in enumerate(BITS.tolist()) if bits}


def nearness(rows: WholeArray) -> IntArray:
    """Ranks of reasons by how near a camera with them is to covering: the more, the nearer."""
    from rastercov.engine import area_rule as kernels

    result, given = np.empty(rows.shape, np.int64), np.ascontiguousarray(rows, np.uint8)
    kernels.rank_reasons(given.ravel(), result.ravel())
    return result


def nearer(one: ByteArray, other: ByteArray) -> ByteArray:
    """Of two cameras the row of the one that is nearer to covering, (N,)."""
    return np.where(nearness(one) >= nearness(other), one, other)


def code_of(rows: Iterable[int]) -> int:
    """Code of reasons, rows of `REASONS`: a row where there is one of them together."""
    every = list(rows)
    bits = int(np.bitwise_or.reduce(BITS[every]))
    return every[0] if len(every) == 1 else ROW_OF.get(bits, SEVERAL | bits)


def bits_of(code: int) -> int:
    """Bits of the criteria of a code, in the order of `CRITERIA`."""
    return code & ~SEVERAL if code & SEVERAL else int(BITS[code])


def rows_in(code: int) -> tuple[int, ...]:
    """Rows of the single reasons of a code, the last criterion first."""
    bits = bits_of(code)
    values = tuple(row for at, row in enumerate(CRITERIA) if bits >> at & 1)
    return values[::-1] or (code,)


def name_of(code: int) -> str:
    """Name of the reasons of a code."""
    return BETWEEN.join(NAMES[row] for row in rows_in(code))


def leads(codes: WholeArray) -> ByteArray:
    """Row of each code, by which pictures have colours: that of the last criterion of several."""
    every, own = np.unique(codes, return_inverse=True)
    rows = [code if code < len(NAMES) else rows_in(code)[0] for code in every.tolist()]
    return np.array(rows, np.uint8)[own]


def reason_rows(reason: ByteArray, covered: BoolArray, n_cameras: int) -> ByteArray:
    """(F,) row of `REASONS` of each face of a network.

    Parameters
    ----------
    reason : (F,) uint8
        `Reason` of the camera that comes nearest to covering the face.
    covered : (F,) bool
        Faces that enough cameras cover.
    n_cameras : int
        Cameras of the network.
    """
    if not n_cameras:
        return np.full(len(reason), NO_CAMERAS, np.uint8)
    rows = np.where(reason == Reason.COVERED, np.uint8(TOO_FEW_VIEWS), reason)
    rows[covered] = Reason.COVERED
    return rows


CONDITIONS = {"the angle between rays": "baseline", "the uncertainty": "uncertain"}
"""Conditions that fail of a rig with a rule where no device does, and the reason of each."""


def fails(device: str, reason: str = "") -> str:
    """Words on a sensor, one of `CONDITIONS`, or a lamp, for which something is not covered.

    The reason is of what is not; those of features name lamps.
    """
    if device in CONDITIONS:
        return REASONS[CONDITIONS[device]].label
    return f"nearest or reflected lamp: {device}" if reason in OF_FEATURES else f"{device} fails"
