"""Files of a plan sheet: SVG in millimetres, PDF by matplotlib, DXF in metres by ezdxf."""

import io
from html import escape
from pathlib import Path
from typing import Any

from rastercov.base.arguments import check_choice
from rastercov.base.errors import ConfigError
from rastercov.base.output import write_bytes, write_text
from rastercov.report.plan_sheet import LAYERS, Sheet

FONTS = "DejaVu Sans, Arial, Helvetica, sans-serif"
INCH = 25.4
POINT = 72 / INCH
"""Points of the printer in a millimetre."""
ALIGN = {"start": "LEFT", "middle": "CENTER", "end": "RIGHT"}


def write_sheet(sheet: Sheet, path: Path) -> None:
    """Write a sheet as .svg, .pdf or .dxf; see `check_sheet_name`."""
    check_sheet_name(path)
    suffix = path.suffix.lower()
    if suffix == ".svg":
        write_text(path, svg_text(sheet))
    elif suffix == ".pdf":
        write_bytes(path, pdf_bytes(sheet))
    else:
        write_text(path, dxf_text(sheet))


def check_sheet_name(path: Path) -> None:
    """Raise `ConfigError` for a file of another suffix, and for .dxf without ezdxf."""
    check_choice("the suffix of the sheet", path.suffix.lower(), (".svg", ".pdf", ".dxf"))
    if path.suffix.lower() == ".dxf":
        try:
            import ezdxf  # noqa: F401 - only to say that it is missing
        except ImportError:
            raise ConfigError(
                f"{path}: DXF needs ezdxf; install it: pip install 'rastercov[building]'"
            ) from None


def svg_text(sheet: Sheet) -> str:
    """The sheet as SVG: a unit is a millimetre of the paper."""
    width, height = sheet.size
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}mm" height="{height}mm" '
        f'viewBox="0 0 {width} {height}" font-family="{FONTS}">',
        f"<title>{escape(sheet.title)}</title>",
        f'<rect width="{width}" height="{height}" fill="#ffffff"/>',
    ]
    for name, layer in LAYERS.items():
        style = f'stroke="{layer.stroke or "none"}" stroke-width="{layer.width}"'
        parts.append(
            f'<g id="{name}" {style} stroke-linejoin="round" stroke-linecap="round" fill="none">'
        )
        for shape in sheet.shapes:
            if shape.layer == name and shape.lines:
                fill = f' fill="{layer.fill}" fill-rule="evenodd"' if shape.is_filled else ""
                data = "".join(
                    "M" + "L".join(f"{x:.4f},{height - y:.4f}" for x, y in line.tolist())
                    for line in shape.lines
                )
                parts.append(f'<path d="{data}"{fill}/>')
        parts.append("</g>")
    parts.append(f'<g fill="{LAYERS["TEXT"].fill}">')
    for label in sheet.labels:
        weight = ' font-weight="bold"' if label.is_bold else ""
        parts.append(
            f'<text x="{label.x:.4f}" y="{height - label.y:.4f}" font-size="{label.size:.3f}" '
            f'text-anchor="{label.anchor}"{weight}>{escape(label.text)}</text>'
        )
    return "\n".join([*parts, "</g>", "</svg>", ""])


def pdf_bytes(sheet: Sheet) -> bytes:
    """The sheet as one page of PDF in its own size, with the fonts in it."""
    from matplotlib import rc_context
    from matplotlib.backends.backend_pdf import FigureCanvasPdf
    from matplotlib.figure import Figure
    from matplotlib.patches import PathPatch
    from matplotlib.path import Path as Curve

    width, height = sheet.size
    figure, content = Figure((width / INCH, height / INCH)), io.BytesIO()
    for name, layer in LAYERS.items():
        for shape in sheet.shapes:
            if shape.layer != name or not shape.lines:
                continue
            curve = Curve.make_compound_path(*(Curve(line / INCH) for line in shape.lines))
            patch = PathPatch(
                curve, transform=figure.dpi_scale_trans, fill=shape.is_filled,
                facecolor=layer.fill or "none", edgecolor=layer.stroke or "none",
                linewidth=layer.width * POINT, joinstyle="round", capstyle="round",
            )  # fmt: skip
            figure.add_artist(patch)
    for label in sheet.labels:
        figure.text(
            label.x / width, label.y / height, label.text, fontsize=label.size * POINT,
            ha=ALIGN[label.anchor].lower(), va="baseline", color=LAYERS["TEXT"].fill,
            weight="bold" if label.is_bold else "normal", family="DejaVu Sans", parse_math=False,
        )  # fmt: skip
    with rc_context({"pdf.fonttype": 42}):
        canvas: Any = FigureCanvasPdf(figure)
        canvas.print_pdf(content, metadata={"Title": sheet.title})
    return content.getvalue()


def dxf_text(sheet: Sheet) -> str:
    """The sheet as DXF, in metres of the world: the drawing in its place, the paper around it."""
    from ezdxf import units
    from ezdxf.colors import RGB, rgb2int
    from ezdxf.document import Drawing
    from ezdxf.enums import TextEntityAlignment
    from ezdxf.tools.standards import setup_drawing

    document: Any = Drawing.new("R2010")
    setup_drawing(document)
    document.units = units.M
    document.header["$LUNITS"] = 2
    space, metre = document.modelspace(), sheet.scale / 1e3
    for name, layer in LAYERS.items():
        if name == "PAPER":
            continue
        made = document.layers.add(name, lineweight=max(13, round(100 * layer.width)))
        made.rgb = RGB.from_hex(layer.stroke or layer.fill or "#000000")
    for name, layer in LAYERS.items():
        for shape in sheet.shapes:
            if shape.layer != name or name == "PAPER":
                continue
            lines = [(line * metre + sheet.origin).tolist() for line in shape.lines]
            if shape.is_filled:
                colour = rgb2int(RGB.from_hex(layer.fill or "#000000"))
                hatch = space.add_hatch(dxfattribs={"layer": name, "true_color": colour})
                for row, line in enumerate(lines):
                    hatch.paths.add_polyline_path(line, is_closed=True, flags=1 if row == 0 else 16)
            for line in lines:
                is_ring = len(line) > 3 and line[0] == line[-1]
                points = line[:-1] if is_ring else line
                space.add_lwpolyline(points, close=is_ring, dxfattribs={"layer": name})
    for label in sheet.labels:
        at = (label.x * metre + sheet.origin[0], label.y * metre + sheet.origin[1])
        style = {"layer": "TEXT", "style": "OpenSans-Bold" if label.is_bold else "OpenSans"}
        text = space.add_text(label.text, height=label.size * metre * 0.73, dxfattribs=style)
        text.set_placement(at, align=TextEntityAlignment[ALIGN[label.anchor]])
    content = io.StringIO()
    document.write(content)
    return content.getvalue()
