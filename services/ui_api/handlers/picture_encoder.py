"""The gateway's end of the encoder process: started when first needed, and anew after it has died or hung."""

import socket
import subprocess
import sys
from typing import Final

from services.ui_api.encoder import REPLY, REQUEST, received
from shared.errors import DistalockError
from shared.messages.imaging import FrameHeader

# An encoder that starts on a busy machine takes a second; one that encodes, ten milliseconds.
ANSWERS_WITHIN_S: Final = 5.0
_ENDS_WITHIN_S: Final = 1.0
_ENCODER: Final = (sys.executable, "-m", "services.ui_api.encoder")


class EncoderFailed(DistalockError):
    """The encoder process died or hung over a frame; the next frame gets a new one."""

    code = "encoder_failed"


class PictureEncoder:
    """One process, one frame at a time. Used by one thread.

    Parameters
    ----------
    command
        What to start.
    answers_within_s
        Time for handing over a frame and for its picture, each.
    """

    def __init__(self, command: tuple[str, ...] = _ENCODER, answers_within_s: float = ANSWERS_WITHIN_S) -> None:
        self._command, self._answers_within_s = command, answers_within_s
        self._running: tuple[subprocess.Popen[bytes], socket.socket] | None = None

    @property
    def pid(self) -> int | None:
        """Process id of the encoder that runs now."""
        running = self._running
        return None if running is None else running[0].pid

    def picture(self, header: FrameHeader, payload: bytes) -> bytes:
        """A frame as a JPEG.

        Raises
        ------
        EncoderFailed
            When the process died or did not answer in time; it was ended.
        """
        process, line = self._running = self._running or self._start()
        try:
            line.sendall(REQUEST.pack(header.height_px, header.width_px))
            line.sendall(payload)
            length = received(line, REPLY.size)
            picture = None if length is None else received(line, *REPLY.unpack(length))
        except OSError as error:
            self.close()
            raise EncoderFailed(f"the encoder of live pictures did not answer ({error}); it is started anew") from None
        if picture is None:
            self.close()
            code = process.returncode
            raise EncoderFailed(f"the encoder of live pictures ended with code {code}; it is started anew")
        return bytes(picture)

    def close(self) -> None:
        """End the process, by force if it hangs."""
        if self._running is None:
            return
        process, line = self._running
        self._running = None
        line.close()
        try:
            process.wait(_ENDS_WITHIN_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()

    def _start(self) -> tuple[subprocess.Popen[bytes], socket.socket]:
        ours, its = socket.socketpair()
        ours.settimeout(self._answers_within_s)
        with its:
            process = subprocess.Popen(self._command, stdin=its.fileno(), stdout=subprocess.DEVNULL)  # noqa: S603 - our own module
        return process, ours
