"""Faults and oddities of a mesh that may affect results, and its size, as text."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rastercov.base.format import plural
from rastercov.mesh.topology import Topology


def size_in_words(extent: ArrayLike) -> str:
    """Lengths in metres as text, such as "85 x 62 x 20 m": three digits, one unit for all."""
    lengths = np.atleast_1d(np.asarray(extent, dtype=np.float64))
    largest = float(lengths.max())
    unit, factor = next(
        (each for each in (("m", 1.0), ("mm", 1e3)) if largest * each[1] >= 1), ("µm", 1e6)
    )
    digits = int(np.clip(2 - np.floor(np.log10(largest * factor)), 0, 2)) if largest > 0 else 0
    return " x ".join(_rounded(length * factor, digits) for length in lengths) + f" {unit}"


def _rounded(value: float, digits: int) -> str:
    """`value` with at most these decimals and no zeros at their end."""
    text = f"{value:,.{digits}f}"
    return text.rstrip("0").rstrip(".") if "." in text else text


def surface_faults(
    topology: Topology,
    inside_out: NDArray[np.bool_] | None,
    self_contact: NDArray[np.bool_] | None,
) -> list[str]:
    """One line for each fault that the edges of a surface show.

    `inside_out`, (C,), is looked at if the surface is closed and consistently wound, and
    `self_contact`, (F,), if it also encloses positive volume; None otherwise.
    """
    found = []
    if topology.n_boundary_edges:
        found.append(f"open surface: {topology.n_boundary_edges} boundary edges")
    if topology.n_nonmanifold_edges:
        found.append(f"{topology.n_nonmanifold_edges} edges have more than two faces")
    if topology.n_inconsistent_edges:
        share = topology.n_inconsistent_edges / topology.n_shared_edges
        found.append(
            f"inconsistent winding at {topology.n_inconsistent_edges} of "
            f"{topology.n_shared_edges} shared edges ({share:.1%}); declare groups two_sided"
        )
    if inside_out is not None and inside_out.any():
        found.append(
            f"inside out: {inside_out.sum()} of {len(inside_out)} closed components enclose no "
            "positive volume (a cavity does that, too)"
        )
    if self_contact is not None and self_contact.any():
        found.append(
            f"the closed surface cuts or touches itself at {plural(self_contact.sum(), 'face')}, "
            f"face {self_contact.argmax()} among them: its back may show"
        )
    return found
