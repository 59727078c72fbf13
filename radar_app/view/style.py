"""How the page looks: colours that colour-blind people can tell apart, dark plots, cards that stand below each other on a phone."""

from __future__ import annotations

from typing import Any, Final

from bokeh.layouts import column
from bokeh.models import Column, LinearColorMapper
from bokeh.models.ui import UIElement
from bokeh.models.widgets import Div
from bokeh.palettes import cividis
from bokeh.plotting import figure

GROUND, CARD, LINE, TEXT, FAINT = "#0e131a", "#161d27", "#2a3442", "#e8edf3", "#93a0b0"
GOOD, DOUBTFUL, BAD = "#009E73", "#E69F00", "#D55E00"
ACCENT: Final = "#56B4E9"
HEAT: Final = cividis(256)
"""For what only grows: levels."""

_SIDES: Final = ("#56B4E9", "#1d2733", "#E69F00")

FONT: Final = "ui-sans-serif, system-ui, -apple-system, 'Segoe UI', Roboto, 'Helvetica Neue', Arial, sans-serif"

PAGE: Final = f"""
{{% block preamble %}}
<meta http-equiv="Content-Security-Policy" content="default-src 'self'; script-src 'self' 'unsafe-inline' 'unsafe-eval';
  style-src 'self' 'unsafe-inline'; img-src 'self' data: blob:; font-src 'self' data:; connect-src 'self' ws: wss:">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="color-scheme" content="dark">
{{% endblock %}}
{{% block postamble %}}
<style>
  html, body {{ background: {GROUND}; color: {TEXT}; font-family: {FONT}; height: auto; }}
  body {{ margin: 0; padding: 12px; }}
</style>
{{% endblock %}}
"""
"""Template of the page: nothing is loaded from anywhere but its own server, and a phone shows it at its own width."""


def both_sides(n: int = 255) -> list[str]:
    """Make a palette for what has two signs: blue below zero, dark at it, orange above."""
    low, middle, high = ([int(text[k : k + 2], 16) for k in (1, 3, 5)] for text in _SIDES)
    shades = []
    for k in range(n):
        share = 2 * k / (n - 1) - 1
        end = low if share < 0 else high
        shades.append("#" + "".join(f"{round(m + abs(share) ** 0.8 * (e - m)):02x}" for m, e in zip(middle, end, strict=True)))
    return shades


def mapper(palette: Any, low: float, high: float) -> LinearColorMapper:
    """Map values to colours; where there is no value the ground shows."""
    return LinearColorMapper(palette=palette, low=low, high=high, nan_color="rgba(0,0,0,0)")


def plot(name: str, across: str, up: str, **options: Any) -> figure:
    """Make a dark plot that fills its card; ``name`` finds it in tests, ``across`` and ``up`` label the axes with units."""
    made = figure(
        name=name, x_axis_label=across, y_axis_label=up, sizing_mode="stretch_width", toolbar_location=None, output_backend="canvas",
        min_border=4, **options,
    )  # fmt: skip
    made.background_fill_color, made.border_fill_color, made.outline_line_color = GROUND, CARD, None
    made.grid.grid_line_color, made.grid.grid_line_alpha = LINE, 0.6
    for axis in made.axis:
        axis.axis_line_color = axis.major_tick_line_color = LINE
        axis.minor_tick_line_color = None
        axis.major_label_text_color = axis.axis_label_text_color = FAINT
        axis.major_label_text_font_size, axis.axis_label_text_font_size = "11px", "12px"
        axis.axis_label_text_font_style, axis.major_label_text_font = "normal", FONT
        axis.axis_label_text_font, axis.axis_label_standoff = FONT, 4
    made.toolbar.logo = None
    return made


_CARD_SHEET: Final = f"""
:host {{ background: {CARD}; border: 1px solid {LINE}; border-radius: 12px; padding: 12px; box-sizing: border-box;
  gap: 6px; min-width: 0; }}
"""
_TITLE: Final = f"font: 600 13px {FONT}; color: {FAINT}; letter-spacing: .04em; text-transform: uppercase;"


def card(title: str, *parts: UIElement, span: int = 1, **options: Any) -> Column:
    """Put parts below a title on one card, which is so many columns of its grid wide."""
    head = Div(text=f'<div style="{_TITLE}">{title}</div>', sizing_mode="stretch_width")
    wide = f"@media (min-width: 900px) {{ :host {{ grid-column: span {span}; }} }}"
    return column(head, *parts, sizing_mode="stretch_width", stylesheets=[_CARD_SHEET, wide], **options)


def stack(*parts: UIElement) -> Column:
    """Put parts below each other, none wider than the screen."""
    css = ":host { display: grid !important; grid-template-columns: minmax(0, 1fr); gap: 12px; min-width: 0; }"
    return column(*parts, sizing_mode="stretch_width", stylesheets=[css])


def grid(*cards: UIElement, columns: int) -> Column:
    """Put cards side by side, so many in a row; below each other on a narrow screen."""
    css = f"""
    :host {{ display: grid !important; grid-template-columns: minmax(0, 1fr); gap: 12px; align-items: start; min-width: 0; }}
    @media (min-width: 560px) {{ :host {{ grid-template-columns: repeat({min(columns, 2)}, minmax(0, 1fr)); }} }}
    @media (min-width: 900px) {{ :host {{ grid-template-columns: repeat({columns}, minmax(0, 1fr)); }} }}
    """
    return column(*cards, sizing_mode="stretch_width", stylesheets=[css])


WIDE: Final = ".bk-clearfix { display: block !important; width: 100%; }"
"""For texts that may be wider than their card: what does not fit scrolls."""

BUTTON: Final = f"""
.bk-btn {{ background: {LINE}; color: {TEXT}; border: 1px solid #3a4656; border-radius: 8px; font: 600 14px {FONT}; min-height: 38px; }}
.bk-btn:hover {{ background: #36445a; }}
.bk-btn[disabled] {{ background: {CARD}; color: {FAINT}; border-color: {LINE}; opacity: .6; }}
.bk-btn.bk-active, .bk-btn.bk-btn-primary {{ background: {ACCENT}; color: #08121c; border-color: {ACCENT}; }}
"""
FIELD: Final = f"""
:host {{ color: {FAINT}; font-family: {FONT}; }}
.bk-input {{ background: {GROUND}; color: {TEXT}; border: 1px solid #3a4656; border-radius: 8px; min-height: 38px; font: 14px {FONT}; }}
.bk-slider-title, label {{ color: {FAINT}; font: 13px {FONT}; }}
.noUi-target {{ background: {LINE}; border-color: {LINE}; box-shadow: none; }}
.noUi-connect {{ background: {ACCENT}; }}
.noUi-handle {{ background: {TEXT} !important; border-radius: 50% !important; }}
"""
TABS: Final = f"""
:host {{ min-width: 0; max-width: 100%; }}
:host(.bk-above) > .bk-header {{ border-bottom: 1px solid {LINE}; margin-bottom: 12px; }}
.bk-tab {{ color: {FAINT}; font: 600 14px {FONT}; padding: 10px 16px; border: none !important; }}
.bk-tab:hover {{ background: {CARD}; }}
.bk-tab.bk-active {{ color: {TEXT}; background: transparent; border-bottom: 2px solid {ACCENT} !important; }}
"""
