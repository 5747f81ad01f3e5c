"""The colours of all drawings, safe for colour-blind readers (Okabe and Ito, 2008)."""

BACKGROUND = "#ffffff"
TEXT = "#1f2933"
FAINT = "#6b7785"
SURFACE = "#c7cdd6"

DEMONSTRATED = "#e69f00"
#: Colour of the path of each preset.
PRESETS = {"recommended": "#0072b2", "paper": "#009e73", "baseline": "#cc79a7"}
#: Colours of all paths on pages.
PATHS = {"demonstration": DEMONSTRATED, **PRESETS, "flown": "#5f6b78", "newer draft": "#d55e00"}

#: Colour of the surface by its state; the order is that of `records.SURFACE_STATES`.
STATES = {
    "other": SURFACE,
    "shown": "#7db8e8",
    "missed": "#d55e00",
    "unattainable": "#f0e442",
    "no counterpart": "#8c7a99",
    "hardly inspected": "#d5e8e0",
    "partly inspected": "#8fcbb5",
    "inspected": "#2e9e7c",
    "seen if corrected": "#c9a0dc",
    "in view only": "#b5651d",
    "inspected if corrected": "#7b3fa0",
}

#: Colours of a classified scan: structure, ground, clutter, neighbour.
CLASSES = (SURFACE, "#b9a26a", "#d55e00", "#cc79a7")


def rgb(colour: str) -> tuple[float, float, float]:
    """Red, green and blue in 0 .. 1 of ``#rrggbb``.

    >>> rgb("#ff0000")
    (1.0, 0.0, 0.0)
    """
    red, green, blue = (int(colour[at : at + 2], 16) / 255 for at in (1, 3, 5))
    return red, green, blue
