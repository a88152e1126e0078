"""A number with a name says where it comes from: in a comment above or beside it, or as a declared value or limit."""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

_ROOT = Path(__file__).parents[3]
_FOLDERS = ("services", "shared")
# Declarations whose fields carry unit, effect and origin.
_DECLARED = ("tuning.py", "settings.py")
_FREE = (0, 1, 2)


def _is_number(value: ast.expr) -> bool:
    """Whether an expression is made of numbers alone, and of others than a count of nothing, one or a pair."""
    allowed = (ast.Constant, ast.Tuple, ast.UnaryOp, ast.BinOp, ast.operator, ast.unaryop, ast.expr_context)
    nodes = list(ast.walk(value))
    numbers = [n.value for n in nodes if isinstance(n, ast.Constant) and type(n.value) in (int, float)]
    return all(isinstance(n, allowed) for n in nodes) and any(number not in _FREE for number in numbers)


def _has_comment(lines: list[str], node: ast.stmt) -> bool:
    """Whether a comment stands beside a statement, or above it within the same block of lines."""
    first, last = node.lineno - 1, node.end_lineno or node.lineno
    if any("#" in line for line in lines[first:last]):
        return True
    while first > 0 and lines[first - 1].strip():
        first -= 1
        if lines[first].lstrip().startswith("#"):
            return True
    return False


def _is_docstring(node: ast.stmt | None) -> bool:
    return isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)


def unexplained(source: str) -> Iterator[str]:
    """Statements that give a number a name and no reason."""
    lines, body = source.splitlines(), ast.parse(source).body
    for node, following in zip(body, [*body[1:], None], strict=True):
        value = node.value if isinstance(node, ast.Assign | ast.AnnAssign) else None
        if value is None or not _is_number(value):
            continue
        if not (_has_comment(lines, node) or _is_docstring(following)):
            yield f"line {node.lineno}: {lines[node.lineno - 1]}"


@pytest.mark.parametrize("folder", _FOLDERS)
def test_every_named_number_has_a_reason(folder: str) -> None:
    found = [
        f"{file.relative_to(_ROOT)}, {one}"
        for file in sorted((_ROOT / folder).rglob("*.py"))
        if file.name not in _DECLARED
        for one in unexplained(file.read_text(encoding="utf-8"))
    ]
    assert found == []


@pytest.mark.parametrize(
    ("source", "count"),
    [
        ("_LIMIT = 7.5\n", 1),
        ("# chosen\n_LIMIT = 7.5\n", 0),
        ("_LIMIT = 7.5  # chosen\n", 0),
        ('LIMIT = 7.5\n"""Chosen."""\n', 0),
        ("# of something else\n\n_LIMIT = 7.5\n", 1),
        ("_PAIR = (3, -4 * 2**20)\n", 1),
        ("_ONE = 1\n_NAMES = ('a', 'b')\n", 0),
    ],
)
def test_what_counts_as_a_reason(source: str, count: int) -> None:
    assert len(list(unexplained(source))) == count
