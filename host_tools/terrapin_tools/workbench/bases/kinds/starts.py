"""Starts of many stretches, each a small least squares problem of its own, one decomposition for each of them."""

from __future__ import annotations

import numpy as np

from terrapin_hil.arrays import Array, Mask

__all__ = ["ABSURD", "Near"]

ABSURD = 1e50  # derivative by a start: the solution runs off
UNSEEN = 1e-9  # of what the starts can do best: less is nothing


class Near:
    """Each stretch around a run: residual (stretches, m), its cost (sum of squares), what the starts can do, as a
    decomposition of its columns (stretches, m, states), and what of the cost that would take away (`gain`)."""

    def __init__(self, residual: Array, columns: Array) -> None:
        self.cost = (residual * residual).sum(axis=1)
        sound = np.isfinite(self.cost) & (np.abs(columns) < ABSURD).all(axis=(1, 2))
        self.cost[~sound] = np.inf
        columns, residual = np.where(sound[:, None, None], columns, 0.0), np.where(sound[:, None], residual, 0.0)
        self.scale = np.maximum(np.sqrt((columns * columns).sum(axis=1)), 1e-300)
        self.left, self.values, self.right = np.linalg.svd(columns / self.scale[:, None, :], full_matrices=False)
        seen = self.values > UNSEEN * self.values.max(axis=1, initial=0.0, keepdims=True)
        self.values = np.where(seen, self.values, 0.0)
        self.scores = np.einsum("sij,si->sj", self.left, residual) * seen
        self.gain = (self.scores * self.scores).sum(axis=1)

    def take(self, other: Near, which: Mask) -> None:
        """Stretches `which` become those of the other."""
        for name in ("cost", "scale", "left", "values", "right", "scores", "gain"):
            getattr(self, name)[which] = getattr(other, name)[which]

    def step(self, damping: Array) -> Array:
        """The step of Levenberg and Marquardt (stretches, states)."""
        size = self.values / np.maximum(self.values**2 + damping[:, None], 1e-300) * self.scores
        return np.asarray(np.einsum("sij,si->sj", self.right, size) / self.scale)

    def basis(self) -> Array:
        """Orthonormal, 0 where a direction does nothing."""
        return np.asarray(self.left * (self.values > 0.0)[:, None, :])

    def follows(self, by: Array) -> Array:
        """How the best starts follow the parameters (stretches, states, parameters), whose columns are `by`."""
        inverse = np.where(self.values > 0.0, 1.0 / np.maximum(self.values, 1e-300), 0.0)
        inner = np.swapaxes(self.left, 1, 2) @ by * inverse[..., None]
        return np.asarray(-(np.swapaxes(self.right, 1, 2) @ inner) / self.scale[..., None])
