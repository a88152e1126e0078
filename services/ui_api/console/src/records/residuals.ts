// Figures of a chart of residuals: pure.

interface Ball {
  readonly residual_px: number | null;
  readonly used: boolean;
}

// Beyond one pixel nothing fits; such balls stand at the chart's upper edge.
const REACH_PX = 1;

/** Where a residual stands between the lower edge (0) and the upper (1): small ones are spread out. */
export function placeOf(residualPx: number): number {
  return Math.sqrt(Math.min(Math.max(residualPx, 0), REACH_PX) / REACH_PX);
}

/** Of the balls that the fit used. */
export function rmsPx(balls: readonly Ball[]): number {
  const used = known(balls);
  return used.length === 0 ? 0 : Math.sqrt(used.reduce((sum, px) => sum + px * px, 0) / used.length);
}

export function largestPx(balls: readonly Ball[]): number {
  return Math.max(0, ...known(balls));
}

function known(balls: readonly Ball[]): readonly number[] {
  return balls.flatMap((ball) => (ball.used && ball.residual_px !== null ? [ball.residual_px] : []));
}
