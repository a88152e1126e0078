"""How registration's inner loops are compiled.

The loops over rays call dozens of small functions with many arguments: calls and counted references to arrays took
more than half of their time, so each function becomes part of whatever calls it.
"""

from typing import Final

from shared.compiled import compiled_inline

compiled: Final = compiled_inline
