import { useTranslation } from "react-i18next";
import { percent } from "../procedure/Approval";
import { nearness } from "./hexapod";
import type { AxisNumbers, HoleNumbers, LegNumbers } from "./numbers";

interface Props {
  readonly holes: readonly HoleNumbers[];
  readonly travel: { readonly travel_mm: number; readonly travel_deg: number } | null;
  readonly leg: LegNumbers | null;
  readonly plannedLeg: LegNumbers | null;
  readonly isLive: boolean;
}

/** Offset, angle and chance of each hole, now and after the planned move; travel; the leg nearest to a limit. */
export default function Numbers({ holes, travel, leg, plannedLeg, isLive }: Props) {
  const { t } = useTranslation();
  return (
    <div className="scene-numbers">
      {holes.length > 0 && (
        <table>
          <thead>
            <tr>
              <th scope="col">{t("scene.hole")}</th>
              <th scope="col" className="now">
                {t("scene.now")}
              </th>
              <th scope="col" className="planned">
                {t("scene.planned")}
              </th>
            </tr>
          </thead>
          <tbody>
            {holes.map((hole) => (
              <tr key={hole.id}>
                <th scope="row">
                  {hole.id}
                  {hole.tilt_to_ray_deg !== null && (
                    <small>{t("scene.tilt", { deg: hole.tilt_to_ray_deg.toFixed(1) })}</small>
                  )}
                </th>
                <td className={isLive ? "now" : "now stale"}>
                  <Axis numbers={hole.now} />
                </td>
                <td className="planned">
                  <Axis numbers={hole.planned} />
                </td>
              </tr>
            ))}
          </tbody>
        </table>
      )}
      <dl>
        <div>
          <dt>{t("scene.travel")}</dt>
          <dd>
            {travel
              ? t("scene.travel_is", { mm: travel.travel_mm.toFixed(1), deg: travel.travel_deg.toFixed(1) })
              : t("scene.no_plan")}
          </dd>
        </div>
        {leg && <LegRow name={t("scene.leg_now")} leg={leg} />}
        {plannedLeg && <LegRow name={t("scene.leg_planned")} leg={plannedLeg} />}
      </dl>
      <p className="scene-note">{t("scene.bounds")}</p>
    </div>
  );
}

function Axis({ numbers }: { readonly numbers: AxisNumbers | null }) {
  const { t } = useTranslation();
  if (numbers === null) return <>{t("scene.unknown")}</>;
  const { offset_mm, offset_bound_mm, angle_deg, angle_bound_deg, chance_to_pass } = numbers;
  return (
    <>
      <span className="value">{bounded(offset_mm, offset_bound_mm, 2, " mm")}</span>
      <span className="value">{bounded(angle_deg, angle_bound_deg, 2, "°")}</span>
      {chance_to_pass !== null && (
        <span className="value">{t("scene.chance", { percent: percent(chance_to_pass) })}</span>
      )}
    </>
  );
}

function bounded(value: number, bound: number | null, digits: number, unit: string): string {
  const limit = bound === null ? "" : ` (≤ ${bound.toFixed(digits)})`;
  return `${value.toFixed(digits)}${unit}${limit}`;
}

function LegRow({ name, leg }: { readonly name: string; readonly leg: LegNumbers }) {
  const { t } = useTranslation();
  const near = nearness(leg.used_share);
  return (
    <div>
      <dt>{name}</dt>
      <dd className={`leg ${near}`}>
        {t("scene.leg_used", { leg: leg.id, percent: Math.round(leg.used_share * 100) })} ·{" "}
        {t(`scene.leg_is.${near}`)}
      </dd>
    </div>
  );
}
