"""The demonstration: the whole circle, once, with a page to look at."""
