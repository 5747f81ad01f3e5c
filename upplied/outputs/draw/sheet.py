"""A sheet of panels with title, labels, scale bars and a legend, as PNG."""

import io
import unicodedata
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from upplied.extras import extra
from upplied.outputs.colours import BACKGROUND, FAINT, TEXT
from upplied.outputs.draw.views import Frame

with extra("export"):
    from PIL import Image, ImageColor, ImageDraw, ImageFont

_PAD, _HEAD, _LINE = 18, 46, 26
_ROW = 18  # height of a line of a label
_LABEL, _SMALL = 16, 14
_SPELLED = str.maketrans(
    {"×": "x", "→": "to", "²": "2", "³": "3", "–": "-", "—": "-", "’": "'", "≥": ">=", "≤": "<="}
)


@dataclass(frozen=True)
class Panel:
    """A picture with its place on the sheet, px, and the frame it was drawn in."""

    image: np.ndarray  # uint8 (height, width, 3)
    x: int
    y: int
    label: str
    frame: Frame


def padded(panel: Panel, high: int) -> Panel:
    """The panel in the middle of a higher one, as its frame would show it there."""
    more = (high - len(panel.image)) // 2
    rows = np.full((more, panel.image.shape[1], 3), ImageColor.getrgb(BACKGROUND), np.uint8)
    image = np.concatenate([rows, panel.image, rows])
    return replace(panel, image=image, frame=replace(panel.frame, height=len(image)))


def drawable(text: str) -> str:
    """The text in the letters that Pillow's own font has.

    >>> drawable("Fréchet 2 × 3 m → ok")
    'Frechet 2 x 3 m to ok'
    """
    plain = unicodedata.normalize("NFKD", text.translate(_SPELLED))
    plain = "".join(letter for letter in plain if not unicodedata.combining(letter))
    return "".join(letter if letter in "·…" or " " <= letter <= "~" else " " for letter in plain)


@cache
def font(size: int) -> ImageFont.FreeTypeFont | ImageFont.ImageFont:
    """Pillow's own font, so that every machine draws the same letters."""
    return ImageFont.load_default(size)


def sheet_png(
    panels: Sequence[Panel], legend: Sequence[tuple[str, str, str]], title: str, subtitle: str = ""
) -> bytes:
    """PNG bytes of panels under a title, over a legend of (name, colour, "line" or "patch")."""
    width = max(panel.x + panel.image.shape[1] for panel in panels)
    room = _ROW * max(0, *(len(_labelled(panel)) - 1 for panel in panels))  # above each row, for long labels
    tops = sorted({panel.y for panel in panels})
    panels = [replace(panel, y=panel.y + room * (tops.index(panel.y) + 1)) for panel in panels]
    bottom = max(panel.y + panel.image.shape[0] for panel in panels)
    notes = _wrapped(subtitle, width - 2 * _PAD, _SMALL) if subtitle else []
    head = _HEAD + _LINE * len(notes)
    entries = _entries(legend, width)
    rows = max((row for *_, row in entries), default=-1) + 1
    sheet = Image.new("RGB", (width, head + bottom + (_LINE * rows + _PAD if rows else 0)), BACKGROUND)
    draw = ImageDraw.Draw(sheet)
    draw.text((_PAD, 12), _fitting(title, width - 2 * _PAD, 22), fill=TEXT, font=font(22))
    for line, note in enumerate(notes):
        draw.text((_PAD, _HEAD + line * _LINE - 4), note, fill=FAINT, font=font(_SMALL))
    for panel in panels:
        sheet.paste(Image.fromarray(panel.image), (panel.x, head + panel.y))
    for panel in panels:
        _annotate(draw, panel, head, room)
    for name, colour, mark, x, row in entries:
        y = head + bottom + row * _LINE + 4
        if mark == "line":
            draw.line([(x, y + 9), (x + 26, y + 9)], fill=colour, width=4)
        else:
            draw.rectangle([(x + 4, y + 2), (x + 20, y + 17)], fill=colour)
        draw.text((x + 34, y), name, fill=TEXT, font=font(_LABEL))
    return png(np.asarray(sheet))


def png(image: np.ndarray) -> bytes:
    """An image, uint8 (H, W, 3), as the bytes of a PNG."""
    buffer = io.BytesIO()
    Image.fromarray(image).save(buffer, "PNG", compress_level=6)
    return buffer.getvalue()


def _labelled(panel: Panel) -> list[str]:
    return _wrapped(panel.label, panel.image.shape[1] - 2 * _PAD, _SMALL)[:3]


def _annotate(draw: ImageDraw.ImageDraw, panel: Panel, head: int, room: int) -> None:
    """The label above, and below a bar of round length where the picture has one scale."""
    high, wide = panel.image.shape[:2]
    for row, text in enumerate(_labelled(panel)):
        at = panel.x + _PAD, head + panel.y - room + 4 + row * _ROW
        draw.text(at, text, fill=FAINT, font=font(_SMALL))
    if np.isfinite(panel.frame.eye_m):
        return
    metres = round_length(0.22 * wide / panel.frame.metre_px)
    long = metres * panel.frame.metre_px
    right, low = panel.x + wide - _PAD, head + panel.y + high - 12
    draw.line([(right - long, low), (right, low)], fill=FAINT, width=2)
    for end in (right - long, right):
        draw.line([(end, low - 4), (end, low + 4)], fill=FAINT, width=2)
    draw.text((right, low - 6), f"{metres:g} m", fill=FAINT, font=font(_SMALL), anchor="rs")


def round_length(metres: float) -> float:
    """The largest of 1, 2, 5 times a power of ten that is not longer.

    >>> round_length(37.0)
    20.0
    """
    power = 10.0 ** np.floor(np.log10(metres))
    return float(max(step for step in (1, 2, 5) if step * power <= metres * (1 + 1e-9)) * power)


def _entries(legend: Sequence[tuple[str, str, str]], width: int) -> list[tuple[str, str, str, float, int]]:
    """Legend entries with their place: x in px and row."""
    out, x, row = [], float(_PAD), 0
    for name, colour, mark in dict.fromkeys((drawable(name), colour, mark) for name, colour, mark in legend):
        wide = 34 + font(_LABEL).getlength(name) + 28
        if x > _PAD and x + wide > width:
            x, row = float(_PAD), row + 1
        out.append((name, colour, mark, x, row))
        x += wide
    return out


def _wrapped(text: str, width: float, size: int) -> list[str]:
    lines = [""]
    for word in drawable(text).split():
        longer = f"{lines[-1]} {word}".strip()
        if lines[-1] and font(size).getlength(longer) > width:
            lines.append(word)
        else:
            lines[-1] = longer
    return [_fitting(line, width, size) for line in lines if line]


def _fitting(text: str, width: float, size: int) -> str:
    """The text, shortened with an ellipsis if it is too long."""
    text = drawable(text)
    if font(size).getlength(text) <= width:
        return text
    while text and font(size).getlength(text + "…") > width:
        text = text[:-1]
    return text + "…"
