"""How objects show themselves in notebooks: a small table and a picture, as HTML with everything inside."""

from __future__ import annotations

import base64
import io
from collections.abc import Callable, Iterable
from html import escape
from typing import TYPE_CHECKING

from swarm_mj.errors import SwarmError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Resolution of pictures in notebooks [dots per inch], and their largest width on the page [pixel].
DPI, WIDTH_PX = 110, 760


def rows_html(title: str, subtitle: str, rows: Iterable[tuple[str, str]]) -> str:
    """A titled table of two columns; every text is escaped."""
    cells = "".join(
        f'<tr><th style="text-align:left">{escape(words)}</th><td style="text-align:left">{escape(value)}</td></tr>'
        for words, value in rows
    )
    return f"<div><strong>{escape(title)}</strong><br>{escape(' '.join(subtitle.split()))}<table>{cells}</table></div>"


def figure_html(compose: Callable[[], Figure]) -> str:
    """A figure as an image inside the page; where it cannot be drawn, why not."""
    try:
        return png_html(png_of(compose()))
    except SwarmError as error:
        return f"<p>{escape(str(error))}</p>"


def png_html(png: bytes) -> str:
    """A PNG file as an image inside the page."""
    data = base64.b64encode(png).decode("ascii")
    return f'<img style="max-width:{WIDTH_PX}px;width:100%" src="data:image/png;base64,{data}">'


def png_of(figure: Figure) -> bytes:
    """A figure as a PNG file."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=DPI)
    return buffer.getvalue()
