"""A method for each operation, answered at once.

Written by `make generated` from `docs/openapi.json`; do not edit.
"""

from abc import ABC, abstractmethod
from collections.abc import Iterator
from datetime import datetime
from typing import Literal, TypeVar

from distalock.client import calls
from distalock.client.base import Page
from distalock.client.call import Call
from distalock.client.models import (
    AlarmsView,
    AlignmentView,
    ApprovalBody,
    ApprovalView,
    CaseBody,
    CasePatch,
    CaseView,
    CatalogueView,
    ChallengeBody,
    ComputationBody,
    DiagnosisView,
    HealthView,
    ImageDrawing,
    ImageView,
    LeaseView,
    LocalisationView,
    LoginBody,
    MeView,
    MotionBody,
    OperationView,
    PasskeyBody,
    PasskeyOptions,
    PasskeysView,
    PasskeyView,
    PasswordBody,
    PlanBody,
    PlanView,
    QaBody,
    QaReportView,
    ReadyView,
    RefreshBody,
    RobotView,
    SessionView,
    StepBody,
    StepView,
    StopView,
    TimelineEntry,
    UserBody,
    UserPatch,
    UserView,
    VerificationBody,
    VerificationView,
    WaysView,
)

T = TypeVar("T")


class Methods(ABC):
    """The interface's operations; see `docs/rest.md` for what they do."""

    @abstractmethod
    def send(self, call: Call[T]) -> T:
        """What is answered to a call; raises `RequestRefused`."""

    def open_case(self, body: CaseBody, *, idempotency_key: str | None = None) -> CaseView:
        """Open a case; one at a time in this room."""
        return self.send(calls.open_case(body, idempotency_key=idempotency_key))

    def list_cases(
        self,
        *,
        cursor: str | None = None,
        limit: int = 50,
        status: Literal["open", "closed"] | None = None,
        since: datetime | None = None,
        sort: Literal["oldest", "newest"] = "oldest",
    ) -> Page[CaseView]:
        """All cases; `since` is of the last change."""
        return self.send(calls.list_cases(cursor=cursor, limit=limit, status=status, since=since, sort=sort))

    def iterate_cases(
        self,
        *,
        limit: int = 50,
        status: Literal["open", "closed"] | None = None,
        since: datetime | None = None,
        sort: Literal["oldest", "newest"] = "oldest",
    ) -> Iterator[CaseView]:
        """The same, item by item through all pages."""
        cursor: str | None = None
        while True:
            page = self.send(calls.list_cases(cursor=cursor, limit=limit, status=status, since=since, sort=sort))
            yield from page.items
            if page.next_cursor is None:
                return
            cursor = page.next_cursor

    def read_case(self, case_id: str) -> CaseView:
        """A case with the state of its procedure and the next allowed actions."""
        return self.send(calls.read_case(case_id))

    def change_case(self, case_id: str, body: CasePatch = CasePatch(), *, if_match: str | None = None) -> CaseView:
        """Change the set-up: the revision counts up, and everything measured before is stale."""
        return self.send(calls.change_case(case_id, body, if_match=if_match))

    def read_case_part(self, case_id: str, kind: Literal["ring", "guide", "nail", "hexapod"]) -> bytes:
        """The ring, guide, nail or hexapod file as the case uses it, byte for byte: own files and calibrations too."""
        return self.send(calls.read_case_part(case_id, kind))

    def record_step(
        self, case_id: str, body: StepBody, *, if_match: str | None = None, idempotency_key: str | None = None
    ) -> CaseView:
        """Record what people did with their hands; `finished` and `abandoned` close the case."""
        return self.send(calls.record_step(case_id, body, if_match=if_match, idempotency_key=idempotency_key))

    def list_steps(self, case_id: str, *, cursor: str | None = None, limit: int = 50) -> Page[StepView]:
        """Steps that were recorded and not withdrawn, the oldest first."""
        return self.send(calls.list_steps(case_id, cursor=cursor, limit=limit))

    def iterate_steps(self, case_id: str, *, limit: int = 50) -> Iterator[StepView]:
        """The same, item by item through all pages."""
        cursor: str | None = None
        while True:
            page = self.send(calls.list_steps(case_id, cursor=cursor, limit=limit))
            yield from page.items
            if page.next_cursor is None:
                return
            cursor = page.next_cursor

    def withdraw_step(self, case_id: str, number: int) -> CaseView:
        """Take back the step that was recorded last, because it was not done."""
        return self.send(calls.withdraw_step(case_id, number))

    def read_timeline(self, case_id: str, *, cursor: str | None = None, limit: int = 50) -> Page[TimelineEntry]:
        """What happened, the oldest first; frames of running fluoroscopy and what only machines need are left out."""
        return self.send(calls.read_timeline(case_id, cursor=cursor, limit=limit))

    def iterate_timeline(self, case_id: str, *, limit: int = 50) -> Iterator[TimelineEntry]:
        """The same, item by item through all pages."""
        cursor: str | None = None
        while True:
            page = self.send(calls.read_timeline(case_id, cursor=cursor, limit=limit))
            yield from page.items
            if page.next_cursor is None:
                return
            cursor = page.next_cursor

    def list_images(
        self,
        case_id: str,
        *,
        cursor: str | None = None,
        limit: int = 50,
        since: datetime | None = None,
        sort: Literal["oldest", "newest"] = "oldest",
    ) -> Page[ImageView]:
        """The images of a case; of running fluoroscopy the newest frames, and those that were measured.

        Older frames are among the case's events, and `GET /images/{id}` knows them.
        """
        return self.send(calls.list_images(case_id, cursor=cursor, limit=limit, since=since, sort=sort))

    def iterate_images(
        self,
        case_id: str,
        *,
        limit: int = 50,
        since: datetime | None = None,
        sort: Literal["oldest", "newest"] = "oldest",
    ) -> Iterator[ImageView]:
        """The same, item by item through all pages."""
        cursor: str | None = None
        while True:
            page = self.send(calls.list_images(case_id, cursor=cursor, limit=limit, since=since, sort=sort))
            yield from page.items
            if page.next_cursor is None:
                return
            cursor = page.next_cursor

    def read_dicom(self, image_id: str) -> bytes:
        """The file exactly as imaging stored it: its SHA-256 is the image's id, and its ETag."""
        return self.send(calls.read_dicom(image_id))

    def read_png(
        self, image_id: str, *, view: Literal["raw", "corrected", "overlay"] = "raw", width: int | None = None
    ) -> bytes:
        """The image for people: as received, without distortion (`?view=corrected`), or with what was found (`overlay`)."""
        return self.send(calls.read_png(image_id, view=view, width=width))

    def read_image(self, image_id: str) -> ImageView:
        """What is known of an image."""
        return self.send(calls.read_image(image_id))

    def list_localisations(
        self,
        case_id: str,
        *,
        cursor: str | None = None,
        limit: int = 50,
        verdict: Literal["accepted", "rejected"] | None = None,
        sort: Literal["oldest", "newest"] = "oldest",
    ) -> Page[LocalisationView]:
        """The localisations of a case."""
        return self.send(calls.list_localisations(case_id, cursor=cursor, limit=limit, verdict=verdict, sort=sort))

    def iterate_localisations(
        self,
        case_id: str,
        *,
        limit: int = 50,
        verdict: Literal["accepted", "rejected"] | None = None,
        sort: Literal["oldest", "newest"] = "oldest",
    ) -> Iterator[LocalisationView]:
        """The same, item by item through all pages."""
        cursor: str | None = None
        while True:
            page = self.send(calls.list_localisations(case_id, cursor=cursor, limit=limit, verdict=verdict, sort=sort))
            yield from page.items
            if page.next_cursor is None:
                return
            cursor = page.next_cursor

    def read_localisation(self, case_id: str, number: int) -> LocalisationView:
        """What `locate` prints, plus provenance and whether it still holds."""
        return self.send(calls.read_localisation(case_id, number))

    def read_drawing(self, case_id: str, number: int) -> ImageDrawing:
        """What was found as vectors, for viewers that draw it over the image: balls with residuals, nail, holes, drill."""
        return self.send(calls.read_drawing(case_id, number))

    def read_alignment(self, case_id: str) -> AlignmentView:
        """How far and which way to turn the C-arm, from the newest localisation."""
        return self.send(calls.read_alignment(case_id))

    def make_plan(
        self, case_id: str, body: PlanBody, *, if_match: str | None = None, idempotency_key: str | None = None
    ) -> PlanView:
        """Plan the move that brings guide and nail axes together; moves nothing."""
        return self.send(calls.make_plan(case_id, body, if_match=if_match, idempotency_key=idempotency_key))

    def list_plans(
        self,
        case_id: str,
        *,
        cursor: str | None = None,
        limit: int = 50,
        hole: str | None = None,
        since: datetime | None = None,
        sort: Literal["oldest", "newest"] = "oldest",
    ) -> Page[PlanView]:
        """The plans of a case."""
        return self.send(calls.list_plans(case_id, cursor=cursor, limit=limit, hole=hole, since=since, sort=sort))

    def iterate_plans(
        self,
        case_id: str,
        *,
        limit: int = 50,
        hole: str | None = None,
        since: datetime | None = None,
        sort: Literal["oldest", "newest"] = "oldest",
    ) -> Iterator[PlanView]:
        """The same, item by item through all pages."""
        cursor: str | None = None
        while True:
            page = self.send(calls.list_plans(case_id, cursor=cursor, limit=limit, hole=hole, since=since, sort=sort))
            yield from page.items
            if page.next_cursor is None:
                return
            cursor = page.next_cursor

    def read_plan(self, case_id: str, number: int) -> PlanView:
        """A plan; its ETag is what an approval quotes."""
        return self.send(calls.read_plan(case_id, number))

    def approve_plan(
        self,
        case_id: str,
        number: int,
        body: ApprovalBody = ApprovalBody(),
        *,
        if_match: str | None = None,
        idempotency_key: str | None = None,
    ) -> ApprovalView:
        """Approve exactly the plan that was read, as a surgeon, with the credential once more."""
        return self.send(calls.approve_plan(case_id, number, body, if_match=if_match, idempotency_key=idempotency_key))

    def withdraw_approval(self, case_id: str, number: int) -> PlanView:
        """Take an approval back, as long as no motion has begun from it; then stop is what is left."""
        return self.send(calls.withdraw_approval(case_id, number))

    def begin_motion(
        self, case_id: str, body: MotionBody, *, if_match: str | None = None, idempotency_key: str | None = None
    ) -> OperationView:
        """Begin the move to an approved plan's target; its operation reports how it ends."""
        return self.send(calls.begin_motion(case_id, body, if_match=if_match, idempotency_key=idempotency_key))

    def list_operations(
        self,
        *,
        cursor: str | None = None,
        limit: int = 50,
        status: Literal["running", "unknown", "succeeded", "failed", "stopped", "cancelled"] | None = None,
        since: datetime | None = None,
        sort: Literal["oldest", "newest"] = "oldest",
    ) -> Page[OperationView]:
        """All operations, in the order in which they were asked for, and images on their way to a localisation."""
        return self.send(calls.list_operations(cursor=cursor, limit=limit, status=status, since=since, sort=sort))

    def iterate_operations(
        self,
        *,
        limit: int = 50,
        status: Literal["running", "unknown", "succeeded", "failed", "stopped", "cancelled"] | None = None,
        since: datetime | None = None,
        sort: Literal["oldest", "newest"] = "oldest",
    ) -> Iterator[OperationView]:
        """The same, item by item through all pages."""
        cursor: str | None = None
        while True:
            page = self.send(calls.list_operations(cursor=cursor, limit=limit, status=status, since=since, sort=sort))
            yield from page.items
            if page.next_cursor is None:
                return
            cursor = page.next_cursor

    def read_operation(self, operation_id: str) -> OperationView:
        """How far an operation has come: as a step of so many, in words, and as a fraction where that is known."""
        return self.send(calls.read_operation(operation_id))

    def cancel_operation(self, operation_id: str, *, idempotency_key: str | None = None) -> OperationView:
        """Wait no more for what is computed: nothing of it is kept. What moves the robot is ended by a stop alone."""
        return self.send(calls.cancel_operation(operation_id, idempotency_key=idempotency_key))

    def renew_lease(self, operation_id: str) -> LeaseView:
        """Go on holding: motion stops when this is not repeated in time. A lapsed lease cannot be renewed."""
        return self.send(calls.renew_lease(operation_id))

    def make_verification(
        self, case_id: str, body: VerificationBody, *, if_match: str | None = None, idempotency_key: str | None = None
    ) -> VerificationView:
        """Compare wires, or the guide alone, in one image or two with the nail's hole axes."""
        return self.send(calls.make_verification(case_id, body, if_match=if_match, idempotency_key=idempotency_key))

    def list_verifications(
        self,
        case_id: str,
        *,
        cursor: str | None = None,
        limit: int = 50,
        verdict: Literal["accepted", "rejected"] | None = None,
        sort: Literal["oldest", "newest"] = "oldest",
    ) -> Page[VerificationView]:
        """The verifications of a case."""
        return self.send(calls.list_verifications(case_id, cursor=cursor, limit=limit, verdict=verdict, sort=sort))

    def iterate_verifications(
        self,
        case_id: str,
        *,
        limit: int = 50,
        verdict: Literal["accepted", "rejected"] | None = None,
        sort: Literal["oldest", "newest"] = "oldest",
    ) -> Iterator[VerificationView]:
        """The same, item by item through all pages."""
        cursor: str | None = None
        while True:
            page = self.send(calls.list_verifications(case_id, cursor=cursor, limit=limit, verdict=verdict, sort=sort))
            yield from page.items
            if page.next_cursor is None:
                return
            cursor = page.next_cursor

    def read_verification(self, case_id: str, number: int) -> VerificationView:
        """One verification."""
        return self.send(calls.read_verification(case_id, number))

    def make_qa_report(
        self, case_id: str, body: QaBody, *, if_match: str | None = None, idempotency_key: str | None = None
    ) -> QaReportView:
        """Examine ring and C-arm over images of the case, best at one angle of the C-arm and without a patient."""
        return self.send(calls.make_qa_report(case_id, body, if_match=if_match, idempotency_key=idempotency_key))

    def list_qa_reports(self, case_id: str, *, cursor: str | None = None, limit: int = 50) -> Page[QaReportView]:
        """The quality reports of a case, the oldest first."""
        return self.send(calls.list_qa_reports(case_id, cursor=cursor, limit=limit))

    def iterate_qa_reports(self, case_id: str, *, limit: int = 50) -> Iterator[QaReportView]:
        """The same, item by item through all pages."""
        cursor: str | None = None
        while True:
            page = self.send(calls.list_qa_reports(case_id, cursor=cursor, limit=limit))
            yield from page.items
            if page.next_cursor is None:
                return
            cursor = page.next_cursor

    def read_qa_page(self, case_id: str, number: int) -> str:
        """A report as a page with pictures."""
        return self.send(calls.read_qa_page(case_id, number))

    def read_qa_report(self, case_id: str, number: int) -> QaReportView:
        """One report."""
        return self.send(calls.read_qa_report(case_id, number))

    def begin_computation(
        self, case_id: str, body: ComputationBody, *, if_match: str | None = None, idempotency_key: str | None = None
    ) -> OperationView:
        """Verify, report on images, or plan, without waiting for it; the operation can be followed and cancelled.

        What can be refused at once is refused at once; the operation's `result` is the path of what was made.
        """
        return self.send(calls.begin_computation(case_id, body, if_match=if_match, idempotency_key=idempotency_key))

    def read_robot(self) -> RobotView:
        """The robot as last seen, its age, and whether it says that it is simulated."""
        return self.send(calls.read_robot())

    def stop_robot(self) -> StopView:
        """Stop the robot now. Needs no key and no body, and waits for nothing but the robot's confirmation."""
        return self.send(calls.stop_robot())

    def reference_robot(self, *, idempotency_key: str | None = None) -> OperationView:
        """Reference the hexapod: only in set-up, with the guide off the bone."""
        return self.send(calls.reference_robot(idempotency_key=idempotency_key))

    def acknowledge_stop(self, *, idempotency_key: str | None = None) -> OperationView:
        """Release a stop, as a person who has looked."""
        return self.send(calls.acknowledge_stop(idempotency_key=idempotency_key))

    def reset_robot(self, *, idempotency_key: str | None = None) -> OperationView:
        """Leave a fault by connecting anew, after a person has seen to it; the robot is `stopped` then."""
        return self.send(calls.reset_robot(idempotency_key=idempotency_key))

    def read_alarms(self) -> AlarmsView:
        """Alarm conditions that hold now, by priority after IEC 60601-1-8, with what to do."""
        return self.send(calls.read_alarms())

    def list_parts(self) -> tuple[CatalogueView, ...]:
        """The catalogue, by name."""
        return self.send(calls.list_parts())

    def read_part(self, name: str) -> bytes:
        """A part file, as a case keeps it: its SHA-256 is the part's hash."""
        return self.send(calls.read_part(name))

    def sign_in(self, body: LoginBody) -> SessionView:
        """Open a session with name and password."""
        return self.send(calls.sign_in(body))

    def refresh_session(self, body: RefreshBody = RefreshBody()) -> SessionView:
        """Renew access with the refresh token, which is replaced."""
        return self.send(calls.refresh_session(body))

    def read_ways(self) -> WaysView:
        """How one can sign in here."""
        return self.send(calls.read_ways())

    def sign_out(self) -> None:
        """End this session and forget its cookies."""
        return self.send(calls.sign_out())

    def list_passkeys(self) -> PasskeysView:
        """Passkeys of the own account."""
        return self.send(calls.list_passkeys())

    def add_passkey(self, body: PasskeyBody) -> PasskeyView:
        """Keep a new passkey."""
        return self.send(calls.add_passkey(body))

    def begin_passkey(self) -> PasskeyOptions:
        """Options to make a passkey with; then `POST /users/me/passkeys`."""
        return self.send(calls.begin_passkey())

    def ask_challenge(self, body: ChallengeBody) -> PasskeyOptions:
        """Options to sign the approval of one plan with; then `POST .../approval` with `passkey`."""
        return self.send(calls.ask_challenge(body))

    def remove_passkey(self, passkey_id: str) -> None:
        """Forget a passkey of the own account."""
        return self.send(calls.remove_passkey(passkey_id))

    def remove_passkeys_of_user(self, name: str) -> None:
        """Forget all passkeys of a user: a phone was lost."""
        return self.send(calls.remove_passkeys_of_user(name))

    def read_me(self) -> MeView:
        """Who is signed in."""
        return self.send(calls.read_me())

    def change_own_password(self, body: PasswordBody) -> None:
        """Change the own password, with the old one; other sessions end."""
        return self.send(calls.change_own_password(body))

    def list_users(self, *, cursor: str | None = None, limit: int = 50) -> Page[UserView]:
        """All accounts, by name."""
        return self.send(calls.list_users(cursor=cursor, limit=limit))

    def iterate_users(self, *, limit: int = 50) -> Iterator[UserView]:
        """The same, item by item through all pages."""
        cursor: str | None = None
        while True:
            page = self.send(calls.list_users(cursor=cursor, limit=limit))
            yield from page.items
            if page.next_cursor is None:
                return
            cursor = page.next_cursor

    def create_user(self, body: UserBody, *, idempotency_key: str | None = None) -> UserView:
        """Make an account."""
        return self.send(calls.create_user(body, idempotency_key=idempotency_key))

    def read_user(self, name: str) -> UserView:
        """One account."""
        return self.send(calls.read_user(name))

    def change_user(self, name: str, body: UserPatch = UserPatch()) -> UserView:
        """Change roles or password, disable or enable; the user's sessions end."""
        return self.send(calls.change_user(name, body))

    def end_sessions(self, name: str) -> None:
        """End all sessions of a user now."""
        return self.send(calls.end_sessions(name))

    def read_health(self) -> HealthView:
        """Whether the process runs."""
        return self.send(calls.read_health())

    def read_readiness(self) -> ReadyView:
        """Whether bus, services, robot, database and disk do what they are there for; 503 with what does not."""
        return self.send(calls.read_readiness())

    def read_metrics(self) -> str:
        """Figures for Prometheus."""
        return self.send(calls.read_metrics())

    def read_diagnosis(self) -> DiagnosisView:
        """What of this machine, its folder and what runs would keep a procedure from going well, and what to do.

        It is looked at now, and may take two seconds. At ports, the C-arm's echo and the controller's own line looks
        `distalock doctor`, on the machine itself.
        """
        return self.send(calls.read_diagnosis())
