import { useState } from "react";
import { useTranslation } from "react-i18next";
import { useAlignment } from "../api/queries";
import type { Me, ReadCase, RobotSnapshot } from "../api/types";
import type { RoomScenario } from "../api/virtualRoom";
import ProcedurePanel from "../procedure/ProcedurePanel";
import VirtualRoom from "../room/VirtualRoom";
import CaseLine from "./CaseLine";
import Pictures from "./Pictures";
import { useCaseResults } from "./useCaseResults";

interface Props {
  readonly me: Me;
  readonly read: ReadCase;
  readonly robot: RobotSnapshot | null;
  readonly isLive: boolean;
  readonly scenario: RoomScenario | null;
}

/** The open case: procedure on the left, image, scene and robot, and in a simulation what hands do. */
export default function OpenCase({ me, read, robot, isLive, scenario }: Props) {
  const { t } = useTranslation();
  const results = useCaseResults(read, robot, isLive);
  const { plan, localisation, verification } = results;
  const advice = useAlignment(read.view.id, localisation !== null).data ?? null;
  const [showsRoom, setShowsRoom] = useState(true);
  return (
    <main className={scenario && showsRoom ? "room with-virtual-room" : "room"}>
      <h1 className="unseen">{t("nav.room")}</h1>
      <CaseLine view={read.view} />
      <ProcedurePanel
        read={read}
        me={me}
        plan={plan}
        localisation={localisation}
        verification={verification}
      />
      <Pictures {...results} />
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
