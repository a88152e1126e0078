import { lazy, Suspense } from "react";
import { useTranslation } from "react-i18next";
import Login from "./access/Login";
import { ApiError } from "./api/client";
import { useFollowing } from "./api/follow";
import {
  useCase,
  useMe,
  useNewestImage,
  useNewestLocalisation,
  useNewestPlan,
  useNewestVerification,
  useOpenCase,
  useRobot,
} from "./api/queries";
import type { Me, ReadCase, RobotSnapshot } from "./api/types";
import ImagePanel from "./image/ImagePanel";
import ProcedurePanel from "./procedure/ProcedurePanel";
import Banner from "./state/Banner";
import { connectionAt } from "./state/connection";
import StopButton from "./state/StopButton";
import { useNow } from "./state/useNow";

const ScenePanel = lazy(() => import("./scene/ScenePanel"));
const startedAtMs = performance.now();

export default function App() {
  const me = useMe();
  const isRefused = me.error instanceof ApiError && me.error.status === 401;
  const isSignedIn = me.data !== undefined && !isRefused;
  useFollowing(isSignedIn);
  return (
    <div className="page">
      <StopButton />
      {isSignedIn ? <Room me={me.data} /> : <Login />}
    </div>
  );
}

function Room({ me }: { readonly me: Me }) {
  const { t } = useTranslation();
  const robot = useRobot(true);
  const now = useNow();
  const snapshot = robot.data ?? null;
  const connection = connectionAt({ newestAtMs: snapshot?.gotAtMs ?? null, startedAtMs }, now);
  const open = useOpenCase(true);
  const read = useCase(open.data ?? null);
  return (
    <>
      <header className="head">
        <Banner me={me} robot={snapshot} />
        <p className={`connection ${connection}`} role="status">
          {t(`state.${connection}`)}
        </p>
      </header>
      {read.data ? (
        <OpenCase
          read={read.data}
          robot={snapshot}
          isLive={connection === "live" && snapshot?.view.validity === "current"}
        />
      ) : (
        <p className="empty">{t("cases.none_open")}</p>
      )}
    </>
  );
}

interface CaseProps {
  readonly read: ReadCase;
  readonly robot: RobotSnapshot | null;
  readonly isLive: boolean;
}

function OpenCase({ read, robot, isLive }: CaseProps) {
  const id = read.view.id;
  const newestImage = useNewestImage(id).data ?? null;
  const localisation = useNewestLocalisation(id).data ?? null;
  const plan = useNewestPlan(id).data ?? null;
  const verification = useNewestVerification(id).data ?? null;
  const shared = { caseView: read.view, newestImage, localisation, plan, verification, robot, isLive };
  return (
    <main className="room">
      <ProcedurePanel read={read} />
      <section className="image-place">
        <ImagePanel {...shared} />
      </section>
      <aside className="right">
        <Suspense fallback={null}>
          <ScenePanel {...shared} showsGhost={false} />
        </Suspense>
      </aside>
    </main>
  );
}
