import { useTranslation } from "react-i18next";
import UserMenu from "../access/UserMenu";
import type { Me, RobotSnapshot } from "../api/types";
import Alarms, { AlarmSound } from "./Alarms";
import type { Alarm } from "./alarms";
import Banner from "./Banner";
import type { Connection } from "./connection";
import type { Place } from "./place";

const PLACES = ["room", "wall", "cases", "users", "service"] as const;

interface Props {
  readonly me: Me;
  readonly robot: RobotSnapshot | null;
  readonly connection: Connection;
  readonly alarms: readonly Alarm[];
  readonly place: Place;
}

/** Banner, connection, alarms, and the ways to other places. */
export default function Head({ me, robot, connection, alarms, place }: Props) {
  const { t } = useTranslation();
  const here = place.name === "case" ? "cases" : place.name;
  return (
    <header className="head">
      <Banner me={me} robot={robot} />
      <div className="head-row">
        <nav aria-label={t("nav.title")}>
          {PLACES.map((name) => (
            <a
              key={name}
              href={`#/${name === "room" ? "" : name}`}
              aria-current={here === name ? "page" : undefined}
            >
              {t(`nav.${name}`)}
            </a>
          ))}
        </nav>
        <p className={`connection ${connection}`} role="status">
          {t(`state.${connection}`)}
        </p>
        <UserMenu me={me} />
        <AlarmSound alarms={alarms} />
      </div>
      <Alarms alarms={alarms} />
    </header>
  );
}
