"""Which keys a key expression covers: the part of Zenoh's key expression language that this project uses."""


def includes(expression: str, key: str) -> bool:
    """Whether a key expression covers a concrete key.

    Parameters
    ----------
    expression
        Chunks separated by ``/``; ``*`` covers exactly one chunk, ``**`` any number of chunks, also none.
    key
        A key without wildcards.
    """
    return _includes(expression.split("/"), key.split("/"))


def _includes(pattern: list[str], chunks: list[str]) -> bool:
    if not pattern:
        return not chunks
    head, rest = pattern[0], pattern[1:]
    if head == "**":
        return any(_includes(rest, chunks[skipped:]) for skipped in range(len(chunks) + 1))
    return bool(chunks) and head in ("*", chunks[0]) and _includes(rest, chunks[1:])
