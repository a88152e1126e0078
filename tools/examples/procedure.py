"""The procedure that is recorded: every operation once."""

import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Final

import httpx

from distalock.case_client import CaseClient
from distalock.client import Client, RequestRefused
from distalock.client.models import (
    CaseBody,
    CasePatch,
    ComputationBody,
    LoginBody,
    MotionBody,
    PasswordBody,
    PlanBody,
    QaBody,
    RefreshBody,
    StepBody,
    UserBody,
    UserPatch,
    VerificationBody,
)
from distalock.room_client import RoomClient
from tools.examples.recorder import Recorder

_NAME: Final = "ada"
_PASSWORDS: Final = ("four words and a nail", "five words and a longer nail")
# Enough of a stream to see what it looks like.
_LINES_OF_A_STREAM: Final = 8
_SETTLES_S: Final = 1.5
_ANSWER_S: Final = 300.0
_MOST_IMAGES: Final = 6
_MOST_COMPUTATIONS: Final = 10


@dataclass(frozen=True, slots=True)
class Recording:
    """Two clients of one gateway: what `recorded` asks is kept, what `plain` asks is not."""

    recorder: Recorder
    recorded: Client
    plain: Client
    room: RoomClient

    def run(self) -> None:
        """A case, the accounts, and what belongs to neither."""
        scenario = self.room.scenario()
        case = self.recorded.open_case(CaseBody.model_validate(scenario.set_up))
        self._set_up(case.id)
        self._align(case.id, scenario.hole_ids)
        self._finish(case.id, scenario.hole_ids)
        self._accounts()
        self._robot()
        self._others()

    def _set_up(self, case_id: str) -> None:
        mine = self.recorded
        mine.change_case(case_id, CasePatch(drill_diameter_mm=4.0, why="as on the drill"))
        mine.record_step(case_id, StepBody(step="ring_remounted", why="it was loose"))
        mine.list_steps(case_id)
        with suppress(RequestRefused):  # kept as the example of a problem
            mine.change_case(case_id, CasePatch(side="right"), if_match='"1-stale"')

    def _image(self, case_id: str, hole_ids: Sequence[str]) -> int:
        """Number of a localisation from which a plan can be made: the robot has stood still, the axes are seen."""
        case, refused = CaseClient(self.plain, case_id), ""
        for _ in range(_MOST_IMAGES):
            time.sleep(_SETTLES_S)
            seen = case.localisation_of(self.room.take_shot())
            try:
                case.plan(seen.number, hole_ids)
            except RequestRefused as refusal:
                refused = str(refusal)
            else:
                return seen.number
        raise RuntimeError(f"no plan from {_MOST_IMAGES} images: {refused}")

    def _align(self, case_id: str, hole_ids: Sequence[str]) -> None:
        mine, case = self.recorded, CaseClient(self.plain, case_id)
        number = self._image(case_id, hole_ids)
        image = mine.list_images(case_id).items[-1]
        mine.read_image(image.id)
        mine.read_png(image.id, view="overlay", width=512)
        mine.read_dicom(image.id)
        mine.read_drawing(case_id, number)
        mine.list_localisations(case_id)
        mine.read_localisation(case_id, number)
        mine.read_alignment(case_id)
        mine.read_case(case_id)
        plan = mine.make_plan(case_id, PlanBody(localisation=number, hole_ids=hole_ids))
        mine.approve_plan(case_id, plan.number)
        mine.withdraw_approval(case_id, plan.number)
        case.approve(plan)
        mine.read_plan(case_id, plan.number)
        mine.list_plans(case_id)
        self.plain.read_case(case_id)
        held = self.plain.begin_motion(case_id, MotionBody(plan=plan.number, hold_to_move=True))
        mine.renew_lease(held.id)
        case.follow(held)
        mine.stop_robot()
        case.follow(mine.acknowledge_stop())
        number = self._image(case_id, hole_ids)
        plan = case.plan(number, hole_ids)
        case.approve(plan)
        self._move(case_id, plan.number)

    def _move(self, case_id: str, plan: int) -> None:
        """The motion that is recorded; it quotes the case as the other client has just read it."""
        etag = CaseClient(self.plain, case_id).etag()
        begun = self.recorded.begin_motion(case_id, MotionBody(plan=plan), if_match=etag)
        ended = CaseClient(self.plain, case_id).follow(begun)
        self.recorded.read_operation(ended.id)
        self.recorded.list_operations()

    def _finish(self, case_id: str, hole_ids: Sequence[str]) -> None:
        mine, case = self.recorded, CaseClient(self.plain, case_id)
        self._image(case_id, hole_ids)
        newest = case.newest_image_id()
        made = mine.make_verification(case_id, VerificationBody(images=(newest,), of="guide"), if_match=case.etag())
        mine.read_verification(case_id, made.number)
        mine.list_verifications(case_id)
        report = mine.make_qa_report(case_id, QaBody(images=(newest,)), if_match=case.etag())
        mine.read_qa_report(case_id, report.number)
        mine.list_qa_reports(case_id)
        mine.read_qa_page(case_id, report.number)
        self._cancel(case, newest)
        case.record_step("drilled", hole_ids)
        mine.withdraw_step(case_id, self.plain.list_steps(case_id).items[-1].number)
        mine.read_timeline(case_id)
        self._stream("case_events", f"/api/v1/cases/{case_id}/events", {"case_id": case_id})
        self._stream("all_events", "/api/v1/events?after=0", {})
        case.record_step("abandoned", why="the recording ends")
        mine.list_cases()

    def _cancel(self, case: CaseClient, image: str) -> None:
        """A computation that is cancelled before it ends: some are done before."""
        guide = ComputationBody(verification=VerificationBody(images=(image,), of="guide"))
        for _ in range(_MOST_COMPUTATIONS):
            begun = self.recorded.begin_computation(case.id, guide, if_match=case.etag())
            with suppress(RequestRefused):
                self.recorded.cancel_operation(begun.id)
                return
        raise RuntimeError(f"each of {_MOST_COMPUTATIONS} computations ended before it could be cancelled")

    def _accounts(self) -> None:
        mine = self.recorded
        mine.create_user(UserBody(name=_NAME, password=_PASSWORDS[0], roles=("surgeon",)))
        session = mine.sign_in(LoginBody(name=_NAME, password=_PASSWORDS[0]))
        renewed = mine.refresh_session(RefreshBody(refresh_token=session.refresh_token))
        with httpx.Client(event_hooks={"response": [self.recorder.on_answer]}, timeout=_ANSWER_S) as http:
            ada = Client(self.plain.base_url, renewed.access_token, http=http)
            ada.read_me()
            ada.change_own_password(PasswordBody(password=_PASSWORDS[0], new_password=_PASSWORDS[1]))
            ada.sign_out()
        mine.read_ways()
        mine.list_passkeys()
        mine.list_users()
        mine.read_user(_NAME)
        mine.change_user(_NAME, UserPatch(roles=("surgeon", "technician")))
        mine.end_sessions(_NAME)

    def _robot(self) -> None:
        mine = self.recorded
        mine.read_robot()
        mine.read_alarms()
        mine.reset_robot()  # refused by the robot later, because it has no fault: an operation that fails

    def _others(self) -> None:
        mine = self.recorded
        mine.read_part(mine.list_parts()[0].name)
        mine.read_health()
        mine.read_readiness()
        mine.read_diagnosis()
        mine.read_metrics()

    def _stream(self, name: str, path: str, placed: dict[str, str]) -> None:
        lines: list[str] = []
        headers = self.plain.session_headers
        with httpx.stream("GET", self.plain.base_url + path, headers=headers, timeout=_ANSWER_S) as stream:
            for line in stream.iter_lines():
                if not line.startswith(":"):
                    lines.append(line)
                if len(lines) >= _LINES_OF_A_STREAM:
                    break
        self.recorder.keep_stream(name, placed, lines)
