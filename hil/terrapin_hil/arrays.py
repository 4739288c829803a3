"""Types of arrays, by what they hold; a docstring says their shapes."""

import numpy as np
import numpy.typing as npt

__all__ = ["Array", "Index", "Mask"]

Array = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]
Index = npt.NDArray[np.int64]
