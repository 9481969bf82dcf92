"""Letters in pictures: those of the font, never its box, whatever a name holds."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from rastercov.report.images import Key, add_frame, cut, drawable, font_for, write_labels

FONT = font_for(640)
BOX = bytes(FONT.getmask("\uffff"))
ANY = st.text(st.characters(exclude_categories=()), max_size=12)


@given(ANY)
def test_no_letter_is_a_box(text):
    own = drawable(text, FONT)
    assert BOX not in [bytes(FONT.getmask(letter)) for letter in own]
    assert all(letter.isprintable() for letter in own)
    assert bool(own) == bool(text.split())


@given(st.text(st.characters(min_codepoint=33, max_codepoint=126), max_size=12))
def test_ascii_stays(text):
    assert drawable(text, FONT) == text


@pytest.mark.parametrize(
    ("text", "wanted"),
    [("\u00e9", "e"), ("e\u0301", "e"), ("\u90e8\u54c11", "??1"), ("\ud55c", "?"), ("\u338f", "kg"),
     ("\u0141\u00f3d\u017a", "?odz"), ("a\tb\nc", "a b c"), ("\udc80x", "?x"),
     ("\u2026", "\u2026"), ("\u00a8", "?"), ("a\u2215b", "a/b"),
     ("9 \u00b5m, 9 \u03bcm", "9 um, 9 um")],
)  # fmt: skip
def test_accents_go_and_letters_without_a_glyph_are_question_marks(text, wanted):
    assert drawable(text, FONT) == wanted
    assert cut(text, FONT, 1e3) == wanted


@given(ANY)
def test_pictures_hold_any_name(text):
    labelled, plain = (Image.new("RGB", (200, 80)) for _ in range(2))
    for image, name in ((labelled, text), (plain, drawable(text, FONT))):
        write_labels(image, [(90, 40)], [name], [(9, 9, 9)], FONT, 1)
    assert labelled.tobytes() == plain.tobytes()
    pixels = np.zeros((20, 30, 3), np.uint8)
    add_frame(pixels, text, [Key(text, pixels[:1, :1])])


@pytest.mark.parametrize("ends", [("", ""), ("0.001 mm", "131 mm")])
def test_no_entry_of_a_legend_goes_beyond_its_picture(ends):
    """A long name after a scale did: it was cut off at the edge."""
    pixels = np.zeros((20, 30, 3), np.uint8)
    picture = np.array(add_frame(pixels, "", [Key("W" * 300, pixels[:1, :1], *ends)]))
    assert (picture[-15:, -3:] == picture[-1, -1]).all()


def test_ends_of_a_scale_are_letters_of_the_font():
    """Uncertainties are in "\u00b5m", which the font does not have: a box stood for it."""
    pixels = np.zeros((20, 30, 3), np.uint8)
    pictures = [
        add_frame(pixels, "", [Key("", pixels[:1, :1], "9 um", f"99 {unit}m")])
        for unit in ("u", "\u00b5")
    ]
    assert pictures[0].crop((0, 0, 300, pictures[0].height)).tobytes() == (
        pictures[1].crop((0, 0, 300, pictures[1].height)).tobytes()
    )
