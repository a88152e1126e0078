"""How a question is answered and the text of one that failed, the same on every bus."""

from concurrent.futures import Future

from shared.bus.port import Answer, Query, QueryHandler
from shared.errors import DistalockError, NoReply
from shared.tracing import trace_id_of, traced


def error_text(error: BaseException) -> str:
    """Error reply when a queryable's handler raises: our own sentence, or the foreign error with its kind."""
    return str(error) if isinstance(error, DistalockError) else f"{type(error).__name__}: {error}"


def answered(handler: QueryHandler, query: Query) -> Answer | Future[Answer]:
    """What a handler answers to a question, working for the trace of whoever asks."""
    with traced(trace_id_of(query.traceparent)):
        return handler(query)


def outcome_of(done: Future[Answer]) -> Answer | str:
    """The answer that a handler gave later, or the text of the error that it came to."""
    if done.cancelled():
        return "the answer was given up"
    error = done.exception()
    return done.result() if error is None else error_text(error)


def no_answer(key: str) -> NoReply:
    """Nobody answers this key now."""
    return NoReply(
        f"'{key}' brought no answer: nobody answers it, it is not permitted, or the link broke; "
        "this does not mean that it was not carried out"
    )


def no_reply_in_time(key: str, timeout_s: float) -> NoReply:
    """Somebody was asked and kept silent."""
    return NoReply(f"'{key}' brought no reply within {timeout_s:g} s; it may have been carried out, or may be yet")


def replied_with_error(key: str, text: str) -> NoReply:
    """The handler at the other end raised."""
    return NoReply(f"'{key}' was answered with an error: {text}")
