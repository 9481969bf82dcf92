"""What `.ci/features` says of each feature holds: its files, and the texts that go with it."""

import re
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
FEATURES = sorted((ROOT / ".ci" / "features").glob("*.toml"))
pytestmark = pytest.mark.skipif(not FEATURES, reason="a wheel has no list of features")


@pytest.mark.parametrize("path", FEATURES, ids=lambda path: path.stem)
def test_files_of_a_feature_and_texts_that_go_with_it_are_there(path):
    feature = tomllib.loads(path.read_text(encoding="utf-8"))
    lost = [own for own in (*feature["own"], *feature.get("stays", ())) if not any(ROOT.glob(own))]
    for name, patterns in (feature["changes"] | feature.get("tests", {})).items():
        text = (ROOT / name).read_text(encoding="utf-8")
        for pattern in patterns:
            text, n = re.subn(pattern, "", text, flags=re.DOTALL)
            lost += [] if n else [f"{name}: {pattern}"]
    assert lost == []
