"""Counts in sentences for people."""

import pytest

from rastercov.base.format import plural, verb


@pytest.mark.parametrize(
    ("noun", "action", "words"),
    [
        ("image", "see", ("0 images see", "1 image sees", "2 images see")),
        ("camera", "cover", ("0 cameras cover", "1 camera covers", "2 cameras cover")),
        ("face", "are", ("0 faces are", "1 face is", "2 faces are")),
        ("candidate", "have", ("0 candidates have", "1 candidate has", "2 candidates have")),
        ("mesh", "belong", ("0 meshes belong", "1 mesh belongs", "2 meshes belong")),
        ("vertex", "", ("0 vertices", "1 vertex", "2 vertices")),
    ],
)
def test_a_counted_noun_and_its_verb_agree(noun, action, words):
    assert tuple(plural(count, noun, action) for count in (0, 1, 2)) == words
    assert verb(1, "are left out") == "is left out"
