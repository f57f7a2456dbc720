"""What the data say about the parameters, and what they do not."""

from typing import NamedTuple

import numpy as np

_NAMED = 4  # so many parameters of a combination are named
_SMALLEST = 0.1  # weight of those that are
_LARGEST_STD = 1.0  # relative standard deviation beyond which a combination counts as unknown


class Combination(NamedTuple):
    """A direction in the space of parameters.

    Attributes:
      std: standard deviation along it, relative.
      weights: (p,) of the parameters, of length one.
      text: the same in words.
    """

    std: float
    weights: np.ndarray
    text: str


def covariance(information: np.ndarray, scale: np.ndarray) -> np.ndarray:
    """Inverse of the information; what is not determined is large, not infinite.

    Args:
      information: (p, p) inverse covariance of the coordinates.
      scale: (p,) size of each coordinate.
    """
    values, vectors = _directions(information, scale)
    inverse = (vectors / values) @ vectors.T
    return inverse * scale[:, None] * scale[None, :]


def undetermined(
    information: np.ndarray, scale: np.ndarray, labels: tuple[str, ...]
) -> list[Combination]:
    """Combinations of the parameters that the data do not determine to within their own size.

    Args:
      information: (p, p) inverse covariance of the coordinates.
      scale: (p,) size of each coordinate.
      labels: their names.
    """
    values, vectors = _directions(information, scale)
    std = 1 / np.sqrt(values)
    unknown = np.nonzero(std > _LARGEST_STD)[0]
    return [
        Combination(float(std[i]), vectors[:, i], _in_words(vectors[:, i], labels)) for i in unknown
    ]


def _directions(information: np.ndarray, scale: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Eigenvalues, the least first, and eigenvectors in relative coordinates."""
    relative = information * scale[:, None] * scale[None, :]
    values, vectors = np.linalg.eigh((relative + relative.T) / 2)
    # Smaller ones are rounding.
    least = len(scale) * np.finfo(information.dtype).eps * max(values[-1], 1e-30)
    return np.maximum(values, least), vectors


def _in_words(weights: np.ndarray, labels: tuple[str, ...]) -> str:
    order = np.argsort(-np.abs(weights))[:_NAMED]
    weights = weights * np.sign(weights[order[0]])
    terms = [f"{weights[i]:+.2f} {labels[i]}" for i in order if abs(weights[i]) > _SMALLEST]
    more = (np.abs(weights) > _SMALLEST).sum() > len(terms)
    return " ".join(terms).removeprefix("+") + (" and others" if more else "")
