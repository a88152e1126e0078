import { useTranslation } from "react-i18next";

interface Props {
  readonly holeIds: readonly string[];
  readonly chosen: readonly string[];
  readonly onChange: (chosen: string[]) => void;
  /** While the act is under way: what shows is what was sent. */
  readonly isSent: boolean;
}

/** Which holes an act concerns. */
export default function Holes({ holeIds, chosen, onChange, isSent }: Props) {
  const { t } = useTranslation();
  return (
    <fieldset className="choices" disabled={isSent}>
      <legend>{t("procedure.holes")}</legend>
      {holeIds.map((hole) => (
        <label key={hole} className="choice">
          <input
            type="checkbox"
            checked={chosen.includes(hole)}
            onChange={(event) =>
              onChange(event.target.checked ? [...chosen, hole] : chosen.filter((other) => other !== hole))
            }
          />
          {hole}
        </label>
      ))}
    </fieldset>
  );
}
