"""Source of the client's calls, and of the methods that make them, once plain and once with `await`."""

import re
from collections.abc import Sequence
from typing import Final

from tools.client.operations import Operation, Parameter

_HEAD: Final = '''"""{about}

Written by `make generated` from `docs/openapi.json`; do not edit.
"""

'''
_NO_MODELS: Final = frozenset({"Page", "Literal", "None"})
_KEYWORDS: Final = (
    ("if_match", "str | None", "None"),
    ("idempotency_key", "str | None", "None"),
)


def calls_source(operations: Sequence[Operation]) -> str:
    """`calls.py`: a function for each operation, which says what to send and what comes back."""
    head = _HEAD.format(about="What each operation sends, and what it answers with: pure, for both clients.")
    imports = (
        "from collections.abc import Sequence\nfrom datetime import datetime\nfrom typing import Literal\n\n"
        "from distalock.client.base import Page\nfrom distalock.client.call import Call, escaped, new_key, query\n"
        f"from distalock.client.models import {', '.join(_models(operations))}\n"
    )
    return head + imports + "".join(map(_call_function, operations))


def methods_source(operations: Sequence[Operation], *, is_async: bool) -> str:
    """`methods.py` or `async_methods.py`: a method for each operation, and one that walks each list."""
    name, says = ("AsyncMethods", "awaited") if is_async else ("Methods", "answered at once")
    iterator = "AsyncIterator" if is_async else "Iterator"
    head = _HEAD.format(about=f"A method for each operation, {says}.")
    imports = (
        f"from abc import ABC, abstractmethod\nfrom collections.abc import {iterator}, Sequence\n"
        "from datetime import datetime\nfrom typing import Literal, TypeVar\n\n"
        "from distalock.client import calls\nfrom distalock.client.base import Page\n"
        "from distalock.client.call import Call\n"
        f"from distalock.client.models import {', '.join(_models(operations))}\n\n"
        'T = TypeVar("T")\n'
    )
    wait = "async " if is_async else ""
    base = (
        f'\n\nclass {name}(ABC):\n    """The interface\'s operations; see `docs/rest.md` for what they do."""\n\n'
        f'    @abstractmethod\n    {wait}def send(self, call: Call[T]) -> T:\n        """What is answered to a call; '
        'raises `RequestRefused`."""\n'
    )
    return head + imports + base + "".join(_method(one, is_async=is_async) for one in operations)


def _call_function(operation: Operation) -> str:
    arguments = [repr(operation.method), _path(operation.path, operation)]
    arguments.append(operation.answer or "type(None)")
    if operation.query:
        pairs = ", ".join(f"({one.name!r}, {one.name})" for one in operation.query)
        arguments.append(f"query=query({pairs})")
    if operation.body:
        arguments.append("body=body")
    if operation.is_keyed:
        arguments.append("key=idempotency_key or new_key()")
    if operation.matches:
        arguments += [f"matches={_path(operation.matches, operation)}", "if_match=if_match"]
    answer = operation.answer or "None"
    return (
        f"\n\ndef {operation.name}({_signature(operation)}) -> Call[{answer}]:\n    {_docstring(operation.says, 4)}\n"
        f"    return Call({', '.join(arguments)})\n"
    )


def _path(path: str, operation: Operation) -> str:
    """Source of a path with what stands for its parameters."""
    for one in operation.path_parameters:
        if one.kind == "str":
            path = path.replace(f"{{{one.name}}}", f"{{escaped({one.name})}}")
    return f'f"{path}"' if "{" in path else f'"{path}"'


def _method(operation: Operation, *, is_async: bool) -> str:
    wait, pause = ("async ", "await ") if is_async else ("", "")
    says = _docstring(operation.says, 8)
    call = f"calls.{operation.name}({_passed(operation)})"
    plain = (
        f"\n    {wait}def {operation.name}({_signature(operation, 'self')}) -> {operation.answer or 'None'}:\n"
        f"        {says}\n        return {pause}self.send({call})\n"
    )
    return plain + (_walk(operation, is_async=is_async) if operation.is_page else "")


def _walk(operation: Operation, *, is_async: bool) -> str:
    """A method that walks through all pages of a list."""
    wait, pause, iterator = ("async ", "await ", "AsyncIterator") if is_async else ("", "", "Iterator")
    # `yield from` is not there for what is awaited.
    walked = "for item in page.items:\n                yield item" if is_async else "yield from page.items"
    item = re.fullmatch(r"Page\[(\w+)\]", operation.answer or "")
    assert item is not None
    name = "iterate_" + operation.name.removeprefix("list_").removeprefix("read_")
    return (
        f"\n    {wait}def {name}({_signature(operation, 'self', without=('cursor',))}) -> {iterator}[{item[1]}]:\n"
        f'        """The same, item by item through all pages."""\n'
        "        cursor: str | None = None\n        while True:\n"
        f"            page = {pause}self.send(calls.{operation.name}({_passed(operation)}))\n"
        f"            {walked}\n"
        "            if page.next_cursor is None:\n                return\n            cursor = page.next_cursor\n"
    )


def _signature(operation: Operation, *first: str, without: Sequence[str] = ()) -> str:
    """Parameters: places and body in order, everything else by name."""
    placed = [*first, *(f"{one.name}: {one.kind}" for one in operation.path_parameters)]
    if operation.body:
        placed.append(f"body: {operation.body}" + ("" if operation.body_needed else f" = {operation.body}()"))
    named = [_named(one) for one in operation.query if one.name not in without]
    named += [f"{name}: {kind} = {default}" for name, kind, default in _headers(operation)]
    return ", ".join([*placed, *(["*", *named] if named else [])])


def _named(parameter: Parameter) -> str:
    default = "" if parameter.default is None else f" = {parameter.default}"
    return f"{parameter.name}: {parameter.kind}{default}"


def _headers(operation: Operation) -> list[tuple[str, str, str]]:
    there = {"if_match": operation.matches is not None, "idempotency_key": operation.is_keyed}
    return [one for one in _KEYWORDS if there[one[0]]]


def _passed(operation: Operation) -> str:
    placed = [one.name for one in operation.path_parameters] + (["body"] if operation.body else [])
    named = [one.name for one in operation.query] + [name for name, _, _ in _headers(operation)]
    return ", ".join([*placed, *(f"{name}={name}" for name in named)])


def _docstring(says: str, indent: int) -> str:
    lines = says.strip().splitlines()
    text = f"\n{' ' * indent}".join(line.strip() for line in lines).replace(f"\n{' ' * indent}\n", "\n\n")
    return f'"""{text}' + (f"\n{' ' * indent}" if len(lines) > 1 else "") + '"""'


def _models(operations: Sequence[Operation]) -> list[str]:
    """Names of models that the operations' signatures use."""
    texts = [one.body or "" for one in operations] + [one.answer or "" for one in operations]
    return sorted({name for text in texts for name in re.findall(r"\b[A-Z]\w+", text)} - _NO_MODELS)
