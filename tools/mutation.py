"""Mutation testing: change one thing in a module, run its unit tests, and see whether one of them fails.

`tools/mutation.toml` names the modules and, for each, the tests that must notice. The changes are those of mutmut, and
three more: a condition is negated, a statement that is called for its effect is left out, an acceptance limit is moved
by a hundredth and its sense is turned. Texts (messages, docstrings, names on the wire, how many decimals a message
quotes), annotations and decorators are not changed. A mutant that cannot be imported does not count. Nothing on disk
changes: each mutant is compiled in a process of its own, forked from one that has imported the libraries, and limited
in processor time. As many run at the same time as there are processors.
"""

import argparse
import ast
import gc
import importlib
import multiprocessing
import os
import resource
import sys
import time
import tomllib
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from difflib import ndiff
from enum import IntEnum
from functools import cache
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec, SourceFileLoader
from importlib.util import spec_from_file_location
from pathlib import Path
from types import CodeType, ModuleType

import libcst as cst
import pytest
from mutmut.mutation.mutators import mutation_operators, operator_string

CONFIG = Path(__file__).with_suffix(".toml")
# Processor time of a mutant: a loop without an end stops here; the slowest module's tests take a tenth of it.
_LIMIT_S = 30
_AT_ONCE = os.cpu_count() or 1
_WORDING = {"decimals", "origin"}
_TURNED = {"at_least": "at_most", "at_most": "at_least"}
_TEXT = (cst.SimpleString, cst.FormattedString, cst.ConcatenatedString)
_UNCHANGED = (*_TEXT, cst.Annotation, cst.Decorator, cst.Import, cst.ImportFrom)


class Outcome(IntEnum):
    """What became of a mutant; the numbers are exit codes of its process."""

    SURVIVED = 0
    KILLED = 1
    NOT_IMPORTABLE = 77


@dataclass(frozen=True, slots=True)
class Target:
    """A module, the tests that must notice its mutants, and mutants that change nothing: line before, after, why."""

    source: str
    tests: list[str]
    equivalent: list[list[str]] = field(default_factory=list)

    @property
    def module(self) -> str:
        """The module's name."""
        return self.source.removesuffix(".py").removesuffix("/__init__").replace("/", ".")


def main(arguments: Sequence[str] | None = None) -> int:
    """Test every module that the arguments name and print a table; 1 if a module is below `--least`."""
    parser = argparse.ArgumentParser(prog="python -m tools.mutation", description=__doc__)
    parser.add_argument("only", nargs="*", help="parts of paths: test these modules alone")
    parser.add_argument("--least", type=float, default=0.9, help="smallest share of killed mutants (default 0.9)")
    options = parser.parse_args(arguments)
    targets = [Target(**entry) for entry in tomllib.loads(CONFIG.read_text())["target"]]
    chosen = [t for t in targets if not options.only or any(part in t.source for part in options.only)]
    rows, enough = [], True
    # Each module in a process of its own: what one has imported as a library may be the next one to be changed.
    with multiprocessing.get_context("fork").Pool(1, maxtasksperchild=1) as pool:
        for target, counts in zip(chosen, pool.imap(_test, chosen), strict=True):
            killed, total = counts[Outcome.KILLED], counts[Outcome.KILLED] + counts[Outcome.SURVIVED]
            enough &= killed >= options.least * total
            rows.append(f"| `{target.source}` | {killed} of {total} | {100.0 * killed / max(total, 1):.0f} % |")
            print(rows[-1], flush=True)
    print("\n".join(["", "| module | killed | share |", "|---|---|---|", *rows]))
    return 0 if enough else 1


def mutants(source: str) -> Iterator[str]:
    """Every source text that differs from `source` by one change."""
    module = cst.parse_module(source)
    texts = {name for node in _nodes(module) if _is_text(node) for name in _names(node)}
    for node in _nodes(module):
        for changed in _changes(node, texts):
            text = cst.ensure_type(module.deep_replace(node, changed), cst.Module).code
            if text != source:
                yield text


def _nodes(node: cst.CSTNode) -> Iterator[cst.CSTNode]:
    if isinstance(node, _UNCHANGED) or (isinstance(node, cst.Arg) and _is_wording(node)):
        return
    yield node
    for child in node.children:
        yield from _nodes(child)


def _changes(node: cst.CSTNode, texts: set[str]) -> Iterator[cst.CSTNode]:
    for kind, operator in mutation_operators:
        if isinstance(node, kind) and operator is not operator_string and not _is_text(node):
            yield from (changed for changed in operator(node) if not _loses_text(node, changed, texts))
    if isinstance(node, cst.If | cst.CompIf):
        test = node.test.with_changes(lpar=[cst.LeftParen()], rpar=[cst.RightParen()])
        yield node.with_changes(test=cst.UnaryOperation(cst.Not(), test))
    if isinstance(node, cst.Expr) and not isinstance(node.value, _TEXT):
        yield cst.Pass()
    if isinstance(node, cst.Call) and isinstance(node.func, cst.Name) and node.func.value in _TURNED:
        yield node.with_changes(func=cst.Name(_TURNED[node.func.value]))
        limit = node.args[0]
        if isinstance(limit.value, cst.Float):
            moved = cst.Float(repr(1.01 * float(limit.value.value)))
            yield node.with_changes(args=[limit.with_changes(value=moved), *node.args[1:]])


def _is_text(node: cst.CSTNode) -> bool:
    return isinstance(node, cst.Assign | cst.AnnAssign) and isinstance(node.value, _TEXT)


def _names(node: cst.CSTNode) -> Iterator[str]:
    targets = [target.target for target in node.targets] if isinstance(node, cst.Assign) else [node.children[0]]
    yield from (target.value for target in targets if isinstance(target, cst.Name))


def _is_wording(argument: cst.Arg) -> bool:
    """Whether an argument is a text, or changes nothing but a text."""
    return isinstance(argument.value, _TEXT) or (argument.keyword is not None and argument.keyword.value in _WORDING)


def _loses_text(node: cst.CSTNode, changed: cst.CSTNode, texts: set[str]) -> bool:
    """Whether a call differs only by a text, or the name of one, that is left out or replaced by None."""
    if not (isinstance(node, cst.Call) and isinstance(changed, cst.Call)):
        return False
    named = [a for a in node.args if isinstance(a.value, cst.Name) and a.value.value in texts]
    kept = [a for a in node.args if not _is_wording(a) and a not in named]
    return len(kept) < len(node.args) and all(any(a is b for b in changed.args) for a in kept)


class _Loader(SourceFileLoader):
    """Loads a module from a text in place of its file."""

    def __init__(self, name: str, path: str, text: str) -> None:
        super().__init__(name, path)
        self._text = text

    def get_code(self, fullname: str) -> CodeType:
        """Compile the text under the file's name."""
        return compile(self._text, self.get_filename(fullname), "exec", dont_inherit=True)


@dataclass(frozen=True)
class _Finder(MetaPathFinder):
    """Finds the mutant before its module."""

    target: Target
    text: str

    def find_spec(
        self,
        fullname: str,
        path: Sequence[str] | None,  # noqa: ARG002
        target: ModuleType | None = None,  # noqa: ARG002
        /,
    ) -> ModuleSpec | None:
        """Answer for the mutated module alone."""
        if fullname != self.target.module:
            return None
        file = str(Path(self.target.source).resolve())
        return spec_from_file_location(fullname, file, loader=_Loader(fullname, file, self.text))


def _test(target: Target) -> Counter[Outcome]:
    if target.module in sys.modules:
        raise RuntimeError(f"{target.module} is imported already; its mutants would not be")
    source = Path(target.source).read_text()
    _import_libraries(target, source)
    if [outcome for _, outcome in _outcomes(target, [source])] != [Outcome.SURVIVED]:
        raise RuntimeError(f"the tests of {target.source} fail without any change; run them with pytest and mend them")
    excused = {(before, after) for before, after, _ in target.equivalent}
    changes = {mutant: _changed_lines(source, mutant) for mutant in mutants(source)}
    counts: Counter[Outcome] = Counter()
    for mutant, outcome in _outcomes(target, [mutant for mutant, change in changes.items() if change not in excused]):
        counts[outcome] += 1
        if outcome is Outcome.SURVIVED:
            before, after = changes[mutant]
            print(f"{target.source}: survived\n  - {before}\n  + {after}", flush=True)
    for before, _ in excused - set(changes.values()):
        print(f"{target.source}: no such mutant any more: {before}")
    return counts


def _outcomes(target: Target, texts: Sequence[str]) -> Iterator[tuple[str, Outcome]]:
    """Run the tests against each text, as many at once as there are processors."""
    running: dict[int, str] = {}
    gc.freeze()  # pytest collects garbage when it ends; what the libraries hold need not be searched each time
    for text in texts:
        if len(running) == _AT_ONCE:
            yield _ended(running)
        running[_start(target, text)] = text
    while running:
        yield _ended(running)


def _ended(running: dict[int, str]) -> tuple[str, Outcome]:
    process, status = os.wait()
    code = os.waitstatus_to_exitcode(status)
    return running.pop(process), Outcome(code) if code in list(Outcome) else Outcome.KILLED


def _changed_lines(source: str, mutant: str) -> tuple[str, str]:
    lines = list(ndiff(source.splitlines(), mutant.splitlines()))
    before, after = ([line[2:].strip() for line in lines if line.startswith(sign)] for sign in "-+")
    return " ".join(before), " ".join(after)


def _import_libraries(target: Target, source: str) -> None:
    """Import all that the tests import and that does not depend on the module, so that no mutant has to."""
    to_read, to_write = os.pipe()
    process = _start(target, source, report_to=to_write)
    os.close(to_write)
    with os.fdopen(to_read) as pipe:
        names = [name for name in pipe.read().split() if name not in sys.modules]
    os.waitpid(process, 0)
    for name in names:
        if not _depends(name, target.module):
            try:
                importlib.import_module(name)
            except Exception:  # noqa: BLE001, S112  (some names in sys.modules cannot be imported by themselves)
                continue


@cache
def _depends(name: str, module: str) -> bool:
    """Whether one of our modules is another or imports it, also through others."""
    file = next(
        (f for f in (Path(*name.split("."), "__init__.py"), Path(f"{name.replace('.', '/')}.py")) if f.exists()), None
    )
    if name == module or name == "__main__" or file is None:
        return name in {module, "__main__"}
    imported = set()
    for node in ast.walk(ast.parse(file.read_text())):
        if isinstance(node, ast.Import):
            imported |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            imported |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
    packages = name.rpartition(".")[0]
    return any(_depends(other, module) for other in {*imported, packages} - {"", name})


def _start(target: Target, text: str, report_to: int | None = None) -> int:
    """Begin to run the tests against a text in a process of its own; its number."""
    child = os.fork()
    if child == 0:
        _run(target, text, report_to)
    return child


def _run(target: Target, text: str, report_to: int | None) -> None:
    silent = os.open(os.devnull, os.O_WRONLY)
    for stream in (1, 2):
        os.dup2(silent, stream)
    used_s = int(time.process_time())
    resource.setrlimit(resource.RLIMIT_CPU, (used_s + _LIMIT_S, used_s + _LIMIT_S))
    sys.meta_path.insert(0, _Finder(target, text))
    try:
        importlib.import_module(target.module)
    except BaseException:  # noqa: BLE001  (whatever a mutant raises, the process ends here)
        os._exit(Outcome.NOT_IMPORTABLE)
    code = Outcome.KILLED
    try:
        code = Outcome(min(int(pytest.main(["-x", "--assert=plain", "-p", "no:cacheprovider", *target.tests])), 1))
    finally:
        if report_to is not None:
            os.write(report_to, "\n".join(sys.modules).encode())
        os._exit(code)


if __name__ == "__main__":
    sys.exit(main())
