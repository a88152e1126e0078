import { memo } from "react";
import { ellipsePath, linePath, residualColour } from "./ellipse";
import type { Drawing, DrawnBall, DrawnHole, ImageDrawing } from "./results";
import type { Matrix } from "./view";

interface Props {
  readonly drawing: ImageDrawing;
  readonly view: "raw" | "corrected";
  readonly matrix: Matrix;
}

/** What was found, as vectors over the picture. Lines stay thin however near one looks. */
export default function Overlay({ drawing, view, matrix }: Props) {
  // The drawing's pixels are those of the un-mirrored image, with pixel (0, 0) about the origin.
  const toPicture = drawing.mirrored
    ? `matrix(-1 0 0 1 ${drawing.width_px - 0.5} 0.5)`
    : "translate(0.5 0.5)";
  return (
    <svg className="overlay" aria-hidden="true" data-image={drawing.image_sha256}>
      <g transform={`matrix(${matrix.join(" ")})`}>
        <g transform={toPicture}>
          <Vectors drawing={drawing[view]} />
        </g>
      </g>
    </svg>
  );
}

const Vectors = memo(function Vectors({ drawing }: { readonly drawing: Drawing }) {
  return (
    <>
      <Balls balls={drawing.ring_balls} kind="ring" />
      <Balls balls={drawing.guide_balls} kind="guide" />
      {drawing.nail_edges_px.map((edge, i) => (
        // biome-ignore lint/suspicious/noArrayIndexKey: a nail has two sides, always in this order
        <path key={i} className="nail" d={linePath(edge)} />
      ))}
      {drawing.drill_paths.map((path) => (
        <g key={path.id} className="drill">
          <path className="axis" d={linePath(path.axis_px)} />
          {[...path.edges_px, ...path.rims_px].map((line, i) => (
            // biome-ignore lint/suspicious/noArrayIndexKey: always in this order
            <path key={i} d={linePath(line)} />
          ))}
        </g>
      ))}
      {drawing.holes.map((hole) => (
        <Hole key={hole.id} hole={hole} />
      ))}
      {drawing.mounting_screws.map((screw) => (
        <g key={screw.id} className={screw.shown ? "screw" : "screw not-shown"}>
          <path d={linePath(screw.axis_px)} />
          {screw.axis_px.map(([x, y]) => (
            <circle key={`${x} ${y}`} cx={x} cy={y} r={screw.radius_px} />
          ))}
        </g>
      ))}
    </>
  );
});

function Balls({ balls, kind }: { readonly balls: readonly DrawnBall[]; readonly kind: "ring" | "guide" }) {
  return balls.map((ball) => (
    <circle
      key={`${kind} ${ball.id}`}
      className={ball.used ? `ball ${kind}` : `ball ${kind} unused`}
      cx={ball.centre_px[0]}
      cy={ball.centre_px[1]}
      r={ball.radius_px + 1.5}
      stroke={ball.residual_px === null ? undefined : residualColour(ball.residual_px)}
    />
  ));
}

function Hole({ hole }: { readonly hole: DrawnHole }) {
  return (
    <g className={hole.localised ? "hole" : "hole other"}>
      {hole.rims_px.map((rim, i) => (
        // biome-ignore lint/suspicious/noArrayIndexKey: entry, then exit
        <path key={i} className="rim" d={linePath(rim)} />
      ))}
      {hole.localised && <path className="axis" d={linePath(hole.axis_px)} />}
      {hole.entry_95 && <path className="ellipse entry" d={ellipsePath(hole.entry_95)} />}
      {hole.exit_95 && <path className="ellipse exit" d={ellipsePath(hole.exit_95)} />}
    </g>
  );
}
