import { lazy, Suspense } from "react";
import { useTranslation } from "react-i18next";
import Login from "./access/Login";
import { ApiError } from "./api/client";
import { useFollowing } from "./api/follow";
import { useCase, useMe, useOpenCase, useReadiness, useRobot } from "./api/queries";
import type { Me, RobotSnapshot } from "./api/types";
import { useScenario } from "./api/virtualRoom";
import OpenCase from "./case/OpenCase";
import { OpenCaseForm } from "./procedure/SetUpForm";
import RobotActions from "./robot/RobotActions";
import RobotPanel from "./robot/RobotPanel";
import { alarmsOf } from "./state/alarms";
import { connectionAt } from "./state/connection";
import Head from "./state/Head";
import { type Place, usePlace } from "./state/place";
import StopButton from "./state/StopButton";
import { useNow } from "./state/useNow";
import { useStop } from "./state/useStop";

const Cases = lazy(() => import("./records/Cases"));
const CaseRecord = lazy(() => import("./records/CaseRecord"));
const Service = lazy(() => import("./records/Service"));
const Users = lazy(() => import("./access/Users"));
const WallScreen = lazy(() => import("./case/WallScreen"));
const startedAtMs = performance.now();

export default function App() {
  const me = useMe();
  const stop = useStop();
  const isRefused = me.error instanceof ApiError && me.error.status === 401;
  const isSignedIn = me.data !== undefined && !isRefused;
  useFollowing(isSignedIn);
  return (
    <div className="page">
      <StopButton stop={stop} />
      {isSignedIn && <SignedIn me={me.data} stopNotConfirmed={stop[0].phase === "not_confirmed"} />}
      {isRefused && <Login isAgain={me.data !== undefined} />}
      {!isSignedIn && !isRefused && <Waiting hasFailed={me.failureCount > 0} />}
    </div>
  );
}

function Waiting({ hasFailed }: { readonly hasFailed: boolean }) {
  const { t } = useTranslation();
  return (
    <main className="waiting">
      <p role="status">{t(hasFailed ? "state.no_answer" : "state.waiting")}</p>
    </main>
  );
}

function SignedIn({ me, stopNotConfirmed }: { readonly me: Me; readonly stopNotConfirmed: boolean }) {
  const place = usePlace();
  const now = useNow();
  const robot = useRobot(me.actions.includes("read")).data ?? null;
  const checks = useReadiness().data ?? [];
  const connection = connectionAt({ newestAtMs: robot?.gotAtMs ?? null, startedAtMs }, now);
  const open = useOpenCase(me.actions.includes("read"));
  const caseId = open.data ?? null;
  const alarms = alarmsOf({ connection, robot, checks, stopNotConfirmed, hasCase: caseId !== null });
  const isLive = connection === "live" && robot?.view.validity === "current";
  return (
    <>
      <Head me={me} robot={robot} connection={connection} alarms={alarms} place={place} />
      <Suspense fallback={null}>
        {place.name === "room" || place.name === "wall" ? (
          <Room
            me={me}
            caseId={caseId}
            robot={robot}
            isLive={isLive}
            isKnown={open.isSuccess}
            isWall={place.name === "wall"}
          />
        ) : (
          <OtherPlace place={place} me={me} />
        )}
      </Suspense>
    </>
  );
}

function OtherPlace({ place, me }: { readonly place: Place; readonly me: Me }) {
  switch (place.name) {
    case "cases":
      return <Cases />;
    case "case":
      return <CaseRecord id={place.id} />;
    case "users":
      return <Users me={me} />;
    case "service":
      return <Service />;
    case "room":
    case "wall":
      return null;
  }
}

interface RoomProps {
  readonly me: Me;
  readonly caseId: string | null;
  readonly robot: RobotSnapshot | null;
  readonly isLive: boolean;
  readonly isKnown: boolean;
  /** Only to be looked at. */
  readonly isWall: boolean;
}

function Room({ me, caseId, robot, isLive, isKnown, isWall }: RoomProps) {
  const { t } = useTranslation();
  const isSimulated = robot?.view.simulated === true || robot?.view.image_source_simulated === true;
  const scenario = useScenario(isSimulated && !isWall).data ?? null;
  const read = useCase(caseId).data;
  const isRead = read !== undefined && read.view.id === caseId;
  if (isRead && isWall) return <WallScreen read={read} robot={robot} isLive={isLive} />;
  if (isRead) return <OpenCase me={me} read={read} robot={robot} isLive={isLive} scenario={scenario} />;
  if (!isKnown || caseId !== null) return <main className="room" />;
  if (isWall)
    return (
      <main className="wall without-case">
        <h1>{t("wall.no_case")}</h1>
      </main>
    );
  return (
    <main className="no-case">
      <h1 className="unseen">{t("nav.room")}</h1>
      {me.actions.includes("open_case") && <OpenCaseForm proposed={scenario?.case ?? null} />}
      <div>
        <RobotPanel robot={robot} isLive={isLive} />
        <RobotActions robot={robot} me={me} />
      </div>
    </main>
  );
}
