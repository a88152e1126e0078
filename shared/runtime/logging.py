"""Logs as JSON lines on stderr, each with service, room and boot epoch; libraries' own logs join them."""

import logging
import sys

import structlog

from shared.runtime.settings import LogLevel

Log = structlog.stdlib.BoundLogger

# Without local variables: they may hold pixels, names or keys.
_EXCEPTIONS = structlog.processors.ExceptionRenderer(structlog.tracebacks.ExceptionDictTransformer(show_locals=False))


def configure_logging(service: str, room: str, boot_epoch: str, level: LogLevel) -> Log:
    """Set up logging of this process and return its logger. Call once, first thing.

    Returns
    -------
    structlog.stdlib.BoundLogger
        Every line it writes names `service`, `room` and `boot_epoch`.
    """
    common: list[structlog.typing.Processor] = [
        structlog.contextvars.merge_contextvars,
        structlog.stdlib.add_log_level,
        structlog.stdlib.add_logger_name,
        structlog.processors.TimeStamper(fmt="iso", utc=True),
        _Origin(service, room, boot_epoch),
    ]
    structlog.configure(
        processors=[*common, structlog.stdlib.ProcessorFormatter.wrap_for_formatter],
        logger_factory=structlog.stdlib.LoggerFactory(),
        wrapper_class=structlog.stdlib.BoundLogger,
    )
    _send_to_stderr(common, level)
    log: Log = structlog.stdlib.get_logger(f"distalock.{service}")
    return log


class _StandardError(logging.Handler):
    """Writes to what standard error is at that moment."""

    def emit(self, record: logging.LogRecord) -> None:
        print(self.format(record), file=sys.stderr, flush=True)  # noqa: T201 - this is where logs leave the process


class _Origin:
    """Adds to every line where it comes from, whoever wrote it."""

    def __init__(self, service: str, room: str, boot_epoch: str) -> None:
        self._origin = {"service": service, "room": room, "boot_epoch": boot_epoch}

    def __call__(
        self, logger: structlog.typing.WrappedLogger, method: str, event: structlog.typing.EventDict
    ) -> structlog.typing.EventDict:
        del logger, method
        event.update(self._origin)
        return event


def _send_to_stderr(common: list[structlog.typing.Processor], level: LogLevel) -> None:
    handler = _StandardError()
    handler.setFormatter(
        structlog.stdlib.ProcessorFormatter(
            foreign_pre_chain=common,
            processors=[
                structlog.stdlib.ProcessorFormatter.remove_processors_meta,
                _EXCEPTIONS,
                structlog.processors.JSONRenderer(),
            ],
        )
    )
    root = logging.getLogger()
    root.handlers = [*(h for h in root.handlers if not isinstance(h, _StandardError)), handler]
    root.setLevel(level.upper())
