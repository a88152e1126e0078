// Names of what the gateway sends, as the panels use them.
import type { Schemas } from "./client";

export type CaseView = Schemas["CaseView"];
export type Procedure = Schemas["ProcedureView"];
export type ActionView = Schemas["ActionView"];
export type ImageView = Schemas["ImageView"];
export type LocalisationView = Schemas["LocalisationView"];
export type PlanView = Schemas["PlanView"];
export type VerificationView = Schemas["VerificationView"];
export type RobotView = Schemas["RobotView"];
export type RobotState = NonNullable<RobotView["state"]>;
export type OperationView = Schemas["OperationView"];
export type AlignmentView = Schemas["AlignmentView"];
export type GuidanceView = Schemas["GuidanceView"];
export type TimelineEntry = Schemas["TimelineEntry"];
export type Me = Schemas["MeView"];
export type CatalogueView = Schemas["CatalogueView"];
export type CheckView = Schemas["CheckView"];
export type UserView = Schemas["UserView"];
export type CaseBody = Schemas["CaseBody"];

/** A case and the ETag under which it was read: every change quotes it. */
export interface ReadCase {
  readonly view: CaseView;
  readonly etag: string;
}

/** The robot's newest state, and when this page got it, by the page's monotonic clock. */
export interface RobotSnapshot {
  readonly view: RobotView;
  readonly gotAtMs: number;
}
