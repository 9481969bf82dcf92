"""A file of lamps with a number in every kind of entry, for tests and attacks on readers."""


def area_lamp(ambient):
    """A file of lamps: an ambient light, as TOML, an exposure and two places of a lamp of size."""
    return f"""ambient = {ambient}
[exposure]
exposure_time = 0.01
f_number = 4.0
pixel_size = 3e-6
full_well = 1e4
quantum_efficiency = 0.6
[lamps.key]
kind = "area"
size = [0.5, 0.2]
points = 4
intensity_cd = 900
positions = [[1, 2, 3], [2, 2, 3]]
aim = [0, 0, 0]
share = 0.5
"""
