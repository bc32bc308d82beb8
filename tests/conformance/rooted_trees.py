"""Order conditions of Runge-Kutta methods by rooted trees.

J. C. Butcher's theory as in Hairer, Norsett and Wanner, Solving Ordinary Differential Equations I
(2nd ed., 1993), section II.2: a method has order p where for every rooted tree t of at most p
nodes ``sum_i b_i Phi_i(t) = 1/gamma(t)``. There are 1, 1, 2, 4, 9, 20, 48, 115 trees of 1 to 8
nodes. A tree is the tuple of the trees that hang on its root, in a fixed order.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

Tree = tuple[Any, ...]


@cache
def trees(nodes: int) -> tuple[Tree, ...]:
    """Every rooted tree of this many nodes."""
    return tuple(sorted(forests(nodes - 1, nodes - 1)))


@cache
def forests(nodes: int, largest: int) -> tuple[Tree, ...]:
    """Every multiset of trees of at most ``largest`` nodes each, ``nodes`` in all."""
    if nodes == 0:
        return ((),)
    found = set()
    for size in range(1, min(nodes, largest) + 1):
        for tree in trees(size):
            for rest in forests(nodes - size, size):
                found.add(tuple(sorted((tree, *rest), key=repr)))
    return tuple(found)


def size(tree: Tree) -> int:
    """Number of nodes."""
    return 1 + sum(size(child) for child in tree)


def density(tree: Tree) -> int:
    """gamma(t): the number of nodes times the densities of the subtrees."""
    product = size(tree)
    for child in tree:
        product *= density(child)
    return product


def weights(tree: Tree, A: np.ndarray) -> np.ndarray:
    """Phi(t), one elementary weight for each stage."""
    product = np.ones(len(A))
    for child in tree:
        product = product * (A @ weights(child, A))
    return product
