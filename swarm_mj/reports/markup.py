"""HTML in which every text is escaped unless it was built here."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape
from importlib import resources

#: Elements without a closing tag.
VOID = {"input", "meta", "br"}
#: The style of reports, a file of this room.
STYLE = "page.css"


class Html(str):
    """Text that is already HTML."""


Content = str | float | None | Iterable["Content"]


def tag(name: str, /, *content: Content, **attributes: str | float | bool | None) -> Html:
    """Build an element.

    Args:
        name: Its tag.
        content: Children; plain text is escaped, None left out, lists are joined.
        attributes: `class_` and `for_` lose their underscore, other underscores become hyphens; None and False are left out.
    """
    opening = f"<{name}{''.join(_attribute(key, value) for key, value in attributes.items())}>"
    return Html(opening if name in VOID else f"{opening}{join(content)}</{name}>")


def join(content: Content) -> Html:
    """Join texts and elements."""
    if content is None:
        return Html("")
    if isinstance(content, Html):
        return content
    if isinstance(content, str | float | int):
        return Html(escape(str(content)))
    return Html("".join(join(part) for part in content))


def _attribute(key: str, value: str | float | bool | None) -> str:
    if value is None or value is False:
        return ""
    name = key.rstrip("_").replace("_", "-")
    return f" {name}" if value is True else f' {name}="{escape(str(value))}"'


def own(name: str) -> str:
    """The text of a file of this room."""
    return (resources.files("swarm_mj.reports") / name).read_text("utf-8")


def document(title: str, policy: str, body: Content) -> str:
    """A whole page in the style of reports, under a content security policy."""
    head = [
        tag("meta", charset="utf-8"),
        tag("meta", http_equiv="Content-Security-Policy", content=policy),
        tag("meta", name="viewport", content="width=device-width, initial-scale=1"),
        tag("title", title),
        tag("style", Html(own(STYLE))),
    ]
    return f"<!DOCTYPE html>\n{tag('html', tag('head', head), tag('body', body), lang='en')}\n"


def table(
    head: Sequence[Content],
    rows: Iterable[Sequence[Content]],
    *,
    caption: str,
    class_: str | None = None,
    id_: str | None = None,
    row_classes: Sequence[str | None] = (),
) -> Html:
    """A table whose first column names the rows, in a box that scrolls when the page is narrow.

    Args:
        head: Column headings.
        rows: Cells of each row.
        caption: What it shows, also for screen readers.
        class_: Its class; `numeric` sets all columns but the first to the right.
        id_: Its id.
        row_classes: A class for each row, or none at all.
    """
    body = []
    for number, (name, *cells) in enumerate(rows):
        own = row_classes[number] if row_classes else None
        body.append(tag("tr", tag("th", name, scope="row"), [tag("td", cell) for cell in cells], class_=own))
    top = tag("thead", tag("tr", [tag("th", heading, scope="col") for heading in head]))
    grid = tag("table", tag("caption", caption), top, tag("tbody", body), class_=class_, id=id_)
    return tag("div", grid, class_="scroll", tabindex=0, role="region", aria_label=caption)
