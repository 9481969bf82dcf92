"""Entries of files on the rules of a rig."""

from collections.abc import Mapping

from rastercov.base import ByName, CameraError, ReadByName, shown
from rastercov.core.camera import Gate, Rig
from rastercov.core.camera.rig import Inputs
from rastercov.core.camera.rule import (
    All,
    Rule,
    compile_rule,
    gate_of,
    limits_of,
    rule_of,
    rule_of_gate,
    rule_to_json,
)
from rastercov.core.camera.rule import Any as AnyOf
from rastercov.core.mesh.arrays import inverse

OF_RULE = ("rule", "k", "needs", *All.__dataclass_fields__)


class RuleEntries(Inputs):
    """Rules, see `rastercov.core.camera.rule`."""

    names = (*OF_RULE, "rigs")

    def add_entries(self, rig: Rig, entries: ReadByName) -> Rig:
        """See `Inputs`."""
        given = {name: entries[name] for name in OF_RULE if name in entries}
        if given and "rule" not in given:
            given = rule_to_json(rig.rule) | given
        if given:
            rig = rig._with(**compile_rule(rule_of(given), rig.names, rig.cameras))
        return rig._with(gates=_gates_of(rig, entries["rigs"])) if "rigs" in entries else rig

    def entries(self, rig: Rig) -> ByName:
        """See `Inputs`."""
        if rig.is_one and not isinstance(rig.rule, AnyOf):
            return rule_to_json(rig.rule)
        return {"rigs": _items(rig)} if rig.gates else {}

    def describe(self, rig: Rig) -> ByName:
        """See `Inputs`, and `page/live_rules.js`."""
        items = []
        for first, gate in rig.gates.items():
            (limits,) = limits_of([gate])
            devices = range(first, first + gate.n)
            rule, names = _rule_of(rig, first), _names_of(rig, first)
            noise = rule.noise_px if isinstance(rule, All) and limits.noise else {}
            items.append(
                {
                    "names": list(names),
                    "k": gate.k,
                    "needs": [int(row - first in gate.needs) for row in devices],
                    "least_deg": limits.least_deg,
                    "most_deg": limits.most_deg,
                    "most_deviation": limits.most_deviation,
                    "image_noise": [noise[name] for name in names if name in noise]
                    if isinstance(noise, Mapping)
                    else [noise] * gate.n,
                    "stripes": [int(row - first in limits.stripes) for row in devices],
                    "places": _places(rig, devices),
                }
            )
        return {"gates": items, "rigs": _items(rig)} if items else {}


def _items(rig: Rig) -> list[ByName]:
    """Entries of each rig: its cameras and its rule."""
    return [
        {"cameras": list(_names_of(rig, at)), **rule_to_json(_rule_of(rig, at))}
        for at in sorted(rig.gates)
    ]


def _names_of(rig: Rig, first: int) -> tuple[str, ...]:
    """Names of the cameras that measure together, by the first of them."""
    return rig.names[first : first + rig.gates[first].n]


def _rule_of(rig: Rig, first: int) -> Rule:
    """Rule of cameras that measure together."""
    if rig.is_one and not isinstance(rig.rule, AnyOf):
        return rig.rule
    (gate,) = limits_of([rig.gates[first]])
    return rule_of_gate(gate, _names_of(rig, first), rig.cameras[first : first + gate.n])


def _gates_of(rig: Rig, tables: object) -> dict[int, Gate]:
    """Rules of cameras that measure together, by the first of each, of `rigs` of a file."""
    if rig.gates or not isinstance(tables, list):
        raise CameraError(
            f"expected rigs to be a list of tables, and no rule beside it, got {shown(tables)}"
        )
    gates: dict[int, Gate] = {}
    end = 0
    for each in tables:
        own = each.get("cameras") if isinstance(each, Mapping) else None
        first = rig.names.index(own[0]) if own and own[0] in rig.names else len(rig)
        names = rig.names[first : first + len(own)] if isinstance(own, list) else ()
        if first < end or own != list(names) or not names:
            raise CameraError(
                "expected cameras of each rig to be consecutive names, in the order of the file, "
                f"got {shown(own)}"
            )
        end = first + len(names)
        rule = rule_of({name: value for name, value in each.items() if name != "cameras"})
        gate = gate_of(rule, names, rig.cameras[first:end])
        gates |= {} if gate is None else {first: gate}
    return gates


def _places(rig: Rig, rows: range) -> list[list[float]] | None:
    """Poses of some cameras of a rig on the first of them; None where one does not move with it."""
    if rig.is_fixed[rows].any():
        return None
    first_from_rig = inverse(rig.rig_from_camera[rows[0]])
    places: list[list[float]] = (
        (first_from_rig @ rig.rig_from_camera[rows]).reshape(-1, 16).tolist()
    )
    return places


HOOKS = RuleEntries()
