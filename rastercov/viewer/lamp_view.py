"""Lamps in the page."""

from typing import Any

from rastercov.camera.equipment import Equipment
from rastercov.camera.lamps import Lamps
from rastercov.viewer.scene import EquipmentView


class LampView(EquipmentView):
    """Lamps by their points and cones."""

    word, entry, modes, colour = "lamps", "light", ("lux",), (0.85, 0.55, 0.0)

    def units(self, own: Equipment) -> dict[str, str]:
        """See `EquipmentView`."""
        assert isinstance(own, Lamps)
        return dict.fromkeys(("min_illuminance", "max_illuminance"), own.unit)

    def piece(self, own: Equipment, row: int) -> dict[str, Any]:
        """See `EquipmentView`."""
        assert isinstance(own, Lamps)
        lamp = own.lamps[row]
        return {
            "half_angle_deg": lamp.half_angle_deg,
            "words": f"{lamp.kind}, {lamp.intensity_of_point * lamp.points:g} {lamp.unit}",
            "points": lamp.lamp_from_point[:, :3, 3].tolist(),
        }


HOOKS = LampView()
