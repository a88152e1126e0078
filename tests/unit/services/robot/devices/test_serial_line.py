"""The GCS driver against a small controller: silence, late and garbled answers, and lines that break."""

import re
import threading

import pytest

from services.robot.core.controller_feedback import ErrorKind
from services.robot.devices.controller import ControllerSilent, ReplyGarbled
from services.robot.devices.gcs.controller import GcsController
from services.robot.devices.serial_line import MOST_STALE_REPLIES
from shared.errors import DeviceError
from shared.geometry.hexapod import PlatformPose
from shared.parts.hexapod_file import default_hexapod
from tests.unit.services.robot.fake_gcs import FakeGcs

HEXAPOD = default_hexapod()
TARGET = PlatformPose(1.0, -2.0, 0.5, 1.0, -1.0, 0.25)
SHORT_S = 0.05
# For tests in which something must come in time, also beside a busy processor.
PATIENT_S = 0.2


def test_silence_is_reported_with_the_question_and_the_limit(gcs: FakeGcs, controller: GcsController) -> None:
    gcs.mute = True
    with pytest.raises(ControllerSilent, match=r"silent: no answer to 'BRA\? X Y Z U V W' within 0\.25 s"):
        controller.read()


def test_a_late_answer_is_not_taken_for_the_next_one(gcs: FakeGcs) -> None:
    controller = GcsController(gcs, HEXAPOD, reply_timeout_s=SHORT_S)
    gcs.mute = True
    with pytest.raises(ControllerSilent):
        controller.read()
    gcs.mute = False
    gcs.say(b"X=0 \nY=0 \nZ=0 \nU=0 \nV=0 \nW=0\n")  # the answer to BRA?, late: as if all brakes were off
    assert controller.read().locked
    controller.close()


def test_one_garbled_answer_is_asked_for_again(gcs: FakeGcs, controller: GcsController) -> None:
    spoiled = iter([True])
    gcs.spoil = lambda q, a: a.replace(b"Z=", b"") if q == b"POS?" and next(spoiled, False) else a
    gcs.position["Y"] = 2.5
    assert controller.read().pose.y_mm == 2.5


def test_an_answer_without_its_end_does_not_spoil_the_next(gcs: FakeGcs) -> None:
    controller = GcsController(gcs, HEXAPOD, reply_timeout_s=SHORT_S)
    gcs.spoil = lambda q, a: a[:-7] if q == b"POS?" else a
    with pytest.raises(ControllerSilent, match=r"no answer to 'POS\?"):
        controller.read()
    gcs.spoil = lambda _, a: a
    assert controller.read().locked
    controller.close()


def test_lasting_garbage_is_reported(gcs: FakeGcs, controller: GcsController) -> None:
    gcs.spoil = lambda q, a: b"\xff" + a if q == b"POS?" else a
    with pytest.raises(ReplyGarbled, match="which is not an answer to it; check the cable"):
        controller.read()


def test_a_garbled_error_code_is_never_asked_for_again(gcs: FakeGcs, controller: GcsController) -> None:
    gcs.error = 7
    gcs.spoil = lambda q, a: b"x" + a if q == b"ERR?" else a
    with pytest.raises(ReplyGarbled):
        controller.read()
    gcs.spoil = lambda _, a: a
    error = controller.read().error
    assert error is not None, "whoever dropped what was raised gets it once more"
    assert "an error of the controller may be lost" in error.message
    assert controller.read().error is None


@pytest.mark.parametrize(
    ("answer", "sentence"),
    [
        (b"-1024\n", "motion error"),
        (b"", r"an error of the controller may be lost: .* to 'ERR\?'"),
        (b"x7\n", r"an error of the controller may be lost: .*'x7' to 'ERR\?'"),
    ],
)
def test_an_error_code_that_comes_late_is_reported_and_one_that_never_comes_is_a_fault(
    gcs: FakeGcs, answer: bytes, sentence: str
) -> None:
    controller = GcsController(gcs, HEXAPOD, reply_timeout_s=PATIENT_S)
    gcs.spoil = lambda q, a: b"" if q == b"ERR?" else a
    with pytest.raises(ControllerSilent):
        controller.read()
    gcs.spoil = lambda _, a: a
    gcs.say(answer)
    error = controller.read().error
    assert error is not None
    assert error.kind is ErrorKind.FAULT
    assert re.search(sentence, error.message), error.message
    assert controller.read().error is None
    controller.close()


@pytest.mark.parametrize(
    ("in_time", "late", "sentence"),
    [
        (b"5", b"00\n", "stop button is pressed"),
        (b"1", b"0\n", "stopped by a command"),
        (b"-", b"1024\n", "motion error"),
    ],
)
def test_an_error_code_of_which_a_part_comes_late_is_read_as_a_whole(
    gcs: FakeGcs, in_time: bytes, late: bytes, sentence: str
) -> None:
    controller = GcsController(gcs, HEXAPOD, reply_timeout_s=PATIENT_S)
    gcs.spoil = lambda q, a: in_time if q == b"ERR?" else a
    with pytest.raises(ControllerSilent):
        controller.read()
    gcs.spoil = lambda _, a: a
    gcs.say(late)
    error = controller.read().error
    assert error is not None
    assert sentence in error.message
    controller.close()


def test_no_error_that_comes_late_is_none(gcs: FakeGcs) -> None:
    controller = GcsController(gcs, HEXAPOD, reply_timeout_s=PATIENT_S)
    gcs.spoil = lambda q, a: b"" if q == b"ERR?" else a
    with pytest.raises(ControllerSilent):
        controller.read()
    gcs.spoil = lambda _, a: a
    gcs.say(b"0\n")
    assert controller.read().error is None
    controller.close()


def test_a_line_that_babbles_does_not_hold_a_question_up(gcs: FakeGcs) -> None:
    controller = GcsController(gcs, HEXAPOD, reply_timeout_s=PATIENT_S)
    gcs.mute = True
    ended = threading.Event()
    lines = [0]

    def babble() -> None:
        while not ended.wait(PATIENT_S / 5.0):
            gcs.say(b"\xff\xfe\n")
            lines[0] += 1

    babbler = threading.Thread(target=babble)
    babbler.start()
    with pytest.raises((ReplyGarbled, ControllerSilent)):  # silent, where nothing came just then
        controller.read()
    heard = lines[0]
    ended.set()
    babbler.join()
    controller.close()
    assert heard < MOST_STALE_REPLIES / 2, "it gave up by the time that had passed, not by the number of lines"


def test_a_broken_line_is_reported_and_a_stop_on_it_says_so(gcs: FakeGcs, controller: GcsController) -> None:
    assert controller.stop_now() is None
    gcs.broken = OSError("cable pulled")
    with pytest.raises(ControllerSilent, match="the line"):
        controller.read()
    assert "the line to the hexapod controller is broken: cable pulled" in str(controller.stop_now())


@pytest.mark.parametrize(
    ("attribute", "value", "sentence"),
    [
        ("axes", ("X", "Y", "Z"), "the controller has the axes X Y Z, a hexapod has X Y Z U V W"),
        ("syntax", "1.0", r"speaks GCS 1, this driver speaks GCS 2\.0"),
        ("identity", "\x07", "which is not an answer"),
        ("mute", True, "silent"),
        ("brakes_hold", False, "does not lock"),
    ],
)
def test_what_is_no_hexapod_controller_is_refused(gcs: FakeGcs, attribute: str, value: object, sentence: str) -> None:
    gcs.brake = dict.fromkeys(gcs.brake, 0)
    setattr(gcs, attribute, value)
    with pytest.raises(DeviceError, match=sentence):
        GcsController(gcs, HEXAPOD, reply_timeout_s=SHORT_S)
    assert gcs.closed


def test_a_digit_that_the_line_changed_is_not_believed(gcs: FakeGcs, controller: GcsController) -> None:
    answers = iter(range(100))

    def change_a_digit(question: bytes, answer: bytes) -> bytes:
        return answer.replace(b"X=0", b"X=7") if question == b"POS?" and next(answers) == 0 else answer

    gcs.spoil = change_a_digit
    with pytest.raises(ReplyGarbled, match=r"two positions of a robot at rest, 7.000 mm and 0.000° apart"):
        controller.read()
    assert controller.read().pose.x_mm == 0.0
