import { useTranslation } from "react-i18next";
import { ApiError } from "../api/client";
import { sentence } from "./sentence";

/** What went wrong with the last act, in the gateway's own sentence. */
export default function ProblemNote({ error }: { readonly error: Error | null | undefined }) {
  const { t } = useTranslation();
  if (!error) return null;
  const isSilent = error instanceof ApiError && error.status === 0;
  const isOutdated = error instanceof ApiError && error.status === 412;
  return (
    <p className="problem" role="alert">
      {isSilent ? t("state.no_answer_to_act") : sentence(error.message)}
      {isOutdated && ` ${t("state.look_again")}`}
    </p>
  );
}
