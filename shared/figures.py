"""Measured values in sentences that name a limit."""

_MOST_MORE_DECIMALS = 4


def figure(measured: float, limit: float, decimals: int) -> str:
    """A value with so many decimals, and more where it would else read as its limit or as on its other side.

    "5.0° (limit 5°)" is no reason to refuse anything; "5.03° (limit 5°)" is.

    Parameters
    ----------
    limit
        In the same unit as `measured`, of either sign: sizes are compared.
    """
    beyond, size = abs(measured) > abs(limit), round(abs(limit), 9)
    for more in range(_MOST_MORE_DECIMALS):
        text = f"{measured:.{decimals + more}f}"
        read = abs(float(text))
        if read != size and (read > size) == beyond:
            return text
    return f"{measured:.{decimals}f}"
