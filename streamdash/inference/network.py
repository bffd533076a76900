"""Small networks that say how probable each cell is: learnt with scikit-learn, kept as arrays."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from sklearn.neural_network import MLPClassifier

HIDDEN = (128, 128)
BATCH = 256
LEARNING_RATE = 1e-3
AVERAGE = 0.8
"""Weights are averaged over epochs, each counting this much less than the next."""
PATIENCE = 8
"""Training ends after so many epochs without a better validation."""

Epoch = Callable[[int], tuple[np.ndarray, np.ndarray]]
"""Gives inputs (n, n_input) and cells (n,) for an epoch, with noise of its own."""


@dataclass(frozen=True, eq=False)
class Network:
    """Layers of weights; the last gives a logit for every cell.

    Attributes
    ----------
    weights : tuple of ndarray (n_in, n_out)
    biases : tuple of ndarray (n_out,)
    """

    weights: tuple[np.ndarray, ...]
    biases: tuple[np.ndarray, ...]

    def log_probabilities(self, x: np.ndarray, extra: np.ndarray | None = None) -> np.ndarray:
        """Log probability of every cell (n, n_cell), or (n, n_extra, n_cell).

        Parameters
        ----------
        x : ndarray (n, n_input)
        extra : ndarray (n_extra, n_more), optional
            Further inputs that come after those of `x`, each combined with every row of it.
        """
        split = x.shape[1]
        h = x @ self.weights[0][:split] + self.biases[0]
        if extra is not None:
            h = h[:, None, :] + extra @ self.weights[0][split:]
        for w, b in zip(self.weights[1:], self.biases[1:], strict=True):
            h = np.maximum(h, 0, out=h) @ w + b
        h -= h.max(axis=-1, keepdims=True)
        h -= np.log(np.exp(h).sum(axis=-1, keepdims=True))
        return h


def train(
    epoch: Epoch,
    validation: tuple[np.ndarray, np.ndarray],
    n_cells: int,
    seed: int,
    max_epochs: int,
    alpha: float = 1e-3,
    progress: Callable[[int, int], None] | None = None,
) -> tuple[Network, float]:
    """Learn, until the loss on validation streams no longer falls.

    Returns
    -------
    network : Network
        The average over epochs that was best on the validation streams.
    loss : float
        Its mean negative log probability of their true cells.
    """
    model = MLPClassifier(
        HIDDEN, alpha=alpha, batch_size=BATCH, learning_rate_init=LEARNING_RATE, random_state=seed
    )
    average: list[np.ndarray] = []
    best: tuple[float, int, Network | None] = (np.inf, 0, None)
    for number in range(max_epochs):
        x, cell = epoch(number)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            model.partial_fit(x, cell, classes=np.arange(n_cells))
        now = [*model.coefs_, *model.intercepts_]
        weight = min(AVERAGE, number / (number + 1))
        average = [weight * a + (1 - weight) * b for a, b in zip(average or now, now, strict=True)]
        half = len(average) // 2
        network = Network(tuple(map(_logits, average[:half])), tuple(map(_logits, average[half:])))
        loss = loss_of(network, *validation)
        if loss < best[0]:
            best = (loss, number, network)
        if progress is not None:
            progress(number + 1, max_epochs)
        if number - best[1] >= PATIENCE:
            break
    assert best[2] is not None
    return best[2], best[0]


def _logits(a: np.ndarray) -> np.ndarray:
    """Weights as numbers of half precision, far below their own scatter: files are half as large.

    Of two cells, scikit-learn has the second's alone, the first's are 0.
    """
    if a.shape[-1] == 1:
        a = np.concatenate([np.zeros_like(a), a], axis=-1)
    return a.astype(np.float16).astype(np.float32)


def loss_of(network: Network, x: np.ndarray, cell: np.ndarray) -> float:
    """Mean negative log probability of the true cells."""
    logs = network.log_probabilities(x.astype(np.float32))
    return float(-logs[np.arange(len(cell)), cell].mean())
