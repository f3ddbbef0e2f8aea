r"""Formulas as MathML, which browsers draw themselves: no script and no font has to be fetched.

Pages write LaTeX between `$` signs, as GitHub shows it; the extension `pymdownx.arithmatex` marks it.
"""

from __future__ import annotations

import re
from html import unescape

from latex2mathml.converter import convert

_INLINE = re.compile(r'<span class="arithmatex">\\\((.+?)\\\)</span>', re.DOTALL)
_BLOCK = re.compile(r'<div class="arithmatex">\\\[(.+?)\\\]</div>', re.DOTALL)


def drawn(html: str) -> str:
    """The page with every marked formula as MathML."""
    html = _BLOCK.sub(lambda found: _mathml(found[1], "block"), html)
    return _INLINE.sub(lambda found: _mathml(found[1], "inline"), html)


def _mathml(latex: str, display: str) -> str:
    numbered = re.sub(r"\\tag\{(.+?)\}", r"\\qquad (\1)", unescape(latex).strip())
    return convert(numbered, display=display)
