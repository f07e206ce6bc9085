"""The page of a running campaign, which asks its server for a summary now and then."""

from __future__ import annotations

from markupsafe import Markup

from reports.colours import css_variables
from reports.page import own_text, template


def render_live(title: str) -> str:
    """Render the page as HTML text.

    Args:
        title: of the campaign.
    """
    return template("live.html").render(
        title=title,
        colours=Markup(css_variables()),
        style=own_text("report.css"),
        script=Markup("\n").join((own_text("page.js"), own_text("live.js"))),
    )
