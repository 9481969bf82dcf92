"""What pages for people have in common: one style, tables, pictures within the page itself.

A page needs nothing else: no script, no request. It follows the light or dark theme of its reader,
and fits a phone and a desk.
"""

import base64
import io
from collections.abc import Sequence
from html import escape

from PIL import Image

STYLE = """
:root { color-scheme: light dark; --paper: #fff; --ink: #1b2129; --soft: #5b6673; --line: #dfe4ea;
  --card: #f6f8fa; --good: #0b7a55; --bad: #b8172a; }
@media (prefers-color-scheme: dark) { :root { --paper: #0f1318; --ink: #e6eaef; --soft: #9aa6b3;
  --line: #2c343d; --card: #171c22; --good: #3ccb9d; --bad: #ff6b78; } }
* { box-sizing: border-box; }
body { margin: 0 auto; padding: 1rem; max-width: 76rem; background: var(--paper);
  color: var(--ink); font: 16px/1.5 system-ui, sans-serif; }
h1 { font-size: 1.5rem; line-height: 1.25; margin: .5rem 0; }
h2 { font-size: 1.2rem; margin: 2.2rem 0 .4rem; }
h3 { font-size: 1rem; margin: 1.4rem 0 .3rem; }
p { margin: .4rem 0 .8rem; max-width: 46rem; }
.soft, figcaption, summary { color: var(--soft); }
.verdict { border-left: .4rem solid var(--good); background: var(--card); padding: .7rem 1rem;
  border-radius: .3rem; }
.verdict.bad { border-color: var(--bad); }
.verdict strong { font-size: 1.15rem; }
.verdict ul { margin: .4rem 0 0; padding-left: 0; list-style: none; }
.yes { color: var(--good); } .no { color: var(--bad); font-weight: 600; }
.wide { overflow-x: auto; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; font-size: .92rem; }
th, td { text-align: right; padding: .3rem .7rem; border-bottom: 1px solid var(--line);
  white-space: nowrap; }
th { font-weight: 600; color: var(--soft); vertical-align: bottom; white-space: normal; }
th:first-child, td:first-child { text-align: left; }
.grid { display: grid; gap: 1rem;
  grid-template-columns: repeat(auto-fill, minmax(min(100%, 26rem), 1fr)); }
.faces { grid-template-columns: repeat(auto-fill, minmax(min(100%, 20rem), 1fr)); }
figure { margin: 0; }
figure + .wide, .grid + .wide, .wide + .wide { margin-top: 1rem; }
img { width: 100%; height: auto; display: block; border: 1px solid var(--line);
  border-radius: .3rem; }
figcaption { font-size: .88rem; padding-top: .3rem; }
summary { cursor: pointer; padding: .4rem 0; }
"""


def document(title: str, body: Sequence[str]) -> str:
    """The whole page of some parts."""
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{escape(title)}</title>\n"
        f"<style>{STYLE}</style>\n</head>\n<body>\n" + "\n".join(body) + "\n</body>\n</html>\n"
    )


def table(headings: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table that scrolls by itself where it is wider than the page."""
    head = "".join(f"<th>{escape(words)}</th>" for words in headings)
    lines = ("".join(f"<td>{escape(words)}</td>" for words in row) for row in rows)
    body = "".join(f"<tr>{line}</tr>" for line in lines)
    return f'<div class="wide"><table><tr>{head}</tr>{body}</table></div>'


def picture(words: str, light: bytes, dark: bytes | None = None) -> str:
    """An image in PNG, told in words, with its twin for the dark theme."""
    image = f'<img alt="{escape(words)}" src="{uri(light)}">'
    if dark is None:
        return image
    source = f'<source srcset="{uri(dark)}" media="(prefers-color-scheme: dark)">'
    return f"<picture>{source}{image}</picture>"


def uri(data: bytes) -> str:
    """Address of a picture that is in the page itself."""
    return "data:image/png;base64," + base64.b64encode(data).decode("ascii")


def png(image: Image.Image, choice: Image.Quantize) -> bytes:
    """A picture as PNG, in the 255 colours that suit it: half the size.

    The median cut keeps the soft edges of lines, the octree small areas of a colour of their own.
    """
    file = io.BytesIO()
    few = image.quantize(255, choice, dither=Image.Dither.NONE)
    few.save(file, format="PNG", optimize=True)
    return file.getvalue()
