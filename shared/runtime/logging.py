"""Logs as JSON lines, each with service, room and boot epoch; libraries' own logs join them.

They go to standard error, or to a file that rotates. Logging never raises and waits for nothing: see `log_lines`.
"""

import json
import logging
from pathlib import Path

import structlog

from shared.runtime.log_lines import LineWriter, RotatingFile, Sink, StandardError
from shared.runtime.settings import LogLevel

Log = structlog.stdlib.BoundLogger

# Without local variables: they may hold pixels, names or keys.
_EXCEPTIONS = structlog.processors.ExceptionRenderer(structlog.tracebacks.ExceptionDictTransformer(show_locals=False))
_FLUSH_WITHIN_S = 1.0


def configure_logging(service: str, room: str, boot_epoch: str, level: LogLevel, log_file: Path | None = None) -> Log:
    """Set up logging of this process and return its logger. Call once, first thing.

    Parameters
    ----------
    log_file
        Where lines go; None: standard error.

    Returns
    -------
    structlog.stdlib.BoundLogger
        Every line it writes names `service`, `room` and `boot_epoch`.
    """
    origin = {"service": service, "room": room, "boot_epoch": boot_epoch}
    common: list[structlog.typing.Processor] = [
        structlog.contextvars.merge_contextvars,
        structlog.stdlib.add_log_level,
        structlog.stdlib.add_logger_name,
        structlog.processors.TimeStamper(fmt="iso", utc=True),
        _Origin(origin),
    ]
    structlog.configure(
        processors=[*common, structlog.stdlib.ProcessorFormatter.wrap_for_formatter],
        logger_factory=structlog.stdlib.LoggerFactory(),
        wrapper_class=structlog.stdlib.BoundLogger,
    )
    sink = StandardError() if log_file is None else RotatingFile(log_file)
    _send_to(_Handler(sink, origin), common, level)
    log: Log = structlog.stdlib.get_logger(f"distalock.{service}")
    return log


def flush_logs() -> None:
    """Wait, for a second at most, until the lines logged so far are written."""
    for handler in _own_handlers():
        handler.flush()


def dropped_lines() -> tuple[int, str]:
    """How many log lines of this process could not be written so far, and why the last one could not."""
    writers = [handler.writer for handler in _own_handlers()]
    return sum(w.dropped for w in writers), next((w.why_dropped for w in writers if w.dropped), "")


class _Handler(logging.Handler):
    """Hands formatted lines to a `LineWriter`; never raises."""

    def __init__(self, sink: Sink, origin: dict[str, str]) -> None:
        super().__init__()
        self.writer = LineWriter(
            sink, lambda count, why: json.dumps({"event": "log lines dropped", "count": count, "why": why, **origin})
        )

    def emit(self, record: logging.LogRecord) -> None:
        try:
            self.writer.put(self.format(record))
        except Exception as error:  # noqa: BLE001 - a value that cannot be shown must not hurt whoever logs it
            self.writer.note_dropped(f"a line could not be made: {type(error).__name__}")

    def flush(self) -> None:
        self.writer.flush(_FLUSH_WITHIN_S)

    def close(self) -> None:
        self.writer.close()
        super().close()


class _Origin:
    """Adds to every line where it comes from, whoever wrote it."""

    def __init__(self, origin: dict[str, str]) -> None:
        self._origin = origin

    def __call__(
        self, logger: structlog.typing.WrappedLogger, method: str, event: structlog.typing.EventDict
    ) -> structlog.typing.EventDict:
        del logger, method
        event.update(self._origin)
        return event


def _own_handlers() -> list[_Handler]:
    return [handler for handler in logging.getLogger().handlers if isinstance(handler, _Handler)]


def _send_to(handler: _Handler, common: list[structlog.typing.Processor], level: LogLevel) -> None:
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
    before = _own_handlers()
    root.handlers = [*(h for h in root.handlers if h not in before), handler]
    root.setLevel(level.upper())
    for old in before:
        old.close()
