import { useTranslation } from "react-i18next";
import type { CaseView } from "../api/types";
import PhaseLine from "../procedure/PhaseLine";

/** Side and bone, and how far the procedure is. */
export default function CaseLine({ view }: { readonly view: CaseView }) {
  const { t } = useTranslation();
  return (
    <div className="case-line">
      <p className="side">
        {t(`case.side.${view.side}`)} {t(`case.bone.${view.bone}`)}
      </p>
      <PhaseLine procedure={view.procedure} />
    </div>
  );
}
