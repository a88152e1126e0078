"""What is wrong with a request is said once, with its limit, and without what is secret."""

import pytest
from pydantic import BaseModel, Field, TypeAdapter, ValidationError

from services.ui_api.routes.bodies import CaseBody, Password, UserName
from services.ui_api.routes.invalid_request import Wrong, wrongs_of
from tests.unit.services.ui_api import samples


class Credentials(BaseModel):
    """As a body with a secret."""

    password: Password
    name: UserName


class Paged(BaseModel):
    """As the parameters of a list."""

    limit: int = Field(ge=1)


def wrongs(kind: type[BaseModel], sent: object, place: str = "body") -> list[Wrong]:
    with pytest.raises(ValidationError) as raised:
        TypeAdapter(kind).validate_python(sent, strict=True)
    return wrongs_of([{**error, "loc": (place, *error["loc"])} for error in raised.value.errors()])


def test_a_part_that_is_none_has_one_sentence_though_it_could_be_of_two_sorts() -> None:
    (wrong,) = wrongs(CaseBody, samples.case_body(nail="no such nail"))
    assert wrong.place == "body.nail"
    assert wrong.message.startswith("nail is 'no such nail', which is no part; give a name from the catalogue")


def test_everything_that_is_wrong_is_named_in_the_order_of_the_fields() -> None:
    sent = {**samples.case_body(head_extension_mm=10.0, mount=7), "more": 1}
    del sent["side"]
    side, mount, extension, more = (wrong.message for wrong in wrongs(CaseBody, sent))
    assert side == "side is missing; send it"
    assert mount == "mount is 7; send 'bone' or 'nail_head'"
    assert extension.startswith("head_extension_mm is 10 (limit: at least 40); read it off the scale of the hexapod's")
    assert more == "more is not known here; leave it out, or see /docs for what there is"


@pytest.mark.parametrize("password", ["", "p" * 5000, 4711])
def test_a_secret_is_not_quoted_and_what_is_quoted_is_short_and_plain(password: object) -> None:
    secret, name = wrongs(Credentials, {"password": password, "name": "\x1b[31m" + "n" * 500})
    assert secret.message.startswith("password is ")
    assert "ppp" not in secret.message
    assert "4711" not in secret.message
    assert "\x1b" not in name.message
    assert len(name.message) < 300


def test_a_parameter_is_named_as_such() -> None:
    (wrong,) = wrongs(Paged, {"limit": 0}, "query")
    assert wrong == Wrong("query.limit", "the parameter 'limit' is 0 (limit: at least 1); send a value within it")
