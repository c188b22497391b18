"""Small ways to break a file, one at a time: a sign, a term, a bound, a constant.

A mutant keeps every line where it is, so that functions can be told by their first line. Messages,
annotations, decorators, docstrings and options of compilation are left alone: to break them breaks
no value.
"""

from __future__ import annotations

import ast
import hashlib
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from tests.house.sources import ROOT, relative, text_of, tree_of

OPERATORS = {
    ast.Add: (ast.Sub,), ast.Sub: (ast.Add,), ast.Mult: (ast.Div,), ast.Div: (ast.Mult,),
    ast.FloorDiv: (ast.Mult,), ast.Mod: (ast.Mult,), ast.Pow: (ast.Mult,),
    ast.BitAnd: (ast.BitOr,), ast.BitOr: (ast.BitAnd,), ast.BitXor: (ast.BitOr,),
    ast.LShift: (ast.RShift,), ast.RShift: (ast.LShift,),
    ast.Lt: (ast.LtE, ast.Gt), ast.LtE: (ast.Lt, ast.GtE), ast.Gt: (ast.GtE, ast.Lt),
    ast.GtE: (ast.Gt, ast.LtE), ast.Eq: (ast.NotEq,), ast.NotEq: (ast.Eq,),
    ast.Is: (ast.IsNot,), ast.IsNot: (ast.Is,), ast.In: (ast.NotIn,), ast.NotIn: (ast.In,),
    ast.And: (ast.Or,), ast.Or: (ast.And,),
}  # fmt: skip
NAMES = {
    "min": "max", "max": "min", "minimum": "maximum", "maximum": "minimum", "floor": "ceil",
    "ceil": "floor", "sin": "cos", "cos": "sin", "any": "all", "all": "any", "argmin": "argmax",
    "argmax": "argmin", "isnan": "isfinite", "isfinite": "isnan", "logical_and": "logical_or",
    "logical_or": "logical_and", "zeros": "ones", "ones": "zeros",
}  # fmt: skip
WITHOUT = {"sqrt", "abs", "fabs", "hypot", "copysign"}
"""Calls that a mutant replaces by their first argument."""
UNTOUCHED_CALLS = {"compiled", "jitable", "njit", "assume_noalias", "cast", "TypeVar"}
HINTS = ("NOT_NEGATIVE",)
"""In names of what changes no value by design: a mask of all bits that a number has. Broken, it
costs every test."""
FACTOR = 1.5
"""What a number is multiplied by; far more than rounding, far less than nonsense."""
INDEX_MAX = 1000
"""An integer from here on is no index: one more of it would be lost in rounding."""


class Mutant(NamedTuple):
    """One small break of one file.

    Attributes
    ----------
    file : str
        Relative to the repository.
    line : int
    function : str
        Qualified name of what it stands in; "" at the level of the module.
    kind : str
        What is done: operator, term, number, name, bound, statement, condition, sign.
    before, after : str
        Text that is replaced, and by what.
    span : tuple of 2 ints
        Where, in bytes.
    """

    file: str
    line: int
    function: str
    kind: str
    before: str
    after: str
    span: tuple[int, int]

    @property
    def key(self) -> str:
        """Names the mutant as long as its file stays as it is."""
        text = text_of(ROOT / self.file)
        told = repr((self.file, self.span, self.after, text)).encode()
        return hashlib.blake2b(told, digest_size=10).hexdigest()

    def source(self) -> str:
        """The text of the broken file."""
        data = text_of(ROOT / self.file).encode()
        return (data[: self.span[0]] + self.after.encode() + data[self.span[1] :]).decode()

    def __str__(self) -> str:
        before, after = (" ".join(text.split()) for text in (self.before, self.after))
        return f"{self.file}:{self.line}: {self.function}: {before}  →  {after}"


def mutants(file: Path) -> list[Mutant]:
    """All mutants of a file, in the order of its text; none of them is the file itself."""
    found, seen = [], set()
    for one in _Finder(file).module():
        if (one.span, one.after) not in seen and " ".join(one.before.split()) != one.after:
            seen.add((one.span, one.after))
            found.append(one)
    return sorted(found, key=lambda one: (one.span, one.after))


class _Finder:
    def __init__(self, file: Path) -> None:
        self._file, self._data = file, text_of(file).encode()
        self._starts = [0]
        for line in self._data.splitlines(keepends=True):
            self._starts.append(self._starts[-1] + len(line))

    def module(self) -> Iterator[Mutant]:
        for statement in tree_of(self._file).body:
            yield from self._statement(statement, ())

    def _statement(self, node: ast.stmt, path: tuple[str, ...]) -> Iterator[Mutant]:
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            if _is_hint(node.name):
                return
            for default in getattr(getattr(node, "args", None), "defaults", []):
                yield from self._expression(default, path)
            for child in node.body:
                yield from self._statement(child, (*path, node.name))
            return
        if isinstance(node, ast.Raise | ast.Import | ast.ImportFrom | ast.Assert | ast.Global):
            return
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test):
            return
        if isinstance(node, ast.Assign):
            target = ast.unparse(node.targets[0])
            if "__all__" in target or target in HINTS:
                return
        is_text = isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
        if is_text or (isinstance(node, ast.Expr) and self._is_untouched(node.value)):
            return
        if path:
            yield from self._statements_gone(node, path)
        for name, value in ast.iter_fields(node):
            if name == "annotation":
                continue
            for child in value if isinstance(value, list) else [value]:
                if isinstance(child, ast.stmt):
                    yield from self._statement(child, path)
                elif isinstance(child, ast.AST):
                    yield from self._expression(child, path)

    def _statements_gone(self, node: ast.stmt, path: tuple[str, ...]) -> Iterator[Mutant]:
        """Without an assignment into an array or a call; with a turned condition; += as -=."""
        if isinstance(node, ast.AugAssign):
            swap = OPERATORS.get(type(node.op), ())
            for kind in swap:
                new = ast.AugAssign(node.target, kind(), node.value)
                yield self._mutant(node, path, "operator", ast.unparse(new), bare=True)
            yield self._mutant(node, path, "statement", "pass", bare=True)
        elif isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Subscript):
            yield self._mutant(node, path, "statement", "pass", bare=True)
        elif isinstance(node, ast.Expr) and isinstance(node.value, ast.Call):
            yield self._mutant(node, path, "statement", "pass", bare=True)
        elif isinstance(node, ast.Continue | ast.Break):
            yield self._mutant(node, path, "statement", "pass", bare=True)
        elif isinstance(node, ast.If | ast.While) and not isinstance(node.test, ast.Compare):
            turned = f"not ({ast.unparse(node.test)})"
            yield self._mutant(node.test, path, "condition", turned)

    def _is_untouched(self, node: ast.AST) -> bool:
        name = _name(node.func) if isinstance(node, ast.Call) else ""
        return name in UNTOUCHED_CALLS or _is_hint(name)

    def _expression(self, node: ast.AST, path: tuple[str, ...]) -> Iterator[Mutant]:
        if isinstance(node, ast.JoinedStr) or self._is_untouched(node):
            return
        if isinstance(node, ast.BinOp) and _is_hint(_name(node.right)):
            yield from self._expression(node.left, path)
            return
        # what `zip` would raise with `strict`, no working code does
        if isinstance(node, ast.keyword) and node.arg == "strict":
            return
        yield from self._of_expression(node, path)
        children = list(ast.iter_child_nodes(node))
        # a call of the error's kind is a message; so is the format of a number
        if isinstance(node, ast.Call) and _name(node.func).endswith("Error"):
            return
        for child in children:
            yield from self._expression(child, path)

    def _of_expression(self, node: ast.AST, path: tuple[str, ...]) -> Iterator[Mutant]:
        if isinstance(node, ast.BinOp) and not _is_text(node):
            for kind in OPERATORS.get(type(node.op), ()):
                new = ast.BinOp(node.left, kind(), node.right)
                yield self._mutant(node, path, "operator", ast.unparse(new))
            yield self._mutant(node, path, "term", ast.unparse(node.left))
            if isinstance(node.op, ast.Add | ast.Mult):
                yield self._mutant(node, path, "term", ast.unparse(node.right))
        elif isinstance(node, ast.BoolOp):
            for kind in OPERATORS[type(node.op)]:
                yield self._mutant(
                    node, path, "operator", ast.unparse(ast.BoolOp(kind(), node.values))
                )
            for part in node.values:
                yield self._mutant(node, path, "condition", ast.unparse(part))
        elif isinstance(node, ast.Compare) and len(node.ops) == 1:
            for kind in OPERATORS.get(type(node.ops[0]), ()):
                new = ast.Compare(node.left, [kind()], node.comparators)
                yield self._mutant(node, path, "bound", ast.unparse(new))
        elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub | ast.Not | ast.Invert):
            yield self._mutant(node, path, "sign", ast.unparse(node.operand))
        elif isinstance(node, ast.Constant):
            yield from self._of_number(node, path)
        elif isinstance(node, ast.Call):
            yield from self._of_call(node, path)

    def _of_number(self, node: ast.Constant, path: tuple[str, ...]) -> Iterator[Mutant]:
        value = node.value
        if isinstance(value, bool):
            yield self._mutant(node, path, "number", repr(not value))
        elif isinstance(value, int):
            # an integer of a module is a setting, a small one of a function an index or a bound
            is_index = value < INDEX_MAX and bool(path)
            new = value + 1 if is_index or value < 3 else round(FACTOR * value)
            yield self._mutant(node, path, "number", repr(new))
        elif isinstance(value, float):
            yield self._mutant(node, path, "number", repr(FACTOR * value if value else 1.0))

    def _of_call(self, node: ast.Call, path: tuple[str, ...]) -> Iterator[Mutant]:
        name = _name(node.func)
        function = ast.unparse(node.func)
        if name in NAMES:
            new = function[: len(function) - len(name)] + NAMES[name]
            yield self._mutant(node.func, path, "name", new, bare=True)
        if name in WITHOUT and node.args:
            yield self._mutant(node, path, "term", ast.unparse(node.args[0]))
        if name == "range" and not node.keywords and path:
            arguments = [ast.unparse(argument) for argument in node.args]
            if len(arguments) == 1:
                after = [f"range({arguments[0]} - 1)", f"range(1, {arguments[0]})"]
            else:
                rest = "".join(f", {argument}" for argument in arguments[2:])
                after = [f"range({arguments[0]}, {arguments[1]} - 1{rest})",
                         f"range({arguments[0]} + 1, {arguments[1]}{rest})"]  # fmt: skip
            for text in after:
                yield self._mutant(node, path, "bound", text)

    def _mutant(
        self, node: ast.AST, path: tuple[str, ...], kind: str, after: str, *, bare: bool = False
    ) -> Mutant:
        start = self._starts[node.lineno - 1] + node.col_offset
        end = self._starts[node.end_lineno - 1] + node.end_col_offset
        before = self._data[start:end].decode()
        gone = before.count("\n")
        after = after + "\n" * gone if bare else f"({after}" + "\n" * gone + ")"
        return Mutant(
            relative(self._file), node.lineno, ".".join(path), kind, before, after, (start, end)
        )


def _name(function: ast.AST) -> str:
    """The last part of the name of what is called."""
    if isinstance(function, ast.Attribute):
        return function.attr
    return function.id if isinstance(function, ast.Name) else ""


def _is_hint(name: str) -> bool:
    return any(hint in name for hint in HINTS)


def _is_text(node: ast.BinOp) -> bool:
    """Whether texts are put together."""
    return any(
        isinstance(part, ast.JoinedStr)
        or (isinstance(part, ast.Constant) and isinstance(part.value, str))
        for part in (node.left, node.right)
    )
