"""Measured values in sentences that name a limit."""

# Chosen: who needs more to tell a value from its limit has a value that equals it.
_MOST_MORE_DECIMALS = 4


def figure(measured: float, limit: float, decimals: int, sign: str = "") -> str:
    """A value with so many decimals, and more where it would else read as its limit or as on its other side.

    "5.0° (limit 5°)" is no reason to refuse anything; "5.03° (limit 5°)" is. The limit is a round number, which the
    sentence gives in full; for others see `figures`.

    Parameters
    ----------
    limit
        In the same unit as `measured`, of either sign: sizes are compared.
    sign
        "+" where a value above zero is to have its sign, too.
    """
    beyond, size = abs(measured) > abs(limit), round(abs(limit), 9)
    for more in range(_MOST_MORE_DECIMALS):
        text = f"{measured:{sign}.{decimals + more}f}"
        read = abs(float(text))
        if read != size and (read > size) == beyond:
            return text
    return f"{measured:{sign}.{decimals}f}"


def figures(measured: float, limit: float, decimals: int) -> tuple[str, str]:
    """A value and a limit that is worked out, with as many decimals, at least so many, as it takes to tell them apart.

    Of "29 (limit 29)" nobody knows whether it is beyond; of "29.2 (limit 28.8)" everybody does.
    """
    for more in range(_MOST_MORE_DECIMALS):
        value, most = (f"{of:.{decimals + more}f}" for of in (measured, limit))
        if value != most:
            return value, most
    return f"{measured:.{decimals}f}", f"{limit:.{decimals}f}"
