"""A case's notes as HTML: headings, paragraphs, lists, tables, bold, code and links; everything else stays text.

>>> to_html("# A\\n\\nsome **bold** text")
'<h3>A</h3>\\n<p>some <b>bold</b> text</p>'
"""

from __future__ import annotations

import html
import re

__all__ = ["to_html"]


def _inline(text: str) -> str:
    escaped = html.escape(text.strip(), quote=False)
    escaped = re.sub(r"`([^`]+)`", r"<code>\1</code>", escaped)
    escaped = re.sub(r"\*\*([^*]+)\*\*", r"<b>\1</b>", escaped)
    return re.sub(r"\[([^\]]+)\]\((https?://[^)\s\"]+)\)", r'<a href="\2">\1</a>', escaped)


def to_html(text: str) -> str:
    """HTML of the notes. Nothing of the text reaches the page unescaped."""
    return "\n".join(_block(block) for block in re.split(r"\n\s*\n", text.strip()) if block.strip())


def _block(block: str) -> str:
    lines = block.splitlines()
    heading = re.match(r"(#{1,4})\s+(.*)", lines[0])
    if heading:
        level = min(len(heading.group(1)) + 2, 6)
        rest = "\n".join(lines[1:])
        return f"<h{level}>{_inline(heading.group(2))}</h{level}>" + (f"\n{_block(rest)}" if rest.strip() else "")
    if all(line.lstrip().startswith("|") for line in lines) and len(lines) > 1:
        return _table(lines)
    if lines[0].lstrip().startswith("- "):
        items: list[str] = []
        for line in lines:
            if line.lstrip().startswith("- "):
                items.append(line.lstrip()[2:])
            else:
                items[-1] += " " + line.strip()
        return "<ul>" + "".join(f"<li>{_inline(item)}</li>" for item in items) + "</ul>"
    return f"<p>{_inline(' '.join(line.strip() for line in lines))}</p>"


def _table(lines: list[str]) -> str:
    rows = [line.strip().strip("|").split("|") for line in lines]
    head = "".join(f"<th>{_inline(cell)}</th>" for cell in rows[0])
    body = "".join(
        "<tr>" + "".join(f"<td>{_inline(cell)}</td>" for cell in row) + "</tr>"
        for row in rows[1:]
        if not all(set(cell.strip()) <= set("-: ") for cell in row)
    )
    return f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"
