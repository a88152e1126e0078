import { useRef } from "react";
import { useTranslation } from "react-i18next";
import { type Advice, dotPlace, FULL_DEG, steadied } from "./advice";
import { ageText } from "./ages";

interface Props {
  readonly advice: Advice | null;
  readonly ageS: number | null;
  readonly isLive: boolean;
}

const RINGS_DEG: readonly number[] = [1, 5, 14];

/** The tilt as a dot on a target, and in the technician's words; to be read from three metres. */
export default function Bullseye({ advice, ageS, isLive }: Props) {
  const { t } = useTranslation();
  if (advice === null) return <p className="empty">{t("image.aim.none")}</p>;
  const isShown = advice.isCurrent && isLive;
  return (
    <section className={`aim ${isShown ? (advice.quality ?? "unknown") : "not-current"}`}>
      <Target advice={advice} />
      {/* biome-ignore lint/a11y/noNoninteractiveTabindex: what does not fit is scrolled to, with keys too */}
      <section className="aim-words" aria-label={t("image.aim.title")} tabIndex={0}>
        <Quality advice={advice} />
        <Turns advice={advice} />
        <Shifts advice={advice} />
        {advice.reasons.length > 0 && <p className="aim-reasons">{advice.reasons.join("; ")}</p>}
        <p className="aim-age">
          {ageS !== null && t("image.state.age", { age: ageText(ageS) })}
          {!isLive && ` ${t("image.state.not_live")}`}
          {advice.staleBecause && ` ${t("image.state.stale")} ${advice.staleBecause}`}
        </p>
      </section>
    </section>
  );
}

function Target({ advice }: { readonly advice: Advice }) {
  const { turn, sigma } = advice;
  // The dot is where the detector stands, seen as in the picture: it goes with the detector, and belongs in the middle.
  const [x, y] = turn === null ? [0, 0] : dotOf(-turn.y, turn.x);
  return (
    <svg className="target" viewBox="-1.12 -1.12 2.24 2.24" aria-hidden="true">
      {RINGS_DEG.map((deg) => (
        <g key={deg}>
          <circle className={`ring ring-${deg}`} r={dotPlace(deg)} />
          <text x={dotPlace(deg) * 0.71 + 0.01} y={-dotPlace(deg) * 0.71}>
            {deg}°
          </text>
        </g>
      ))}
      <circle className="edge" r={dotPlace(FULL_DEG)} />
      <path className="cross" d="M -1 0 H 1 M 0 -1 V 1" />
      {turn && (
        <g className="dot">
          <line x1={x} y1={y} x2={0} y2={0} />
          {sigma && <circle className="sigma" cx={x} cy={y} r={0.07 + 0.1 * Math.max(sigma.x, sigma.y)} />}
          <circle cx={x} cy={y} r={0.07} />
        </g>
      )}
    </svg>
  );
}

/** A dot in the direction of a tilt, as far out as it is large. */
function dotOf(right: number, down: number): readonly [number, number] {
  const size = Math.hypot(right, down);
  const share = size === 0 ? 0 : dotPlace(size) / size;
  return [right * share, down * share];
}

function Quality({ advice }: { readonly advice: Advice }) {
  const { t } = useTranslation();
  const largest = useSteadied(advice.holes.length > 0 ? Math.max(...advice.holes.map((h) => h.deg)) : null);
  if (advice.turn === null || advice.quality === null || largest === null)
    return <p className="aim-quality">{t("image.aim.unknown")}</p>;
  return (
    <>
      <p className="aim-tilt">{largest.toFixed(1)}°</p>
      <p className="aim-quality">{t(`image.aim.${advice.quality}`)}</p>
      <p className="aim-gain">{t("image.aim.saved", { share: Math.round(100 * advice.savedByADegree) })}</p>
    </>
  );
}

function Turns({ advice }: { readonly advice: Advice }) {
  const { t } = useTranslation();
  const orbital = useSteadied(advice.orbital?.by ?? null);
  const angular = useSteadied(advice.angular?.by ?? null);
  if (advice.turn === null) return null;
  if (orbital === null || angular === null || !advice.orbital || !advice.angular)
    return <PictureTurns turn={advice.turn} />;
  return (
    <dl className="aim-turns">
      <Step
        name={t("image.aim.orbital")}
        value={orbital}
        isSigned
        then={t("image.aim.then", { deg: advice.orbital.to.toFixed(0) })}
      />
      <Step
        name={t("image.aim.angular")}
        value={angular}
        isSigned
        then={t("image.aim.then", { deg: advice.angular.to.toFixed(0) })}
      />
    </dl>
  );
}

/** As long as nobody knows how the picture is turned against the C-arm: by the picture's own edges. */
function PictureTurns({ turn }: { readonly turn: NonNullable<Advice["turn"]> }) {
  const { t } = useTranslation();
  const x = useSteadied(turn.x) ?? 0;
  const y = useSteadied(turn.y) ?? 0;
  return (
    <>
      <dl className="aim-turns">
        <Step name={t(x < 0 ? "image.aim.to_bottom" : "image.aim.to_top")} value={Math.abs(x)} />
        <Step name={t(y < 0 ? "image.aim.to_left" : "image.aim.to_right")} value={Math.abs(y)} />
      </dl>
      <p className="aim-hint">{t("image.aim.turn_two_degrees")}</p>
    </>
  );
}

/** Nobody moves a C-arm by less. */
const SHIFT_STEP_MM = 5;

function Shifts({ advice }: { readonly advice: Advice }) {
  const { t } = useTranslation();
  const { shift, offCentre } = advice;
  const steps =
    shift !== null
      ? ([
          ["head", "feet", shift.head],
          ["push_right", "push_left", shift.right],
          ["raise", "lower", shift.up],
        ] as const)
      : offCentre !== null
        ? ([
            ["picture_right", "picture_left", offCentre.right],
            ["picture_down", "picture_up", offCentre.down],
          ] as const)
        : [];
  const needed = steps.filter(([, , mm]) => Math.abs(mm) >= SHIFT_STEP_MM);
  return (
    <ul className="aim-shifts">
      {needed.map(([more, less, mm]) => (
        <li key={more}>
          {t(`image.aim.${mm > 0 ? more : less}`)} <strong>{roundedMm(mm)} mm</strong>
        </li>
      ))}
    </ul>
  );
}

function roundedMm(mm: number): number {
  return Math.round(Math.abs(mm) / SHIFT_STEP_MM) * SHIFT_STEP_MM;
}

interface StepProps {
  readonly name: string;
  readonly value: number | null;
  readonly isSigned?: boolean;
  readonly then?: string;
}

function Step({ name, value, isSigned = false, then }: StepProps) {
  if (value === null) return null;
  return (
    <div>
      <dt>{name}</dt>
      <dd>
        <strong>
          {isSigned && signOf(value)}
          {Math.abs(value).toFixed(1)}°
        </strong>
        {then && <small>{then}</small>}
      </dd>
    </div>
  );
}

function signOf(value: number): string {
  if (value === 0) return "";
  return value > 0 ? "+" : "−";
}

function useSteadied(value: number | null): number | null {
  const shown = useRef<number | null>(null);
  shown.current = value === null ? null : steadied(value, shown.current);
  return shown.current;
}
