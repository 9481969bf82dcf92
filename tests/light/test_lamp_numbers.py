"""Numbers of files of lamps: of 400 digits, beyond 1e100, or not finite: one line."""

import json
import re

import pytest
from lamp_files import area_lamp

import rastercov as rc

HUGE = ("9" * 400, "-" + "9" * 400, "1" + "0" * 400, "1.7e308", "-1.7e308")
LAMPS = area_lamp("5")


PLACES = list(re.finditer(r"(?<![\w.])\d[\w.-]*", LAMPS))


@pytest.mark.parametrize("number", HUGE, ids=["nines", "minus", "power", "most", "least"])
def test_a_huge_number_at_any_place_of_a_file_is_refused_with_the_name_of_its_entry(
    number, tmp_path
):
    path = tmp_path / "lamps.toml"
    for place in PLACES:
        path.write_text(LAMPS[: place.start()] + number + LAMPS[place.end() :])
        with pytest.raises(rc.CameraError) as caught:
            rc.load_lamps(path)
        line = str(caught.value)
        assert line.isprintable()
        name = LAMPS[: place.start()].rpartition("\n")[2].partition(" ")[0]
        assert f"{name}: expected a number within ±1e+100, got " in line


def test_a_huge_number_anywhere_in_a_gltf_is_one_line_and_no_warning(tmp_path):
    node = {"translation": [1, 2, 3], "rotation": [0, 0, 0, 1], "scale": [1, 1, 1]}
    lights = {"lights": [{"type": "point", "intensity": 5, "range": 10, "color": [1, 1, 1]}]}
    owner = {"light": 0}
    node["extensions"] = {"KHR_lights_punctual": owner}
    scene = {"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [node]}
    scene |= {
        "extensionsUsed": ["KHR_lights_punctual"],
        "extensions": {"KHR_lights_punctual": lights},
    }
    text, path = json.dumps(scene), tmp_path / "lights.gltf"
    path.write_text(text)
    assert len(rc.load_lamps(path)) == 1
    for place in re.finditer(r"(?<![\w.\"])\d+(?![\w.\"])", text):
        for number in (*HUGE, "1e200"):
            path.write_text(text[: place.start()] + number + text[place.end() :])
            with pytest.raises(rc.RastercovError) as caught:
                rc.load_lamps(path)
            line = str(caught.value)
            assert line.isprintable()
            assert re.search(
                r": [\w.]+: expected a number within ±1e\+100, got [^()]*; correct the file$", line
            )
