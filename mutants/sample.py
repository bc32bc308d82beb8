"""The fixed sample of mutants: where they are, and the changed source of each.

Cosmic Ray makes the mutants. Candidates are ordered by a hash of file name, text of the line,
operator and occurrence in the file among equal lines. Neither the folder nor the number of a line
counts, so the sample stays nearly the same when code is added or files move.
"""

from __future__ import annotations

from ast import literal_eval
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cache, cached_property
from hashlib import sha256
from pathlib import Path
from typing import Any

from cosmic_ray.ast import ast_nodes, get_ast
from cosmic_ray.mutating import mutate_code
from cosmic_ray.plugins import get_operator

from mutants.areas import AREAS
from mutants.equivalent import EQUIVALENT
from mutants.groups import ROOT, Group

#: Errors that people make. Others, such as ``<<`` for ``*``, stop nearly every program.
OPERATORS = (
    *(
        f"ReplaceBinaryOperator_{pair}"
        for pair in ("Add_Sub", "Sub_Add", "Mul_Div", "Div_Mul", "FloorDiv_Mul", "Mod_FloorDiv")
    ),
    *(
        f"ReplaceComparisonOperator_{pair}"
        for pair in ("Lt_LtE", "LtE_Lt", "Gt_GtE", "GtE_Gt", "Lt_GtE", "LtE_Gt", "Gt_LtE", "GtE_Lt")
    ),
    "ReplaceComparisonOperator_Eq_NotEq",
    "ReplaceComparisonOperator_NotEq_Eq",
    "ReplaceComparisonOperator_Is_IsNot",
    "ReplaceComparisonOperator_IsNot_Is",
    "ReplaceUnaryOperator_Delete_USub",
    "ReplaceUnaryOperator_Delete_Not",
    "AddNot",
    "ReplaceTrueWithFalse",
    "ReplaceFalseWithTrue",
    "ReplaceAndWithOr",
    "ReplaceOrWithAnd",
    "ReplaceBreakWithContinue",
    "ReplaceContinueWithBreak",
    "ExceptionReplacer",
    "NumberReplacer",
    "ZeroIterationForLoop",
)

#: Syntax in which a change has no effect on a program that works: annotations, decorators,
#: assertions, which only detect errors of their callers, and numbers in messages.
_WITHOUT_EFFECT = {"tfpdef", "decorator", "assert_stmt", "fstring_expr"}

#: Leaves of the syntax tree that no operator changes.
_UNCHANGED = {"name", "string", "newline", "endmarker"}
_PUNCTUATION = {*"()[]{},.:="}

#: A change by 1 of a larger number is no error of interest.
_LARGEST = 50.0


@dataclass(frozen=True)
class Mutant:
    """One small change of one file.

    file: path from the root of the repository. line: counted from 1. operator: name of Cosmic Ray.
    occurrence: which place in the file the operator changes, counted from 0. text, ordinal: the
    line, and which of the equal lines of the file. nth: which change of the operator in this line.
    """

    area: str
    group: Group
    file: str
    line: int
    operator: str
    occurrence: int
    text: str
    ordinal: int
    nth: int

    @property
    def rank(self) -> tuple[str, str, str]:
        """Position in the order of candidates: by line, operator, and place in the line."""
        line = f"{Path(self.file).name}\n{self.text}\n{self.ordinal}"
        operator = f"{line}\n{self.operator}"
        return _hash(line), _hash(operator), _hash(f"{operator}\n{self.nth}")

    def applied(self, code: str) -> str:
        """Return the text of the file with the change."""
        changed = mutate_code(code, get_operator(f"core/{self.operator}")(), self.occurrence)
        assert changed is not None, self
        return changed

    @cached_property
    def change(self) -> tuple[str, str]:
        """The changed lines before and after, stripped and joined."""
        code = (ROOT / self.file).read_text(encoding="utf-8")
        before, after = code.splitlines(), self.applied(code).splitlines()
        while before[0] == after[0]:
            del before[0], after[0]
        while before[-1] == after[-1]:
            del before[-1], after[-1]
        return _joined(before), _joined(after)

    @property
    def equivalent(self) -> bool:
        """Whether the change is listed as one without an effect."""
        listed = EQUIVALENT.get(Path(self.file).name)
        return listed is not None and self.change in listed

    def __str__(self) -> str:
        before, after = self.change
        return f"{self.file}:{self.line}: {before}  ->  {after}"


def sample(areas: Iterable[str] = tuple(AREAS)) -> list[Mutant]:
    """Return the mutants of these areas: of each line at most one, equivalent ones left out."""
    chosen = []
    for name in areas:
        lines: set[tuple[str, int]] = set()
        for mutant in sorted(_candidates(name), key=lambda mutant: mutant.rank):
            if len(lines) == AREAS[name].mutants:
                break
            if (mutant.file, mutant.line) not in lines and not mutant.equivalent:
                lines.add((mutant.file, mutant.line))
                chosen.append(mutant)
    return chosen


def mutants_at(place: str) -> list[Mutant]:
    """Return all mutants at ``FILE:LINE``, equivalent ones too."""
    file, _, line = place.rpartition(":")
    return [
        mutant
        for name in AREAS
        for mutant in _candidates(name)
        if (mutant.file, str(mutant.line)) == (file, line)
    ]


def _joined(lines: list[str]) -> str:
    return " ".join(line.strip() for line in lines)


def _hash(text: str) -> str:
    return sha256(text.encode()).hexdigest()


def _candidates(area: str) -> Iterator[Mutant]:
    for path, group in AREAS[area].files():
        yield from _in_file(area, group, path.relative_to(ROOT).as_posix())


def _in_file(area: str, group: Group, file: str) -> Iterator[Mutant]:
    lines = [line.strip() for line in (ROOT / file).read_text(encoding="utf-8").splitlines()]
    equal: Counter[str] = Counter()
    ordinals = []
    for text in lines:
        equal[text] += 1
        ordinals.append(equal[text])
    found: Counter[tuple[str, int]] = Counter()
    for operator, occurrence, line in _places(file):
        text, ordinal, nth = lines[line - 1], ordinals[line - 1], found[operator, line]
        found[operator, line] += 1
        yield Mutant(area, group, file, line, operator, occurrence, text, ordinal, nth)


@cache
def _places(file: str) -> list[tuple[str, int, int]]:
    """Operator, occurrence and line of every change of a file that can have an effect."""
    places: list[tuple[str, int, int]] = []
    seen: Counter[str] = Counter()
    operators = [(name, get_operator(f"core/{name}")()) for name in OPERATORS]
    for node in ast_nodes(get_ast((ROOT / file).read_text(encoding="utf-8"))):
        if node.type in _UNCHANGED or getattr(node, "value", "") in _PUNCTUATION:
            continue
        for name, operator in operators:
            for (line, _), _ in operator.mutation_positions(node):
                if not _without_effect(node):
                    places.append((name, seen[name], line))
                seen[name] += 1
    return places


def _without_effect(node: Any) -> bool:
    if node.type == "number" and abs(literal_eval(node.value)) > _LARGEST:
        return True
    # Cosmic Ray changes plain names of exceptions only, and writes ``not`` without parentheses.
    if node.type == "except_clause" and "." in node.get_code():
        return True
    if node.type in ("if_stmt", "while_stmt") and node.children[1].type == "namedexpr_test":
        return True
    while node.parent is not None:
        if node.type in _WITHOUT_EFFECT or _is_annotation(node):
            return True
        if node.type == "if_stmt" and "TYPE_CHECKING" in node.children[1].get_code():
            return True
        # zip(..., strict=True): detects errors of the code around it.
        if node.type == "argument" and node.children[0].get_code().strip() == "strict":
            return True
        node = node.parent
    return False


def _is_annotation(node: Any) -> bool:
    """Whether a node is the annotation of a variable or a result."""
    if node.parent.type == "annassign":
        return node.parent.children[1] is node
    return node.parent.type == "funcdef" and node.parent.annotation is node
