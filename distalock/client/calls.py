"""What each operation sends, and what it answers with: pure, for both clients.

Written by `make generated` from `docs/openapi.json`; do not edit.
"""

from datetime import datetime
from typing import Literal

from distalock.client.base import Page
from distalock.client.call import Call, escaped, new_key, query
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


def open_case(body: CaseBody, *, idempotency_key: str | None = None) -> Call[CaseView]:
    """Open a case; one at a time in this room."""
    return Call("POST", "/api/v1/cases", CaseView, body=body, key=idempotency_key or new_key())


def list_cases(
    *,
    cursor: str | None = None,
    limit: int = 50,
    status: Literal["open", "closed"] | None = None,
    since: datetime | None = None,
    sort: Literal["oldest", "newest"] = "oldest",
) -> Call[Page[CaseView]]:
    """All cases; `since` is of the last change."""
    return Call(
        "GET",
        "/api/v1/cases",
        Page[CaseView],
        query=query(("cursor", cursor), ("limit", limit), ("status", status), ("since", since), ("sort", sort)),
    )


def read_case(case_id: str) -> Call[CaseView]:
    """A case with the state of its procedure and the next allowed actions."""
    return Call("GET", f"/api/v1/cases/{escaped(case_id)}", CaseView)


def change_case(case_id: str, body: CasePatch = CasePatch(), *, if_match: str | None = None) -> Call[CaseView]:
    """Change the set-up: the revision counts up, and everything measured before is stale."""
    return Call(
        "PATCH",
        f"/api/v1/cases/{escaped(case_id)}",
        CaseView,
        body=body,
        matches=f"/api/v1/cases/{escaped(case_id)}",
        if_match=if_match,
    )


def read_case_part(case_id: str, kind: Literal["ring", "guide", "nail", "hexapod"]) -> Call[bytes]:
    """The ring, guide, nail or hexapod file as the case uses it, byte for byte: own files and calibrations too."""
    return Call("GET", f"/api/v1/cases/{escaped(case_id)}/parts/{kind}", bytes)


def record_step(
    case_id: str, body: StepBody, *, if_match: str | None = None, idempotency_key: str | None = None
) -> Call[CaseView]:
    """Record what people did with their hands; `finished` and `abandoned` close the case."""
    return Call(
        "POST",
        f"/api/v1/cases/{escaped(case_id)}/steps",
        CaseView,
        body=body,
        key=idempotency_key or new_key(),
        matches=f"/api/v1/cases/{escaped(case_id)}",
        if_match=if_match,
    )


def list_steps(case_id: str, *, cursor: str | None = None, limit: int = 50) -> Call[Page[StepView]]:
    """Steps that were recorded and not withdrawn, the oldest first."""
    return Call(
        "GET",
        f"/api/v1/cases/{escaped(case_id)}/steps",
        Page[StepView],
        query=query(("cursor", cursor), ("limit", limit)),
    )


def withdraw_step(case_id: str, number: int) -> Call[CaseView]:
    """Take back the step that was recorded last, because it was not done."""
    return Call("DELETE", f"/api/v1/cases/{escaped(case_id)}/steps/{number}", CaseView)


def read_timeline(case_id: str, *, cursor: str | None = None, limit: int = 50) -> Call[Page[TimelineEntry]]:
    """What happened, the oldest first; frames of running fluoroscopy and what only machines need are left out."""
    return Call(
        "GET",
        f"/api/v1/cases/{escaped(case_id)}/timeline",
        Page[TimelineEntry],
        query=query(("cursor", cursor), ("limit", limit)),
    )


def list_images(
    case_id: str,
    *,
    cursor: str | None = None,
    limit: int = 50,
    since: datetime | None = None,
    sort: Literal["oldest", "newest"] = "oldest",
) -> Call[Page[ImageView]]:
    """The images of a case; of running fluoroscopy the newest frames, and those that were measured.

    Older frames are among the case's events, and `GET /images/{id}` knows them.
    """
    return Call(
        "GET",
        f"/api/v1/cases/{escaped(case_id)}/images",
        Page[ImageView],
        query=query(("cursor", cursor), ("limit", limit), ("since", since), ("sort", sort)),
    )


def read_dicom(image_id: str) -> Call[bytes]:
    """The file exactly as imaging stored it: its SHA-256 is the image's id, and its ETag."""
    return Call("GET", f"/api/v1/images/{escaped(image_id)}.dcm", bytes)


def read_png(
    image_id: str, *, view: Literal["raw", "corrected", "overlay"] = "raw", width: int | None = None
) -> Call[bytes]:
    """The image for people: as received, without distortion (`?view=corrected`), or with what was found (`overlay`)."""
    return Call("GET", f"/api/v1/images/{escaped(image_id)}.png", bytes, query=query(("view", view), ("width", width)))


def read_image(image_id: str) -> Call[ImageView]:
    """What is known of an image."""
    return Call("GET", f"/api/v1/images/{escaped(image_id)}", ImageView)


def list_localisations(
    case_id: str,
    *,
    cursor: str | None = None,
    limit: int = 50,
    verdict: Literal["accepted", "rejected"] | None = None,
    sort: Literal["oldest", "newest"] = "oldest",
) -> Call[Page[LocalisationView]]:
    """The localisations of a case."""
    return Call(
        "GET",
        f"/api/v1/cases/{escaped(case_id)}/localisations",
        Page[LocalisationView],
        query=query(("cursor", cursor), ("limit", limit), ("verdict", verdict), ("sort", sort)),
    )


def read_localisation(case_id: str, number: int) -> Call[LocalisationView]:
    """What `locate` prints, plus provenance and whether it still holds."""
    return Call("GET", f"/api/v1/cases/{escaped(case_id)}/localisations/{number}", LocalisationView)


def read_drawing(case_id: str, number: int) -> Call[ImageDrawing]:
    """What was found as vectors, for viewers that draw it over the image: balls with residuals, nail, holes, drill."""
    return Call("GET", f"/api/v1/cases/{escaped(case_id)}/localisations/{number}/drawing", ImageDrawing)


def read_alignment(case_id: str) -> Call[AlignmentView]:
    """How far and which way to turn the C-arm, from the newest localisation."""
    return Call("GET", f"/api/v1/cases/{escaped(case_id)}/alignment", AlignmentView)


def make_plan(
    case_id: str, body: PlanBody, *, if_match: str | None = None, idempotency_key: str | None = None
) -> Call[PlanView]:
    """Plan the move that brings guide and nail axes together; moves nothing."""
    return Call(
        "POST",
        f"/api/v1/cases/{escaped(case_id)}/plans",
        PlanView,
        body=body,
        key=idempotency_key or new_key(),
        matches=f"/api/v1/cases/{escaped(case_id)}",
        if_match=if_match,
    )


def list_plans(
    case_id: str,
    *,
    cursor: str | None = None,
    limit: int = 50,
    hole: str | None = None,
    since: datetime | None = None,
    sort: Literal["oldest", "newest"] = "oldest",
) -> Call[Page[PlanView]]:
    """The plans of a case."""
    return Call(
        "GET",
        f"/api/v1/cases/{escaped(case_id)}/plans",
        Page[PlanView],
        query=query(("cursor", cursor), ("limit", limit), ("hole", hole), ("since", since), ("sort", sort)),
    )


def read_plan(case_id: str, number: int) -> Call[PlanView]:
    """A plan; its ETag is what an approval quotes."""
    return Call("GET", f"/api/v1/cases/{escaped(case_id)}/plans/{number}", PlanView)


def approve_plan(
    case_id: str,
    number: int,
    body: ApprovalBody = ApprovalBody(),
    *,
    if_match: str | None = None,
    idempotency_key: str | None = None,
) -> Call[ApprovalView]:
    """Approve exactly the plan that was read, as a surgeon, with the credential once more."""
    return Call(
        "POST",
        f"/api/v1/cases/{escaped(case_id)}/plans/{number}/approval",
        ApprovalView,
        body=body,
        key=idempotency_key or new_key(),
        matches=f"/api/v1/cases/{escaped(case_id)}/plans/{number}",
        if_match=if_match,
    )


def withdraw_approval(case_id: str, number: int) -> Call[PlanView]:
    """Take an approval back, as long as no motion has begun from it; then stop is what is left."""
    return Call("DELETE", f"/api/v1/cases/{escaped(case_id)}/plans/{number}/approval", PlanView)


def begin_motion(
    case_id: str, body: MotionBody, *, if_match: str | None = None, idempotency_key: str | None = None
) -> Call[OperationView]:
    """Begin the move to an approved plan's target; its operation reports how it ends."""
    return Call(
        "POST",
        f"/api/v1/cases/{escaped(case_id)}/motions",
        OperationView,
        body=body,
        key=idempotency_key or new_key(),
        matches=f"/api/v1/cases/{escaped(case_id)}",
        if_match=if_match,
    )


def list_operations(
    *,
    cursor: str | None = None,
    limit: int = 50,
    status: Literal["running", "unknown", "succeeded", "failed", "stopped", "cancelled"] | None = None,
    since: datetime | None = None,
    sort: Literal["oldest", "newest"] = "oldest",
) -> Call[Page[OperationView]]:
    """All operations, in the order in which they were asked for, and images on their way to a localisation."""
    return Call(
        "GET",
        "/api/v1/operations",
        Page[OperationView],
        query=query(("cursor", cursor), ("limit", limit), ("status", status), ("since", since), ("sort", sort)),
    )


def read_operation(operation_id: str) -> Call[OperationView]:
    """How far an operation has come: as a step of so many, in words, and as a fraction where that is known."""
    return Call("GET", f"/api/v1/operations/{escaped(operation_id)}", OperationView)


def cancel_operation(operation_id: str, *, idempotency_key: str | None = None) -> Call[OperationView]:
    """Wait no more for what is computed: nothing of it is kept. What moves the robot is ended by a stop alone."""
    return Call(
        "POST", f"/api/v1/operations/{escaped(operation_id)}/cancel", OperationView, key=idempotency_key or new_key()
    )


def renew_lease(operation_id: str) -> Call[LeaseView]:
    """Go on holding: motion stops when this is not repeated in time. A lapsed lease cannot be renewed."""
    return Call("PUT", f"/api/v1/operations/{escaped(operation_id)}/lease", LeaseView)


def make_verification(
    case_id: str, body: VerificationBody, *, if_match: str | None = None, idempotency_key: str | None = None
) -> Call[VerificationView]:
    """Compare wires, or the guide alone, in one image or two with the nail's hole axes."""
    return Call(
        "POST",
        f"/api/v1/cases/{escaped(case_id)}/verifications",
        VerificationView,
        body=body,
        key=idempotency_key or new_key(),
        matches=f"/api/v1/cases/{escaped(case_id)}",
        if_match=if_match,
    )


def list_verifications(
    case_id: str,
    *,
    cursor: str | None = None,
    limit: int = 50,
    verdict: Literal["accepted", "rejected"] | None = None,
    sort: Literal["oldest", "newest"] = "oldest",
) -> Call[Page[VerificationView]]:
    """The verifications of a case."""
    return Call(
        "GET",
        f"/api/v1/cases/{escaped(case_id)}/verifications",
        Page[VerificationView],
        query=query(("cursor", cursor), ("limit", limit), ("verdict", verdict), ("sort", sort)),
    )


def read_verification(case_id: str, number: int) -> Call[VerificationView]:
    """One verification."""
    return Call("GET", f"/api/v1/cases/{escaped(case_id)}/verifications/{number}", VerificationView)


def make_qa_report(
    case_id: str, body: QaBody, *, if_match: str | None = None, idempotency_key: str | None = None
) -> Call[QaReportView]:
    """Examine ring and C-arm over images of the case, best at one angle of the C-arm and without a patient."""
    return Call(
        "POST",
        f"/api/v1/cases/{escaped(case_id)}/qa-reports",
        QaReportView,
        body=body,
        key=idempotency_key or new_key(),
        matches=f"/api/v1/cases/{escaped(case_id)}",
        if_match=if_match,
    )


def list_qa_reports(case_id: str, *, cursor: str | None = None, limit: int = 50) -> Call[Page[QaReportView]]:
    """The quality reports of a case, the oldest first."""
    return Call(
        "GET",
        f"/api/v1/cases/{escaped(case_id)}/qa-reports",
        Page[QaReportView],
        query=query(("cursor", cursor), ("limit", limit)),
    )


def read_qa_page(case_id: str, number: int) -> Call[str]:
    """A report as a page with pictures."""
    return Call("GET", f"/api/v1/cases/{escaped(case_id)}/qa-reports/{number}.html", str)


def read_qa_report(case_id: str, number: int) -> Call[QaReportView]:
    """One report."""
    return Call("GET", f"/api/v1/cases/{escaped(case_id)}/qa-reports/{number}", QaReportView)


def begin_computation(
    case_id: str, body: ComputationBody, *, if_match: str | None = None, idempotency_key: str | None = None
) -> Call[OperationView]:
    """Verify, report on images, or plan, without waiting for it; the operation can be followed and cancelled.

    What can be refused at once is refused at once; the operation's `result` is the path of what was made.
    """
    return Call(
        "POST",
        f"/api/v1/cases/{escaped(case_id)}/operations",
        OperationView,
        body=body,
        key=idempotency_key or new_key(),
        matches=f"/api/v1/cases/{escaped(case_id)}",
        if_match=if_match,
    )


def read_robot() -> Call[RobotView]:
    """The robot as last seen, its age, and whether it says that it is simulated."""
    return Call("GET", "/api/v1/robot", RobotView)


def stop_robot() -> Call[StopView]:
    """Stop the robot now. Needs no key and no body, and waits for nothing but the robot's confirmation."""
    return Call("POST", "/api/v1/robot/stop", StopView)


def reference_robot(*, idempotency_key: str | None = None) -> Call[OperationView]:
    """Reference the hexapod: only in set-up, with the guide off the bone."""
    return Call("POST", "/api/v1/robot/reference", OperationView, key=idempotency_key or new_key())


def acknowledge_stop(*, idempotency_key: str | None = None) -> Call[OperationView]:
    """Release a stop, as a person who has looked."""
    return Call("POST", "/api/v1/robot/acknowledge-stop", OperationView, key=idempotency_key or new_key())


def reset_robot(*, idempotency_key: str | None = None) -> Call[OperationView]:
    """Leave a fault by connecting anew, after a person has seen to it; the robot is `stopped` then."""
    return Call("POST", "/api/v1/robot/reset", OperationView, key=idempotency_key or new_key())


def read_alarms() -> Call[AlarmsView]:
    """Alarm conditions that hold now, by priority after IEC 60601-1-8, with what to do."""
    return Call("GET", "/api/v1/alarms", AlarmsView)


def list_parts() -> Call[tuple[CatalogueView, ...]]:
    """The catalogue, by name."""
    return Call("GET", "/api/v1/parts", tuple[CatalogueView, ...])


def read_part(name: str) -> Call[bytes]:
    """A part file, as a case keeps it: its SHA-256 is the part's hash."""
    return Call("GET", f"/api/v1/parts/{escaped(name)}", bytes)


def sign_in(body: LoginBody) -> Call[SessionView]:
    """Open a session with name and password."""
    return Call("POST", "/api/v1/sessions", SessionView, body=body)


def refresh_session(body: RefreshBody = RefreshBody()) -> Call[SessionView]:
    """Renew access with the refresh token, which is replaced."""
    return Call("POST", "/api/v1/sessions/refresh", SessionView, body=body)


def read_ways() -> Call[WaysView]:
    """How one can sign in here."""
    return Call("GET", "/api/v1/sessions/ways", WaysView)


def sign_out() -> Call[None]:
    """End this session and forget its cookies."""
    return Call("DELETE", "/api/v1/sessions/current", type(None))


def list_passkeys() -> Call[PasskeysView]:
    """Passkeys of the own account."""
    return Call("GET", "/api/v1/users/me/passkeys", PasskeysView)


def add_passkey(body: PasskeyBody) -> Call[PasskeyView]:
    """Keep a new passkey."""
    return Call("POST", "/api/v1/users/me/passkeys", PasskeyView, body=body)


def begin_passkey() -> Call[PasskeyOptions]:
    """Options to make a passkey with; then `POST /users/me/passkeys`."""
    return Call("POST", "/api/v1/users/me/passkeys/registration", PasskeyOptions)


def ask_challenge(body: ChallengeBody) -> Call[PasskeyOptions]:
    """Options to sign the approval of one plan with; then `POST .../approval` with `passkey`."""
    return Call("POST", "/api/v1/users/me/passkeys/challenge", PasskeyOptions, body=body)


def remove_passkey(passkey_id: str) -> Call[None]:
    """Forget a passkey of the own account."""
    return Call("DELETE", f"/api/v1/users/me/passkeys/{escaped(passkey_id)}", type(None))


def remove_passkeys_of_user(name: str) -> Call[None]:
    """Forget all passkeys of a user: a phone was lost."""
    return Call("DELETE", f"/api/v1/users/{escaped(name)}/passkeys", type(None))


def read_me() -> Call[MeView]:
    """Who is signed in."""
    return Call("GET", "/api/v1/users/me", MeView)


def change_own_password(body: PasswordBody) -> Call[None]:
    """Change the own password, with the old one; other sessions end."""
    return Call("PUT", "/api/v1/users/me/password", type(None), body=body)


def list_users(*, cursor: str | None = None, limit: int = 50) -> Call[Page[UserView]]:
    """All accounts, by name."""
    return Call("GET", "/api/v1/users", Page[UserView], query=query(("cursor", cursor), ("limit", limit)))


def create_user(body: UserBody, *, idempotency_key: str | None = None) -> Call[UserView]:
    """Make an account."""
    return Call("POST", "/api/v1/users", UserView, body=body, key=idempotency_key or new_key())


def read_user(name: str) -> Call[UserView]:
    """One account."""
    return Call("GET", f"/api/v1/users/{escaped(name)}", UserView)


def change_user(name: str, body: UserPatch = UserPatch()) -> Call[UserView]:
    """Change roles or password, disable or enable; the user's sessions end."""
    return Call("PATCH", f"/api/v1/users/{escaped(name)}", UserView, body=body)


def end_sessions(name: str) -> Call[None]:
    """End all sessions of a user now."""
    return Call("DELETE", f"/api/v1/users/{escaped(name)}/sessions", type(None))


def read_health() -> Call[HealthView]:
    """Whether the process runs."""
    return Call("GET", "/healthz", HealthView)


def read_readiness() -> Call[ReadyView]:
    """Whether bus, services, robot, database and disk do what they are there for; 503 with what does not."""
    return Call("GET", "/readyz", ReadyView)


def read_metrics() -> Call[str]:
    """Figures for Prometheus."""
    return Call("GET", "/metrics", str)


def read_diagnosis() -> Call[DiagnosisView]:
    """What of this machine, its folder and what runs would keep a procedure from going well, and what to do.

    It is looked at now, and may take two seconds. At ports, the C-arm's echo and the controller's own line looks
    `distalock doctor`, on the machine itself.
    """
    return Call("GET", "/api/v1/diagnosis", DiagnosisView)
