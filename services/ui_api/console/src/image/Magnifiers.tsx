import { useRef } from "react";
import { useTranslation } from "react-i18next";
import type { LocalisationView } from "../api/types";
import { extentAbout } from "./ellipse";
import type { Grey } from "./grey";
import Overlay from "./Overlay";
import PictureCanvas from "./PictureCanvas";
import type { Pixels } from "./pixels";
import type { DrawnHole, ImageDrawing } from "./results";
import { usePlaceSize } from "./usePlaceSize";
import { fitScale, matrixOf, type View } from "./view";

interface Props {
  readonly pixels: Pixels;
  readonly grey: Grey;
  readonly view: View;
  readonly drawing: ImageDrawing;
  readonly localisation: LocalisationView;
}

/** Each localised hole by itself, turned as the whole picture is. */
export default function Magnifiers(props: Props) {
  const holes = props.drawing[props.pixels.view].holes.filter((hole) => hole.localised);
  return (
    <ul className="magnifiers">
      {holes.map((hole) => (
        <li key={hole.id}>
          <Magnifier {...props} hole={hole} />
        </li>
      ))}
    </ul>
  );
}

// The hole fills about half of its magnifier.
const HOLE_SHARE = 0.5;

function Magnifier({
  pixels,
  grey,
  view,
  drawing,
  localisation,
  hole,
}: Props & { readonly hole: DrawnHole }) {
  const { t } = useTranslation();
  const place = useRef<HTMLDivElement>(null);
  const size = usePlaceSize(place);
  const x = drawing.mirrored ? drawing.width_px - 0.5 - hole.centre_px[0] : hole.centre_px[0] + 0.5;
  const near: View = { ...view, centre: [x, hole.centre_px[1] + 0.5], zoom: 1 };
  const wanted =
    (HOLE_SHARE * Math.min(size.width, size.height)) / (2 * extentAbout(hole.centre_px, hole.rims_px));
  const matrix = matrixOf({ ...near, zoom: wanted / fitScale(near, pixels, size) }, pixels, size);
  const found = localisation.holes?.find((one) => one.id === hole.id);
  const sigma = found?.standard_uncertainty;
  return (
    <figure className="magnifier">
      <div ref={place} className="stage">
        <PictureCanvas pixels={pixels} grey={grey} matrix={matrix} />
        <Overlay drawing={drawing} view={pixels.view} matrix={matrix} />
      </div>
      <figcaption>
        <strong>{t(`image.hole.${hole.id}`, hole.id)}</strong>
        {found && <span>{t("image.hole.tilt", { deg: found.tilt_to_ray_deg.toFixed(1) })}</span>}
        {sigma && (
          <span>
            ±&nbsp;{sigma.entry_mm.toFixed(2)}&nbsp;mm, ±&nbsp;{sigma.axis_deg.toFixed(2)}°
          </span>
        )}
      </figcaption>
    </figure>
  );
}
