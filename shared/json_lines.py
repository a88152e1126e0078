"""Files of JSON lines: one JSON text a line, each ended by a line feed."""


def json_lines(text: str) -> list[str]:
    """Lines of such a file.

    A JSON text may hold characters at which `str.splitlines` splits, such as U+2028 and U+0085, but no line feed.
    """
    return text.removesuffix("\n").split("\n") if text else []
