"""One declared change of the code that is searched.

A change is made in memory, in the very function or table that the services call, and taken back afterwards.
"""

import importlib
import inspect
import textwrap
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from types import FunctionType

from services.robot.core import motion
from tests.model.scope import SCOPES, Scope


@dataclass(frozen=True, slots=True)
class Mutation:
    """One change.

    Attributes
    ----------
    function
        Module and name of the function: "services.robot.core.motion:_table".
    before, after
        Text that stands in it once, and what stands there instead.
    scope
        Name of the scope in which it is looked for.
    """

    says: str
    function: str
    before: str
    after: str
    scope: str

    @property
    def where(self) -> Scope:
        """The scope."""
        return next(scope for scope in SCOPES if scope.name == self.scope)

    @contextmanager
    def applied(self) -> Iterator[None]:
        """The code with this change, for as long as the context lasts."""
        function = _function(self.function)
        source = textwrap.dedent(inspect.getsource(function))
        if source.count(self.before) != 1:
            raise ValueError(
                f"{self.function} has {source.count(self.before)} times {self.before!r}; mend the mutation"
            )
        names = dict(function.__globals__)
        exec(
            compile(
                "from __future__ import annotations\n" + source.replace(self.before, self.after), self.function, "exec"
            ),
            names,
        )
        original, function.__code__ = function.__code__, _bare(names[function.__name__]).__code__
        _make_tables_anew()
        try:
            yield
        finally:
            function.__code__ = original
            _make_tables_anew()


def _function(place: str) -> FunctionType:
    module, name = place.split(":")
    found: object = importlib.import_module(module)
    for part in name.split("."):
        found = inspect.getattr_static(found, part)
    return _bare(found)


def _bare(found: object) -> FunctionType:
    """The function itself, without what a decorator put around it."""
    if isinstance(found, property):
        found = found.fget
    found = inspect.unwrap(found) if callable(found) else found
    assert isinstance(found, FunctionType)
    return found


def _make_tables_anew() -> None:
    """The motion table is made once, at import."""
    motion.TABLE.clear()
    motion.TABLE.update(motion._table())
