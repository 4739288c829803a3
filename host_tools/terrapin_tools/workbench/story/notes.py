"""A case's notes as HTML: CommonMark and tables. Markup in the text stays text, and no picture is fetched.

>>> to_html("# A\\n\\nsome **bold** text")
'<h3>A</h3>\\n<p>some <strong>bold</strong> text</p>'
"""

from __future__ import annotations

from markdown_it import MarkdownIt

__all__ = ["to_html"]


def to_html(text: str) -> str:
    """HTML of the notes, its headings two steps down: the page has its own. Links lead to http and https only."""
    reader = MarkdownIt("commonmark", {"html": False}).enable("table").disable("image")
    reader.validateLink = lambda url: url.startswith(("https://", "http://"))  # type: ignore[method-assign]
    tokens = reader.parse(text)
    for token in tokens:
        if token.type.startswith("heading"):
            token.tag = f"h{min(int(token.tag[1]) + 2, 6)}"
    return str(reader.renderer.render(tokens, reader.options, {})).strip()
