import { useTranslation } from "react-i18next";
import { useNewestLocalisation } from "../api/queries";
import { residualColour } from "../image/ellipse";
import { type DrawnBall, useDrawing } from "../image/results";
import { largestPx, placeOf, rmsPx } from "./residuals";

const [WIDTH, HEIGHT] = [640, 150] as const;
// Room for the numbers on the left and above, for the last ball, and for the names below.
const [LEFT, RIGHT, ABOVE, BELOW] = [34, 4, 8, 22] as const;
const LINES_PX: readonly number[] = [0, 0.25, 0.5, 1];

/** How far each ball lies from where the fit puts it, in the newest localisation of a case. */
export default function Residuals({ caseId }: { readonly caseId: string }) {
  const { t } = useTranslation();
  const localisation = useNewestLocalisation(caseId).data ?? null;
  const drawing = useDrawing(caseId, localisation)?.raw ?? null;
  if (localisation === null || drawing === null) return null;
  const groups = [
    ["ring", drawing.ring_balls],
    ["guide", drawing.guide_balls],
  ] as const;
  const balls = groups.flatMap(([kind, all]) => all.map((ball) => ({ kind, ball })));
  const x = (index: number) => LEFT + ((index + 0.5) / balls.length) * (WIDTH - LEFT - RIGHT);
  const y = (px: number) => (1 - placeOf(px)) * HEIGHT;
  return (
    <figure className="residuals">
      <figcaption>{t("records.residuals", { number: localisation.number })}</figcaption>
      <svg viewBox={`0 ${-ABOVE} ${WIDTH} ${ABOVE + HEIGHT + BELOW}`} aria-hidden="true">
        {LINES_PX.map((px) => (
          <g key={px}>
            <line className="residual-line" x1={LEFT} x2={WIDTH} y1={y(px)} y2={y(px)} />
            <text x={LEFT - 4} y={y(px) + 4} textAnchor="end">
              {px}
            </text>
          </g>
        ))}
        {balls.map(({ kind, ball }, index) => (
          <Ball key={`${kind} ${ball.id}`} ball={ball} x={x(index)} y={y(ball.residual_px ?? 0)} />
        ))}
        {groups.map(([kind, all], index) => (
          <text
            key={kind}
            x={x(index === 0 ? all.length / 2 : balls.length - all.length / 2)}
            y={HEIGHT + BELOW - 5}
            textAnchor="middle"
          >
            {t(`records.balls.${kind}`)}
          </text>
        ))}
      </svg>
      <dl className="facts">
        {groups.map(([kind, all]) => (
          <div key={kind}>
            <dt>{t(`records.balls.${kind}`)}</dt>
            <dd>
              {t("records.residual_line", {
                used: all.filter((ball) => ball.used).length,
                all: all.length,
                rms: rmsPx(all).toFixed(2),
                most: largestPx(all).toFixed(2),
              })}
            </dd>
          </div>
        ))}
      </dl>
    </figure>
  );
}

function Ball({ ball, x, y }: { readonly ball: DrawnBall; readonly x: number; readonly y: number }) {
  if (ball.residual_px === null) return null;
  const colour = residualColour(ball.residual_px);
  // One that the fit left out is hollow.
  return <circle cx={x} cy={y} r={3} fill={ball.used ? colour : "none"} stroke={colour} strokeWidth={1.5} />;
}
