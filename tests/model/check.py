"""The whole check: every scope without a change, then every seeded mutation, two at the same time."""

import logging
import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from multiprocessing import get_context

from tests.model.mutation import Mutation
from tests.model.mutations import MUTATIONS
from tests.model.room import room_model
from tests.model.scope import SCOPES, Scope
from tests.model.search import Searched, search
from tests.model.world import World


@contextmanager
def _quietly() -> Iterator[None]:
    """Services log what they refuse, which happens here thousands of times."""
    before = logging.root.manager.disable
    logging.disable(logging.CRITICAL)
    try:
        yield
    finally:
        logging.disable(before)


def searched(scope: Scope) -> Searched[World]:
    """What the search of a scope has found."""
    with _quietly():
        return search(room_model(scope))


def searched_with(mutation: Mutation) -> Searched[World]:
    """What the search finds when the code has a change."""
    with mutation.applied():
        return searched(mutation.where)


def all_scopes(scopes: Iterable[Scope] = SCOPES) -> list[Searched[World]]:
    """Every scope, several at the same time."""
    with get_context("spawn").Pool(_at_once(), maxtasksperchild=4) as pool:
        return pool.map(searched, scopes, chunksize=1)


def all_mutations(mutations: Iterable[Mutation] = MUTATIONS) -> list[Searched[World]]:
    """Every mutation, several at the same time."""
    with get_context("spawn").Pool(_at_once(), maxtasksperchild=12) as pool:
        return pool.map(searched_with, mutations, chunksize=1)


def _at_once() -> int:
    return min(2, os.cpu_count() or 1)
