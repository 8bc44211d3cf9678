"""Pairs of blocks that may touch soon: by their bounding spheres, class of size by class of size."""

from __future__ import annotations

import numpy as np

__all__ = ["near_pairs", "neighbour_entries"]

# A class holds bounding radii within this factor, so that small blocks are not searched with the reach of large ones.
_CLASS = 1.6


def near_pairs(position: np.ndarray, bound: np.ndarray, skin: float) -> np.ndarray:
    """Pairs i < j of blocks whose bounding spheres are less than a skin apart, sorted.

    Parameters
    ----------
    position : numpy.ndarray, shape (n, 3)
        [m].
    bound : numpy.ndarray, shape (n,)
        Bounding radii [m].
    skin : float
        [m].

    Returns
    -------
    numpy.ndarray of int32, shape (m, 2)
    """
    from scipy.spatial import cKDTree

    # Sizes differ by 7 and more: a tree for each class of size.
    size_class = np.floor(np.log(bound / bound.min()) / np.log(_CLASS)).astype(int)
    members = [np.flatnonzero(size_class == c) for c in np.unique(size_class)]
    trees = [cKDTree(position[m]) for m in members]
    reach = [float(bound[m].max()) for m in members]
    found = []
    for a, (tree, mine) in enumerate(zip(trees, members, strict=True)):
        own = tree.query_pairs(2.0 * reach[a] + skin, output_type="ndarray")
        found.append(mine[own])
        for b in range(a):
            # The larger are fewer: each asks for the smaller about it.
            lists = trees[b].query_ball_point(position[mine], reach[a] + reach[b] + skin)
            counts = np.fromiter((len(x) for x in lists), np.int64, len(lists))
            if counts.sum():
                small = members[b][np.concatenate([np.asarray(x, dtype=np.int64) for x in lists if x])]
                found.append(np.stack([np.repeat(mine, counts), small], axis=1))
    pairs = np.concatenate(found)
    apart = position[pairs[:, 0]] - position[pairs[:, 1]]
    near = np.einsum("ij,ij->i", apart, apart) < (bound[pairs[:, 0]] + bound[pairs[:, 1]] + skin) ** 2
    pairs = np.sort(pairs[near], axis=1)
    return pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))].astype(np.int32)


def neighbour_entries(pairs: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Of each block its pairs in their order: first entry, shape (n + 1,), and the entries 2 p + side, shape (2 m,)."""
    block = pairs.T.ravel()
    entry = np.concatenate([2 * np.arange(len(pairs)), 2 * np.arange(len(pairs)) + 1])
    order = np.lexsort((entry, block))
    first = np.searchsorted(block[order], np.arange(count + 1))
    return first.astype(np.int32), entry[order].astype(np.int32)


def matching_rows(old: np.ndarray, new: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Rows of two sorted lists of pairs that are the same pair: their places in the old and in the new list."""
    key_old = old[:, 0].astype(np.int64) * count + old[:, 1]
    key_new = new[:, 0].astype(np.int64) * count + new[:, 1]
    _, there, here = np.intersect1d(key_old, key_new, assume_unique=True, return_indices=True)
    return there, here
