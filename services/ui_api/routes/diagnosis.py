"""`GET /diagnosis`: what `distalock doctor` finds, as far as it can be seen from the gateway."""

from typing import Final

from pydantic import Field

from services.ui_api.core.roles import Action
from services.ui_api.routes.access import TheGateway
from services.ui_api.routes.guards import needs
from services.ui_api.routes.routers import resource_router
from services.ui_api.routes.views import View
from shared.doctor.finding import Finding, Verdict

router = resource_router("/diagnosis", tag="health")
# The worst comes first.
_WORSE: Final = (Verdict.WRONG, Verdict.ATTENTION, Verdict.WELL, Verdict.UNKNOWN)


class FindingView(View):
    """One thing that was looked at."""

    name: str
    verdict: Verdict
    measured: str
    remedy: str = Field(description="What to do; empty where nothing is to be done.")

    @staticmethod
    def of(finding: Finding) -> "FindingView":
        """From the finding."""
        return FindingView(name=finding.name, verdict=finding.verdict, measured=finding.measured, remedy=finding.remedy)


class DiagnosisView(View):
    """Everything that was looked at, and the worst of it."""

    verdict: Verdict
    findings: list[FindingView]


@router.get("", openapi_extra=needs(Action.DIAGNOSE))
def read_diagnosis(gateway: TheGateway) -> DiagnosisView:
    """What of this machine, its folder and what runs would keep a procedure from going well, and what to do.

    It is looked at now, and may take two seconds. At ports, the C-arm's echo and the controller's own line looks
    `distalock doctor`, on the machine itself.
    """
    findings = [FindingView.of(finding) for finding in gateway.diagnosis.findings()]
    return DiagnosisView(verdict=min((one.verdict for one in findings), key=_WORSE.index), findings=findings)
