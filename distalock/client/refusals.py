"""What goes wrong with a request: the gateway refuses it, or answers with something else than it documents."""

from pydantic import ValidationError

from distalock.client.models import Problem
from shared.errors import DistalockError


class RequestRefused(DistalockError):
    """The gateway answered with a problem document.

    Attributes
    ----------
    status
        HTTP status.
    problem
        The whole document; `problem.current` is the newest state where somebody was faster.
    etag
        With 412: the ETag of that newest state, to quote once it was looked at.
    retry_after_s
        With 429 and 503: when to ask again; None where it is not said.
    """

    code = "request_refused"

    def __init__(
        self, problem: Problem, etag: str | None = None, retry_after_s: float | None = None, status: int | None = None
    ) -> None:
        super().__init__(problem.detail)
        self.status = problem.status if status is None else status
        self.problem = problem
        self.etag = etag
        self.retry_after_s = retry_after_s

    @staticmethod
    def of(status: int, problem_code: str, detail: str, instance: str = "") -> "RequestRefused":
        """From its parts, where there is no document."""
        kind = "about:blank"
        return RequestRefused(
            Problem(type=kind, title=detail, status=status, detail=detail, code=problem_code, instance=instance)
        )

    @property
    def problem_code(self) -> str:
        """Stable code of the problem."""
        return self.problem.code


class AnswerInvalid(DistalockError):
    """The gateway answered with what its interface does not document."""

    code = "answer_invalid"

    def __init__(self, method: str, path: str, error: ValidationError) -> None:
        first = error.errors(include_url=False)[0]
        place = ".".join(map(str, first["loc"])) or "the answer"
        super().__init__(
            f"{method} {path}: {place}: {first['msg']} ({error.error_count()} differences from what is documented); "
            "use the client of the gateway's version"
        )
