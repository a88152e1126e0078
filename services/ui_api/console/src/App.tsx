import { lazy, Suspense, useState } from "react";
import { useTranslation } from "react-i18next";
import Login from "./access/Login";
import { ApiError } from "./api/client";
import { useFollowing } from "./api/follow";
import {
  useAlignment,
  useCase,
  useMe,
  useNewestImage,
  useNewestLocalisation,
  useNewestPlan,
  useNewestVerification,
  useOpenCase,
  useReadiness,
  useRobot,
} from "./api/queries";
import type { Me, ReadCase, RobotSnapshot } from "./api/types";
import { type RoomScenario, useScenario } from "./api/virtualRoom";
import ImagePanel from "./image/ImagePanel";
import PhaseLine from "./procedure/PhaseLine";
import ProcedurePanel from "./procedure/ProcedurePanel";
import { OpenCaseForm } from "./procedure/SetUpForm";
import RobotActions from "./robot/RobotActions";
import RobotPanel from "./robot/RobotPanel";
import VirtualRoom from "./room/VirtualRoom";
import { alarmsOf } from "./state/alarms";
import { connectionAt } from "./state/connection";
import Head from "./state/Head";
import { type Place, usePlace } from "./state/place";
import StopButton from "./state/StopButton";
import { useNow } from "./state/useNow";
import { useStop } from "./state/useStop";

const ScenePanel = lazy(() => import("./scene/ScenePanel"));
const Cases = lazy(() => import("./records/Cases"));
const CaseRecord = lazy(() => import("./records/CaseRecord"));
const Service = lazy(() => import("./records/Service"));
const Users = lazy(() => import("./access/Users"));
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
        {place.name === "room" ? (
          <Room me={me} caseId={caseId} robot={robot} isLive={isLive} isKnown={open.isSuccess} />
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
      return null;
  }
}

interface RoomProps {
  readonly me: Me;
  readonly caseId: string | null;
  readonly robot: RobotSnapshot | null;
  readonly isLive: boolean;
  readonly isKnown: boolean;
}

function Room({ me, caseId, robot, isLive, isKnown }: RoomProps) {
  const { t } = useTranslation();
  const isSimulated = robot?.view.simulated === true || robot?.view.image_source_simulated === true;
  const scenario = useScenario(isSimulated).data ?? null;
  const read = useCase(caseId).data;
  if (read && read.view.id === caseId)
    return <OpenCase me={me} read={read} robot={robot} isLive={isLive} scenario={scenario} />;
  if (!isKnown || caseId !== null) return <main className="room" />;
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

interface CaseProps {
  readonly me: Me;
  readonly read: ReadCase;
  readonly robot: RobotSnapshot | null;
  readonly isLive: boolean;
  readonly scenario: RoomScenario | null;
}

function OpenCase({ me, read, robot, isLive, scenario }: CaseProps) {
  const { t } = useTranslation();
  const id = read.view.id;
  const newestImage = useNewestImage(id).data ?? null;
  const localisation = useNewestLocalisation(id).data ?? null;
  const plan = useNewestPlan(id).data ?? null;
  const verification = useNewestVerification(id).data ?? null;
  const advice = useAlignment(id, localisation !== null).data ?? null;
  const [showsRoom, setShowsRoom] = useState(true);
  const shared = { caseView: read.view, newestImage, localisation, plan, verification, robot, isLive };
  return (
    <main className={scenario && showsRoom ? "room with-virtual-room" : "room"}>
      <h1 className="unseen">{t("nav.room")}</h1>
      <div className="case-line">
        <p className="side">
          {t(`case.side.${read.view.side}`)} {t(`case.bone.${read.view.bone}`)}
        </p>
        <PhaseLine procedure={read.view.procedure} />
      </div>
      <ProcedurePanel
        read={read}
        me={me}
        plan={plan}
        localisation={localisation}
        verification={verification}
      />
      <section className="image-place" aria-label={t("image.title")}>
        <ImagePanel {...shared} />
      </section>
      <aside className="right">
        <div className="scene-place">
          <ScenePanel {...shared} showsGhost={read.view.procedure.phase === "approval"} />
        </div>
        <RobotPanel robot={robot} isLive={isLive} />
      </aside>
      {scenario && !showsRoom && (
        <button
          type="button"
          className="virtual-room-toggle"
          aria-expanded={false}
          onClick={() => setShowsRoom(true)}
        >
          {t("room.title")}
        </button>
      )}
      {scenario && showsRoom && (
        <VirtualRoom holeIds={scenario.hole_ids} advice={advice} onHide={() => setShowsRoom(false)} />
      )}
    </main>
  );
}
