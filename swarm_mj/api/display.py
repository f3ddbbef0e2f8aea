"""How results show themselves: figures by name (`flight.plot.coverage()`), and in notebooks a small table and a picture.

Every method composes the figure that the command line writes and returns its Matplotlib axes: one Axes, or an array of them.
In a notebook, and where a program has imported `matplotlib.pyplot`, the figure is one of pyplot's as well, so that it is shown.
"""

from __future__ import annotations

import base64
import io
import sys
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from swarm_mj.errors import SwarmError

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: Resolution of pictures in notebooks [dots per inch], and their largest width on the page [pixel].
DPI, WIDTH_PX = 110, 760


class Plots:
    """Figures of one result, a method for each of their composers, by its name."""

    def __init__(self, composers: Mapping[str, Callable[..., Figure]]) -> None:
        self._composers = dict(composers)

    def __getattr__(self, name: str) -> Callable[..., Axes | NDArray[Any]]:
        """The method that composes a figure, which takes what its function takes by name, for instance `frame="N"`.

        Raises:
            AttributeError: There is no such figure; the message lists the names.
        """
        compose = self.__dict__.get("_composers", {}).get(name)
        if compose is None:
            raise AttributeError(f"no figure {name!r}; there are {', '.join(dir(self))}")
        return lambda **options: axes_of(shown(compose(**options)))

    def __dir__(self) -> list[str]:
        """The figures' names, for completion."""
        return list(self._composers)

    def __repr__(self) -> str:
        """The figures' names."""
        return f"figures: {', '.join(self._composers)}"


def axes_of(figure: Figure) -> Axes | NDArray[Any]:
    """The axes of a figure: itself if there is one, else an array."""
    axes = np.array(figure.axes, dtype=object)
    return axes[0] if len(axes) == 1 else axes


def shown(figure: Figure) -> Figure:
    """Hand a figure to pyplot where it is in use, which shows it in notebooks and by `plt.show()`."""
    pyplot = sys.modules.get("matplotlib.pyplot")
    if pyplot is None and "ipykernel" in sys.modules:
        from matplotlib import pyplot
    if pyplot is not None:
        with suppress(ValueError):  # Matplotlib before 3.11 takes no figure that it has not made
            pyplot.figure(figure)
    return figure


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
        figure, buffer = compose(), io.BytesIO()
    except SwarmError as error:
        return f"<p>{escape(str(error))}</p>"
    figure.savefig(buffer, format="png", dpi=DPI)
    return png_html(buffer.getvalue())


def png_html(png: bytes) -> str:
    """A PNG file as an image inside the page."""
    data = base64.b64encode(png).decode("ascii")
    return f'<img style="max-width:{WIDTH_PX}px;width:100%" src="data:image/png;base64,{data}">'
