"""Lamps as equipment of rigs."""

from os import PathLike

from rastercov.base import CameraError, ReadByName, shown
from rastercov.core.camera import Cameras, EquipmentKind, equipment_on
from rastercov.core.mesh.site import NOWHERE, Site
from rastercov.light.lamp_file import load_lamps
from rastercov.light.lamps import Lamps, lamps_of_json


def lamps_of(cameras: Cameras) -> Lamps | None:
    """Lamps that must light what cameras see; None where light does not count."""
    entry = equipment_on(cameras).get("lamps")
    assert isinstance(entry, Lamps | None)
    return entry


class LampKind(EquipmentKind):
    """Lamps, see `Lamps`."""

    word = "lamps"
    help = "Lamp file (.toml, .json, .glb); a covered point must also be lit; see docs/light.md."
    entry = "light"

    def of(self, given: object, site: Site = NOWHERE) -> Lamps:
        """See `EquipmentKind`."""
        lamps = load_lamps(given, site) if isinstance(given, str | PathLike) else given
        if not isinstance(lamps, Lamps):
            raise CameraError(
                f"expected lamps to be Lamps or a file, got {shown(lamps)}; correct it"
            )
        return lamps

    def of_json(self, entries: ReadByName) -> Lamps:
        """See `EquipmentKind`."""
        return lamps_of_json(entries)


HOOKS = LampKind()
