"""Shards that tell which device their process opens, of two GPUs that are stand-ins."""

import json

from rastercov.gl import devices

FUNCTION = "devices_of_worker:make"
LISTED = [
    devices.DeviceInfo("egl-device", index, f"GPU {index}", is_software=False) for index in (0, 1)
]


def make(folder, number, chosen):
    devices.egl_devices = lambda: LISTED
    asked = "auto", "egl", "hardware", "egl:0", 1
    return json.dumps([devices.candidates(each)[0][0].label for each in asked]).encode()
