"""What every command prints with --json has the form of docs/answers.schema.json.

It is all that a process prints on standard output, what libraries in C print themselves included.
"""

import ctypes
import json
from pathlib import Path

import numpy as np
import pytest
from commands import call
from nightly import nightly
from of_features import of_features
from reader import write_files
from short_search import short_search  # noqa: F401 # a fixture for every test

from rastercov.cli.console import COMMANDS, LazyCommand

SCHEMA = json.loads(
    (Path(__file__).parents[2] / "docs" / "answers.schema.json").read_text(encoding="utf-8")
)
SCENE = "evaluate part.ply -c camera.toml -p poses.json --device cpu"
LINES = {
    "demo": "demo --shape box --poses 2 --device cpu",
    "evaluate": SCENE,
    "evaluate, nothing seen": "evaluate room -c khepra -p sphere:2",
    "evaluate, no poses": "evaluate part.ply -c camera.toml -p none.npy",
    "evaluate, by face": f"{SCENE} --by face --method sampled",
    "evaluate, parts and views": "evaluate as1.obj -c l=l.yaml -c r=r.yaml -p named.json --views 2",
    **{name: line.format(scene=SCENE) for name, line in of_features("LINES").items()},
    "evaluate, before": f"{SCENE} --before rig.json",
    "evaluate, bits": f"{SCENE} --method sampled --bits bits",
    "evaluate, silhouettes": f"{SCENE} --table groups",
    "render": "render part.ply -c camera.toml -p poses.json --device surfaceless",
    "compare": "compare part.ply -c camera.toml -p sphere:1 --method sampled --faces 1",
    "compare, models": "compare part.ply -c camera.toml -p sphere:1 --models",
    "place": "place plan.toml",
    "place, by face": "place face.toml",
    "place, not met": "place plan_high.toml",
    "check": "check plan.toml -p rig.json --out checked",
    "check, fails": "check plan.toml -p rig.json --min-coverage 1 --views 4 --group part=0.2",
    "check, baseline": "check plan.toml -p poses.json --baseline checked/check.json",
    "audit": "audit sparse/0 part.ply",
    "audit, footprints": "audit sparse/0 part.ply --footprints images.geojson",
    "audit, by face": "audit sparse/0 part.ply --by face --pose-unit 1 --suggest 1",
    "cameras": "cameras",
    "cameras, pairs": "cameras --hfov 60",
    "cameras, field": "cameras --wd 0.35 --fov 0.1",
    "groups": "groups part.ply",
    "convert": "convert rig.json converted.npy --overwrite",
    "doctor": "doctor",
    "validate": "validate markers",
}
FAILING = {"place, not met", "check, fails"}
SLOW = {"validate"}
WITHOUT = {"view", "playground", "serve", "sheet"}
"""Commands that print no JSON."""


def schema_of(name):
    return SCHEMA | {"$ref": f"#/$defs/{name}"}


def faults(name, data):
    from jsonschema import Draft202012Validator  # it makes forty grammars

    iter_errors = Draft202012Validator(schema_of(name)).iter_errors(data)
    return [
        f"{'/'.join(map(str, each.absolute_path))}: {each.message[:200]}" for each in iter_errors
    ]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Files of a reader, of features, and plans with other goals."""
    folder = tmp_path_factory.mktemp("schema")
    write_files(folder)
    plan = (folder / "plan.toml").read_text()
    (folder / "plan_high.toml").write_text(
        plan.replace("coverage = 0.3", "coverage = 1.0") + "[task]\nviews = 4\n"
    )
    (folder / "face.toml").write_text(plan + '[task]\nby = "face"\nmin_visibility = 0.5\n')
    for name, text in of_features("OF_LINES").items():
        (folder / name).write_text(text)
    np.save(folder / "none.npy", np.zeros((0, 4, 4)))
    names = json.loads((folder / "stereo.json").read_text())
    (folder / "named.json").write_text(json.dumps(names).replace("left", "l").replace("right", "r"))
    return folder


def test_the_schema_is_one():
    from jsonschema import Draft202012Validator

    Draft202012Validator.check_schema(SCHEMA)
    kinds = {name.partition(",")[0] for name in LINES}
    assert kinds | WITHOUT == set(COMMANDS)
    for name in WITHOUT:
        options = [option for each in LazyCommand(name).loaded.params for option in each.opts]
        assert "--json" not in options


def without_words(schema, path):
    """Keys of a schema and of what is in it that have no description."""
    for name, each in schema.get("properties", {}).items():
        if not {"description", "$ref"} & each.keys():
            yield f"{path}/{name}"
        yield from without_words(each, f"{path}/{name}")
    for name in ("items", "additionalProperties", "anyOf"):
        inner = schema.get(name, ())
        for each in inner if isinstance(inner, list | tuple) else [inner]:
            if isinstance(each, dict):
                yield from without_words(each, path)


def test_every_key_is_described():
    assert [
        key for name in SCHEMA["$defs"] for key in without_words(SCHEMA["$defs"][name], name)
    ] == []


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", [pytest.param(each, marks=nightly if each in SLOW else ()) for each in LINES]
)
def test_what_a_command_prints_has_the_form_of_its_schema(name, folder, capfd, monkeypatch):
    monkeypatch.chdir(folder)
    if name == "check, baseline" and not Path("checked/check.json").exists():
        call(capfd, LINES["check"])
    code, out, err = call(capfd, f"{LINES[name]} --json")
    ctypes.CDLL(None).fflush(None)
    assert capfd.readouterr().out == ""
    assert code == (name in FAILING), err
    others = {"compare, models": "compare_models", "evaluate, bits": "evaluate_bits"}
    kind = others.get(name, "evaluate" if name == "demo" else None)
    assert faults(kind or name.partition(",")[0], json.loads(out)) == []


def test_what_is_missing_new_or_of_another_type_is_found():
    table = {
        "cameras": ["a"],
        "poses": 2,
        "has_unit": True,
        "format": "npy",
        "notes": [],
        "file": "x",
    }
    assert faults("convert", table) == []
    without = {key: value for key, value in table.items() if key != "poses"}
    for wrong in (table | {"poses": -1}, table | {"pose": 2}, table | {"notes": "none"}, without):
        assert len(faults("convert", wrong)) == 1
