export interface Bar {
  readonly label: string;
  readonly value: number;
  readonly uncertainty: number;
  readonly isGood: boolean;
}

interface Props {
  readonly title: string;
  readonly unit: string;
  readonly bars: readonly Bar[];
}

const [WIDTH, HEIGHT, SPACE] = [64, 120, 24] as const;
const LEAST_REACH = 1;

/** A chart of bars with their uncertainty; its figures are a table, too, for those who do not see it. */
export default function Bars({ title, unit, bars }: Props) {
  const reach = Math.max(LEAST_REACH, ...bars.map((bar) => bar.value + bar.uncertainty));
  const scaled = (value: number) => (value / reach) * HEIGHT;
  return (
    <figure className="bars">
      <figcaption>
        {title} ({unit})
      </figcaption>
      <svg
        viewBox={`0 0 ${bars.length * WIDTH} ${HEIGHT + 2 * SPACE}`}
        width={bars.length * WIDTH}
        height={HEIGHT + 2 * SPACE}
        aria-hidden="true"
      >
        {bars.map((bar, index) => (
          <g key={bar.label} transform={`translate(${index * WIDTH} ${SPACE})`}>
            <rect
              x={WIDTH / 4}
              y={HEIGHT - scaled(bar.value)}
              width={WIDTH / 2}
              height={scaled(bar.value)}
              className={bar.isGood ? "bar good" : "bar attention"}
            />
            <line
              x1={WIDTH / 2}
              x2={WIDTH / 2}
              y1={HEIGHT - scaled(bar.value + bar.uncertainty)}
              y2={HEIGHT - scaled(Math.max(0, bar.value - bar.uncertainty))}
              className="bar-uncertainty"
            />
            <text x={WIDTH / 2} y={HEIGHT - scaled(bar.value + bar.uncertainty) - 4} textAnchor="middle">
              {bar.value.toFixed(2)}
            </text>
            <text x={WIDTH / 2} y={HEIGHT + SPACE * 0.7} textAnchor="middle">
              {bar.label}
            </text>
          </g>
        ))}
      </svg>
      <table className="unseen">
        <caption>{title}</caption>
        <tbody>
          {bars.map((bar) => (
            <tr key={bar.label}>
              <th scope="row">{bar.label}</th>
              <td>
                {bar.value.toFixed(2)} ± {bar.uncertainty.toFixed(2)} {unit}
              </td>
            </tr>
          ))}
        </tbody>
      </table>
    </figure>
  );
}
