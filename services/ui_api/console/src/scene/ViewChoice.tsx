import type { TFunction } from "i18next";
import { useTranslation } from "react-i18next";
import type { ViewId } from "./views";

interface Props {
  readonly holes: readonly string[];
  /** Null while the picture was turned by hand. */
  readonly chosen: ViewId | null;
  readonly choose: (view: ViewId) => void;
}

/** One touch to each view; touched again it goes back after turning by hand. */
export default function ViewChoice({ holes, chosen, choose }: Props) {
  const { t } = useTranslation();
  const views: readonly ViewId[] = ["surgeon", "above", ...holes.map((id) => `along:${id}` as const), "room"];
  return (
    <fieldset className="scene-views" aria-label={t("scene.view.title")}>
      {views.map((id) => (
        <button key={id} type="button" aria-pressed={id === chosen} onClick={() => choose(id)}>
          {viewName(id, t)}
        </button>
      ))}
    </fieldset>
  );
}

export function viewName(id: ViewId, t: TFunction): string {
  switch (id) {
    case "surgeon":
      return t("scene.view.surgeon");
    case "above":
      return t("scene.view.above");
    case "room":
      return t("scene.view.room");
    default:
      return t("scene.view.along", { hole: id.slice("along:".length) });
  }
}
