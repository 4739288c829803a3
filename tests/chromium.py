"""The Chromium that tests draw pages with, without a window; benches and pictures are of one that people have."""

from __future__ import annotations

import shutil

__all__ = ["CHROMIUM", "FLAGS"]

# The shell first, which Playwright's own is too: a browser without all that a person needs takes half the processor.
NAMES = ("chromium-headless-shell", "chromium", "google-chrome")
CHROMIUM = next((found for name in NAMES if (found := shutil.which(name))), None)
FLAGS = [
    "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking",
    "--disable-component-update", "--disable-sync",
]  # fmt: skip
