// What the panels of the image and of the scene get. They read more themselves, with the hooks of `api/`.
import type {
  CaseView,
  ImageView,
  LocalisationView,
  PlanView,
  RobotSnapshot,
  VerificationView,
} from "./api/types";

interface SharedProps {
  readonly caseView: CaseView;
  /** The case's newest image; null before the first. Frames of running fluoroscopy come by `useLive()`. */
  readonly newestImage: ImageView | null;
  /** The newest localisation; it may be of an older image than the newest: compare `image.sha256`. */
  readonly localisation: LocalisationView | null;
  readonly plan: PlanView | null;
  readonly verification: VerificationView | null;
  /** The robot's newest state; `null` until there is one. */
  readonly robot: RobotSnapshot | null;
  /** False while the gateway does not answer, or the robot's state is stale: nothing may look live then. */
  readonly isLive: boolean;
}

/** `image/ImagePanel.tsx`: fills its place, which it must not outgrow. */
export type ImagePanelProps = SharedProps;

/** `scene/ScenePanel.tsx`: fills its place, which it must not outgrow. */
export interface ScenePanelProps extends SharedProps {
  /** Play the planned motion as a ghost, because the surgeon looks at it before he approves. */
  readonly showsGhost: boolean;
}
