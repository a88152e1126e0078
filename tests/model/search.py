"""Explicit-state search, breadth first: all states that steps lead to, and a shortest way to one that breaks a rule."""

import time
from collections import deque
from collections.abc import Callable, Hashable, Iterable
from dataclasses import dataclass, field
from typing import Generic, TypeVar

State = TypeVar("State", bound=Hashable)


@dataclass(frozen=True, slots=True)
class Step(Generic[State]):
    """One thing that can happen in a state.

    Attributes
    ----------
    label
        What happens, for a trace.
    after
        The state that follows.
    broken
        Names of properties that this very step breaks.
    helps
        Whether it is an action of people, or what follows by itself when nothing fails: only such steps count as a way
        out.
    """

    label: str
    after: State
    broken: tuple[str, ...] = ()
    helps: bool = False


@dataclass(frozen=True, slots=True)
class Violation:
    """A property that does not hold, and a shortest way there: label of each step, description of each state."""

    property_name: str
    trace: tuple[tuple[str, str], ...]

    def __str__(self) -> str:
        steps = (f"{number:3d}. {label}\n       {state}" for number, (label, state) in enumerate(self.trace))
        return "\n".join((f"violated: {self.property_name}", *steps))


@dataclass(slots=True)
class Searched(Generic[State]):
    """What a search has found.

    Attributes
    ----------
    depth
        Longest of the shortest ways to a state.
    complete
        Whether every reachable state was visited: a search ends at the first violation.
    """

    states: int = 0
    transitions: int = 0
    depth: int = 0
    seconds: float = 0.0
    complete: bool = False
    violation: Violation | None = None
    labels: dict[str, int] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Model(Generic[State]):
    """What is searched.

    Attributes
    ----------
    steps
        Everything that can happen in a state.
    broken
        Names of the properties that a state breaks.
    is_goal
        States of which one must remain reachable from every state by steps that help.
    describe
        A state in one line.
    """

    starts: tuple[State, ...]
    steps: Callable[[State], Iterable[Step[State]]]
    broken: Callable[[State], tuple[str, ...]]
    is_goal: Callable[[State], bool]
    describe: Callable[[State], str]
    goal_name: str


class _Visited(Generic[State]):
    """States in the order of their discovery, each with how it was reached first."""

    def __init__(self) -> None:
        self.number: dict[State, int] = {}
        self.states: list[State] = []
        self.reached: list[tuple[int, str]] = []
        self.depth: list[int] = []
        self.ways_in: list[list[int]] = []  # by steps that help

    def add(self, state: State, before: int, label: str) -> int | None:
        """The state's number when it is new."""
        if state in self.number:
            return None
        number = len(self.states)
        self.number[state] = number
        self.states.append(state)
        self.reached.append((before, label))
        self.depth.append(0 if before < 0 else self.depth[before] + 1)
        self.ways_in.append([])
        return number

    def trace(self, number: int, describe: Callable[[State], str]) -> tuple[tuple[str, str], ...]:
        way = []
        while number >= 0:
            before, label = self.reached[number]
            way.append((label, describe(self.states[number])))
            number = before
        return tuple(reversed(way))


def search(model: Model[State]) -> Searched[State]:
    """Visit every state, until a property is broken or all are visited; then see that none is a dead end."""
    began_s = time.perf_counter()
    found: Searched[State] = Searched()
    visited: _Visited[State] = _Visited()
    found.violation = _spread(model, visited, found)
    if found.violation is None:
        found.complete = True
        found.violation = _dead_end(model, visited)
    found.states = len(visited.states)
    found.depth = max(visited.depth)
    found.seconds = time.perf_counter() - began_s
    return found


def _spread(model: Model[State], visited: _Visited[State], found: Searched[State]) -> Violation | None:
    waiting: deque[int] = deque()
    for start in model.starts:
        number = visited.add(start, -1, "at the start")
        if number is not None:
            waiting.append(number)
    while waiting:
        here = waiting.popleft()
        for step in model.steps(visited.states[here]):
            found.transitions += 1
            found.labels[step.label] = found.labels.get(step.label, 0) + 1
            number = visited.add(step.after, here, step.label)
            if step.broken:
                way = (*visited.trace(here, model.describe), (step.label, model.describe(step.after)))
                return Violation(step.broken[0], way)
            if number is not None:
                waiting.append(number)
                if broken := model.broken(step.after):
                    return Violation(broken[0], visited.trace(number, model.describe))
            if step.helps:
                visited.ways_in[visited.number[step.after]].append(here)
    return None


def _dead_end(model: Model[State], visited: _Visited[State]) -> Violation | None:
    """A state nearest to the start from which no goal can be reached by steps that help; None when there is none."""
    waiting = [number for number, state in enumerate(visited.states) if model.is_goal(state)]
    saved = set(waiting)
    while waiting:
        for before in visited.ways_in[waiting.pop()]:
            if before not in saved:
                saved.add(before)
                waiting.append(before)
    lost = next((number for number in range(len(visited.states)) if number not in saved), None)
    return None if lost is None else Violation(model.goal_name, visited.trace(lost, model.describe))
