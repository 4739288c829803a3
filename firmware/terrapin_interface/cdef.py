"""C headers as plain declarations that cffi reads."""

from __future__ import annotations

import re

__all__ = ["cdef"]


def cdef(headers: list[str]) -> str:
    """Declarations and integer macros of the texts `headers`, in order: no comments, directives or attributes.

    >>> print(cdef(['#ifndef X\\n#define X\\n#define N 3 /* three */\\nAPI int f(int n); // doc\\n#endif']))
    #define N 3
    int f(int n);
    """
    out: list[str] = []
    for text in headers:
        bare = re.sub(r"/\*.*?\*/|//[^\n]*", "", text, flags=re.DOTALL)
        bare = re.sub(r"#ifdef __cplusplus.*?#endif", "", bare, flags=re.DOTALL)
        for line in bare.splitlines():
            stripped = line.strip()
            macro = re.fullmatch(r"#define\s+(\w+)\s+\(?(-?(?:0[xX][0-9a-fA-F]+|\d+))[uUlL]*\)?", stripped)
            if macro:
                out.append(f"#define {macro[1]} {macro[2]}")
            elif stripped and not stripped.startswith(("#", "_Static_assert")):
                out.append(re.sub(r"\b\w*API\b ?", "", line).rstrip())
    return "\n".join(out)
