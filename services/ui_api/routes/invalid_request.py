"""What is wrong with a request, for people: what was sent, the limit, and what to send. Pure.

The framework says "String should match pattern ..." and lists every sort of thing that a value is not.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

_PARTS: Final = frozenset(("nail", "guide", "ring", "hexapod"))
# What these hold is nobody's business but the sender's, also when it is too long.
_SECRET: Final = ("password", "token", "key", "credential", "passkey", "link")
# Chosen: what a client sent is quoted so far that it can be recognised.
_LONGEST_QUOTED: Final = 60
_PLACES: Final = {"query": "the parameter", "header": "the header", "path": "the path's", "body": ""}
_REMEDIES: Final = {
    "head_extension_mm": "read it off the scale of the hexapod's head, and move the head where it is outside",
    "drill_diameter_mm": "give the diameter of the drill that goes through the guide",
    "nominal_source_to_detector_mm": "give what the C-arm's data sheet says, in mm, or leave it out",
    "nominal_pixel_mm": "give what the C-arm's data sheet says, in mm, or leave it out",
}


@dataclass(frozen=True, slots=True)
class Wrong:
    """One thing that is wrong with a request.

    Attributes
    ----------
    place
        Where, with dots: ``body.head_extension_mm``.
    message
        A sentence that names it.
    """

    place: str
    message: str


def wrongs_of(errors: Sequence[Mapping[str, Any]]) -> list[Wrong]:
    """Each thing that is wrong once: a value that could be of several sorts has an error for each of them."""
    found = dict[str, Wrong]()
    for error in errors:
        loc = tuple(error["loc"])
        part = len(loc) > 1 and loc[0] == "body" and loc[1] in _PARTS
        wrong = _wrong_part(loc[1], error["input"]) if part and len(loc) == _OF_A_SORT else _wrong(loc, error)
        found.setdefault(wrong.place, wrong)
    return list(found.values())


# `body`, the part, and the sort of thing that it is not.
_OF_A_SORT: Final = 3


def _wrong_part(kind: str, given: object) -> Wrong:
    return Wrong(
        f"body.{kind}",
        f"{kind} is {_quoted(given)}, which is no part; give a name from the catalogue (GET /parts lists them: "
        "letters, digits, '.', '_' and '-', at most 64, no spaces), or the JSON object of a part file",
    )


def _wrong(loc: tuple[str | int, ...], error: Mapping[str, Any]) -> Wrong:
    place = ".".join(str(one) for one in loc)
    say = _SENTENCES.get(error["type"])
    if say is None:
        return Wrong(place, f"{place}: {str(error['msg']).removeprefix('Value error, ')}")
    name = ".".join(str(one) for one in loc[1:]) or "the body"
    known_as = f"{_PLACES.get(str(loc[0]), '')} '{name}'".strip() if loc[0] != "body" else name
    given = "what was sent" if any(word in name.lower() for word in _SECRET) else _quoted(error["input"])
    sentence = say(known_as, given, error.get("ctx", {}))
    if "limit: " not in sentence:
        return Wrong(place, sentence)
    return Wrong(place, f"{sentence}; {_REMEDIES.get(str(loc[-1]), 'send a value within it')}")


def _quoted(given: object) -> str:
    """What was sent, as far as it can be recognised by it."""
    match given:
        case None:
            return "null"
        case bool():
            return str(given).lower()
        case str():
            return ascii(given[:_LONGEST_QUOTED])
        case int() | float():
            return f"{given:g}" if isinstance(given, float) else str(given)[:_LONGEST_QUOTED]
        case Mapping():
            return "an object"
        case _:
            return "a list" if isinstance(given, Sequence) else "what was sent"


def _wants(what: str) -> Callable[[str, str, Mapping[str, Any]], str]:
    return lambda name, given, _: f"{name} is {given}; send {what}"


_SENTENCES: Final[Mapping[str, Callable[[str, str, Mapping[str, Any]], str]]] = {
    "missing": lambda name, _, __: f"{name} is missing; send it",
    "extra_forbidden": lambda name, _, __: f"{name} is not known here; leave it out, or see /docs for what there is",
    "greater_than_equal": lambda name, given, ctx: f"{name} is {given} (limit: at least {ctx['ge']:g})",
    "less_than_equal": lambda name, given, ctx: f"{name} is {given} (limit: at most {ctx['le']:g})",
    "greater_than": lambda name, given, ctx: f"{name} is {given} (limit: more than {ctx['gt']:g})",
    "less_than": lambda name, given, ctx: f"{name} is {given} (limit: less than {ctx['lt']:g})",
    "literal_error": lambda name, given, ctx: f"{name} is {given}; send {ctx['expected']}",
    "enum": lambda name, given, ctx: f"{name} is {given}; send {ctx['expected']}",
    "string_too_short": lambda name, given, ctx: f"{name} is {given} (limit: at least {ctx['min_length']} characters)",
    "string_too_long": lambda name, _, ctx: f"{name} is too long (limit: {ctx['max_length']} characters)",
    "too_short": lambda name, _, ctx: f"{name} is too short (limit: at least {ctx['min_length']})",
    "too_long": lambda name, _, ctx: f"{name} is too long (limit: at most {ctx['max_length']})",
    "string_pattern_mismatch": lambda name, given, ctx: f"{name} is {given}; send text that fits {ctx['pattern']}",
    "string_type": _wants("text in quotes"),
    "float_type": _wants("a number without quotes"),
    "int_type": _wants("a whole number without quotes"),
    "int_parsing": _wants("a whole number"),
    "int_from_float": _wants("a whole number"),
    "bool_type": _wants("true or false"),
    "bool_parsing": _wants("true or false"),
    "list_type": _wants("a list"),
    "dict_type": _wants("an object"),
    "model_type": _wants("an object"),
    "model_attributes_type": _wants("an object"),
    "finite_number": _wants("a finite number"),
    "json_invalid": lambda _, __, ctx: f"the body is no JSON ({ctx.get('error', 'it cannot be read')}); correct it",
}
