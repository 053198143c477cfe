"""Stage `html`: the avatar as one HTML file, which needs neither a server nor a network."""

from __future__ import annotations

from pathlib import Path

from carigs.library import load
from carigs.settings import Html
from carigs.viewer.html.page import write_html


def html(settings: Html, *, avatar: Path, title: str, page: Path) -> None:
    """Write the page of an avatar.

    Args:
        settings: Settings of the stage: there are none.
        avatar: The trained avatar.
        title: Title of the page.
        page: HTML file to write.

    Raises:
        InputError: The avatar is malformed.
    """
    write_html(load(avatar), page, title=title)
