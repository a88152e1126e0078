// What people ask for. Each quotes the case as this page shows it, so that nobody acts on what he has not seen.
import { useMutation, useQueryClient } from "@tanstack/react-query";
import { answered, content, gateway, newKey, type Schemas } from "./client";
import { CASE } from "./queries";
import type { OperationView, PlanView, ReadCase } from "./types";

type ApprovalBody = Schemas["ApprovalBody"];
type PasskeyBody = Schemas["PasskeyBody"];
type PlanBody = Schemas["PlanBody"];
type StepBody = Schemas["StepBody"];
type VerificationBody = Schemas["VerificationBody"];
type CasePatch = Schemas["CasePatch"];
type UserBody = Schemas["UserBody"];
type UserPatch = Schemas["UserPatch"];
type CaseBody = Schemas["CaseBody"];

function key() {
  return { "Idempotency-Key": newKey() };
}

function quoting(read: ReadCase) {
  return { path: { case_id: read.view.id }, header: { ...key(), "If-Match": read.etag } };
}

export const act = {
  openCase: (body: CaseBody) => content(gateway.POST("/api/v1/cases", { params: { header: key() }, body })),
  changeSetUp: (read: ReadCase, body: CasePatch) =>
    content(
      gateway.PATCH("/api/v1/cases/{case_id}", {
        params: { path: { case_id: read.view.id }, header: { "If-Match": read.etag } },
        body,
      }),
    ),
  recordStep: (read: ReadCase, body: StepBody) =>
    content(gateway.POST("/api/v1/cases/{case_id}/steps", { params: quoting(read), body })),
  withdrawStep: (read: ReadCase, number: number) =>
    content(
      gateway.DELETE("/api/v1/cases/{case_id}/steps/{number}", {
        params: { path: { case_id: read.view.id, number } },
      }),
    ),
  requestPlan: (read: ReadCase, body: PlanBody) =>
    content(gateway.POST("/api/v1/cases/{case_id}/plans", { params: quoting(read), body })),
  approvePlan: (read: ReadCase, plan: PlanView, body: ApprovalBody) =>
    content(
      gateway.POST("/api/v1/cases/{case_id}/plans/{number}/approval", {
        params: {
          path: { case_id: read.view.id, number: plan.number },
          header: { ...key(), "If-Match": `"${plan.sha256}"` },
        },
        body,
      }),
    ),
  /** What a passkey has to sign for the approval of this plan, and of no other. */
  passkeyChallenge: (plan: PlanView) =>
    content(gateway.POST("/api/v1/users/me/passkeys/challenge", { body: { plan_sha256: plan.sha256 } })),
  passkeyOptions: () => content(gateway.POST("/api/v1/users/me/passkeys/registration")),
  addPasskey: (body: PasskeyBody) => content(gateway.POST("/api/v1/users/me/passkeys", { body })),
  removePasskey: (id: string) =>
    answered(
      gateway.DELETE("/api/v1/users/me/passkeys/{passkey_id}", { params: { path: { passkey_id: id } } }),
    ),
  withdrawApproval: (read: ReadCase, plan: number) =>
    content(
      gateway.DELETE("/api/v1/cases/{case_id}/plans/{number}/approval", {
        params: { path: { case_id: read.view.id, number: plan } },
      }),
    ),
  startMotion: (read: ReadCase, plan: number, holdToMove: boolean): Promise<OperationView> =>
    content(
      gateway.POST("/api/v1/cases/{case_id}/motions", {
        params: quoting(read),
        body: { plan, hold_to_move: holdToMove },
      }),
    ),
  verify: (read: ReadCase, body: VerificationBody) =>
    content(gateway.POST("/api/v1/cases/{case_id}/verifications", { params: quoting(read), body })),
  reference: () => content(gateway.POST("/api/v1/robot/reference", { params: { header: key() } })),
  acknowledgeStop: () =>
    content(gateway.POST("/api/v1/robot/acknowledge-stop", { params: { header: key() } })),
  reset: () => content(gateway.POST("/api/v1/robot/reset", { params: { header: key() } })),
  renewLease: (operation: string, signal: AbortSignal) =>
    content(
      gateway.PUT("/api/v1/operations/{operation_id}/lease", {
        params: { path: { operation_id: operation } },
        signal,
      }),
    ),
  signIn: (name: string, password: string) =>
    content(gateway.POST("/api/v1/sessions", { body: { name, password, keep: "cookie" } })),
  changePassword: (password: string, new_password: string) =>
    answered(gateway.PUT("/api/v1/users/me/password", { body: { password, new_password } })),
  addUser: (body: UserBody) => content(gateway.POST("/api/v1/users", { params: { header: key() }, body })),
  changeUser: (name: string, body: UserPatch) =>
    content(gateway.PATCH("/api/v1/users/{name}", { params: { path: { name } }, body })),
  endSessions: (name: string) =>
    answered(gateway.DELETE("/api/v1/users/{name}/sessions", { params: { path: { name } } })),
  signOut: async () => {
    await answered(gateway.DELETE("/api/v1/sessions/current"));
  },
};

/**
 * A mutation of the case or the robot: when it has ended, well or not, everything of cases is read anew. What was done
 * is under way until it shows, so that nobody does it twice; why it was not done is said at once, for it may be that
 * nothing can be read.
 */
export function useAct<Input, Output>(run: (input: Input) => Promise<Output>) {
  const client = useQueryClient();
  const readAnew = () => client.invalidateQueries({ queryKey: [CASE] });
  return useMutation<Output, Error, Input>({
    mutationFn: run,
    onSuccess: readAnew,
    onError: () => void readAnew(),
  });
}
