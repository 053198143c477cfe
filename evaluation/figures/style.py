"""How figures look: widths of a two-column paper, fonts that can be read there, colours that all readers tell apart."""

from __future__ import annotations

COLUMN_WIDTH, TEXT_WIDTH = 3.25, 6.875
"""Width of a column and of the text of a conference paper in inches. Figures are not reduced in print."""
PALETTE = ("#0072B2", "#D55E00", "#009E73", "#E69F00", "#56B4E9", "#CC79A7", "#000000")
"""Colours that people with any colour vision can tell apart (Okabe and Ito 2008, "Color universal design"), without the
yellow, which is hard to see on white."""
MARKERS = "osD^v<>"
"""Markers of curves, which tell them apart without colour."""
SMALL, MEDIUM, LARGE = 7, 8, 9
"""Sizes of text in points; 7 is the least."""
STYLE = {
    "font.size": MEDIUM,
    "axes.titlesize": MEDIUM,
    "axes.labelsize": MEDIUM,
    "xtick.labelsize": SMALL,
    "ytick.labelsize": SMALL,
    "legend.fontsize": SMALL,
    "lines.linewidth": 1.2,
    "lines.markersize": 3.5,
    "axes.linewidth": 0.6,
    "grid.alpha": 0.3,
    "grid.linewidth": 0.5,
    "pdf.fonttype": 42,  # TrueType: text remains text
}
"""Settings of matplotlib, without the cycle of colours, which `png_figure` adds."""
