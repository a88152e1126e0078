"""JSON schemas of the part files, from the models that read them: `docs/schemas/`."""

import json
from typing import Final

from shared.parts.files import GuideFile, NailFile, PartModel, RingFile
from shared.parts.hexapod_file import HexapodFile

_MODELS: Final[dict[str, type[PartModel]]] = {
    "ring-1": RingFile,
    "guide-1": GuideFile,
    "nail-1": NailFile,
    "hexapod-1": HexapodFile,
}


def part_schema_texts() -> dict[str, str]:
    """File name and content of every schema."""
    return {
        f"{name}.json": json.dumps(model.model_json_schema(by_alias=True), indent=2, sort_keys=True) + "\n"
        for name, model in _MODELS.items()
    }
