"""The limit of one core: the recursion in C++ with the sizes as template arguments."""

from benchmarks.limit.limit import Limit, compiler

__all__ = ["Limit", "compiler"]
