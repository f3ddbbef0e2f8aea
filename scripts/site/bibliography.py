"""The page of all sources, gathered from the sections "Sources" of the pages."""

from __future__ import annotations

import re

from scripts.site.api import ROOT

DOCS = ROOT / "docs"


def page() -> str:
    """Markdown of the page: every source once, in the order of the alphabet, with the pages that name it."""
    named: dict[str, list[str]] = {}
    for path in sorted(DOCS.glob("*/*.md")):
        text = path.read_text("utf-8")
        title = text.split("\n", 1)[0].removeprefix("# ")
        for source in _sources(text):
            named.setdefault(source, []).append(f"[{title}](../{path.relative_to(DOCS).as_posix()})")
    rows = [f"- {source} ({', '.join(named[source])})" for source in sorted(named, key=_family_name)]
    head = "What the pages of this site name as their sources; numbers in the code have theirs beside them."
    return "\n".join(["# Bibliography", "", head, "", *rows, ""])


def _sources(text: str) -> list[str]:
    """The items of the list below the heading "Sources", each on one line."""
    _, found, rest = text.partition("\n## Sources\n")
    items = re.split(r"\n(?:- |\d+\. )", "\n" + rest.split("\n## ")[0].strip()) if found else []
    return [" ".join(item.split()) for item in items if item.strip()]


def _family_name(source: str) -> str:
    """What a source is sorted by: the first word that is no initial."""
    return next((word for word in re.findall(r"[^\W\d_]+", source) if len(word) > 1), source).lower()
