"""Types of arrays, by what they hold (a docstring says their shapes), and which of many rows are drawn."""

from itertools import pairwise

import numpy as np
import numpy.typing as npt

__all__ = ["Array", "Index", "Mask", "thin"]

Array = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]
Index = npt.NDArray[np.int64]


def thin(scaled: Array, limit: int) -> Index:
    """Rows to draw of (channels, rows): all, or of equal stretches the two with the lowest and the highest value."""
    count = scaled.shape[1]
    if count <= limit:
        return np.arange(count)
    edges = np.linspace(0, count, max(1, limit // (2 * len(scaled))) + 1).astype(int)
    kept = set()
    for channel in scaled:
        for low, high in pairwise(edges.tolist()):
            if high > low:
                kept |= {low + int(np.argmin(channel[low:high])), low + int(np.argmax(channel[low:high]))}
    return np.array(sorted(kept))
