"""Order conditions of Runge-Kutta methods and of additive pairs, by rooted trees.

J. C. Butcher's theory as in Hairer, Norsett and Wanner, Solving Ordinary Differential Equations I
(2nd ed., 1993), section II.2: a method has order p if ``sum_i b_i Phi_i(t) = 1/gamma(t)`` for
every rooted tree t of at most p nodes. There are 1, 1, 2, 4, 9, 20, 48, 115 trees of 1 to 8 nodes.
For a pair each edge of a tree belongs to one of the two methods (Kennedy and Carpenter, Applied
Numerical Mathematics 44 (2003) 139-181, section 2.1, with common weights).

A tree is the sorted tuple of the branches on its root; a branch is a pair of the method of its edge
and the tree at its end.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
Tree = tuple[Any, ...]


@cache
def trees(nodes: int, methods: int = 1) -> tuple[Tree, ...]:
    """Return every rooted tree with ``nodes`` nodes and edges of ``methods`` methods."""
    return _forests(nodes - 1, nodes - 1, methods)


@cache
def _forests(nodes: int, largest: int, methods: int) -> tuple[Tree, ...]:
    """Return every multiset of branches of at most ``largest`` nodes each, ``nodes`` in total."""
    if nodes == 0:
        return ((),)
    found: set[Tree] = set()
    for size in range(1, min(nodes, largest) + 1):
        branches = [(method, tree) for method in range(methods) for tree in trees(size, methods)]
        for rest in _forests(nodes - size, size, methods):
            found.update(tuple(sorted((branch, *rest))) for branch in branches)
    return tuple(sorted(found))


@cache
def size(tree: Tree) -> int:
    """Return the number of nodes of a tree."""
    return 1 + sum(size(child) for _, child in tree)


@cache
def density(tree: Tree) -> int:
    """Return gamma(t): the number of nodes times the densities of the branches."""
    product = size(tree)
    for _, child in tree:
        product *= density(child)
    return product


def elementary_weights(tree: Tree, *A: FloatArray) -> FloatArray:
    """Return Phi(t) (s,) of methods with coefficients ``A``, each (s, s)."""
    return _weights(tree, A, {})


def _weights(tree: Tree, A: tuple[FloatArray, ...], known: dict[Tree, FloatArray]) -> FloatArray:
    if tree not in known:
        product = np.ones(len(A[0]))
        for method, child in tree:
            product = product * (A[method] @ _weights(child, A, known))
        known[tree] = product
    return known[tree]


def largest_miss(
    order: int, b: FloatArray, *A: FloatArray, exact: float = 1.0
) -> tuple[float, int]:
    """Return the largest residual of an order condition, and the number of nodes of its tree.

    Args:
        order: maximum number of nodes of the trees.
        b: (s,) weights. A: (s, s) coefficients of the methods that share them.
        exact: 1 for the weights of a new point, 0 for those of an error estimate.
    """
    known: dict[Tree, FloatArray] = {}
    worst, where = 0.0, 0
    for nodes in range(1, order + 1):
        for tree in trees(nodes, len(A)):
            miss = abs(float(b @ _weights(tree, A, known)) - exact / density(tree))
            if not miss <= worst:
                worst, where = miss, nodes
    return worst, where
