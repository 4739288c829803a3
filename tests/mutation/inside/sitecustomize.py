"""Found first on the path of a Python that is to run with a mutant: the module's text is another one.

TERRAPIN_MUTANT is a file of JSON: path of the module, and its text. Processes that a test starts have it, too.
"""

import importlib.machinery
import json
import os


def _plant() -> None:
    with open(os.environ["TERRAPIN_MUTANT"], encoding="utf-8") as file:
        path, text = json.load(file)
    loader = importlib.machinery.SourceFileLoader
    stats, data = loader.path_stats, loader.get_data

    def path_stats(self, name):  # type: ignore[no-untyped-def]
        if os.path.realpath(name) == path:
            raise OSError  # no compiled text of it is read, and none is written
        return stats(self, name)

    def get_data(self, name):  # type: ignore[no-untyped-def]
        return text.encode() if os.path.realpath(name) == path else data(self, name)

    loader.path_stats, loader.get_data = path_stats, get_data


if "TERRAPIN_MUTANT" in os.environ:
    _plant()
