import { useState } from "react";
import { useTranslation } from "react-i18next";
import { act, useAct } from "../api/actions";
import { useImages } from "../api/queries";
import type { ReadCase } from "../api/types";
import Thumbnail, { pictureAddress } from "../image/Thumbnail";
import ProblemNote from "../state/ProblemNote";

const SHOWN = 4;
const MOST = 2;
const THUMBNAIL_PX = 160;

/** Choose one image or two, and whether wires or the guide alone are compared with the nail. */
export default function VerifyForm({ read }: { readonly read: ReadCase }) {
  const { t } = useTranslation();
  const known = useImages(read.view.id, SHOWN);
  const images = known.data ?? [];
  const [chosen, setChosen] = useState<readonly string[] | null>(null);
  const wanted = (chosen ?? images.slice(0, 1).map((image) => image.id)).filter((id) =>
    images.some((i) => i.id === id),
  );
  const doing = useAct((of: "wires" | "guide") => act.verify(read, { images: [...wanted], of }));
  // While the list is read anew, the newest image may not be in it yet: it must not be mistaken for one before.
  const isBeingLocalised = images.some(
    (image) => wanted.includes(image.id) && image.localisation === null && image.skipped === null,
  );
  const isBlocked = known.isFetching || isBeingLocalised || wanted.length === 0;
  const hasWires = read.view.procedure.wired_hole_ids.length > 0;
  function toggle(id: string) {
    setChosen(wanted.includes(id) ? wanted.filter((other) => other !== id) : [...wanted, id].slice(-MOST));
  }
  return (
    <div>
      <p className="hint">{t("verify.choose")}</p>
      <div className="thumbnails">
        {images.map((image) => (
          <button
            key={image.id}
            type="button"
            aria-pressed={wanted.includes(image.id)}
            aria-label={t("verify.image", { number: image.header?.sequence ?? "" })}
            onClick={() => toggle(image.id)}
          >
            <Thumbnail address={pictureAddress(image.id)} width_px={THUMBNAIL_PX} alt="" />
          </button>
        ))}
      </div>
      <div className="row">
        <button
          type="button"
          className={hasWires ? "primary" : ""}
          disabled={doing.isPending || isBlocked}
          onClick={() => doing.mutate("wires")}
        >
          {t("verify.wires")}
        </button>
        <button
          type="button"
          className={hasWires ? "" : "primary"}
          disabled={doing.isPending || isBlocked}
          onClick={() => doing.mutate("guide")}
        >
          {t("verify.guide")}
        </button>
      </div>
      {isBeingLocalised && <p role="status">{t("verify.localising")}</p>}
      {doing.isPending && <p role="status">{t("verify.running")}</p>}
      <ProblemNote error={doing.error} />
    </div>
  );
}
