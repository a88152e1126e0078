import { type FormEvent, useId, useState } from "react";
import { useTranslation } from "react-i18next";
import { act, useAct } from "../api/actions";
import { useParts } from "../api/queries";
import type { CaseBody, CatalogueView, ReadCase } from "../api/types";
import ProblemNote from "../state/ProblemNote";

type Kind = CatalogueView["kind"];
type Part = CaseBody["nail"];

export interface SetUp {
  readonly side: CaseBody["side"] | "";
  readonly bone: CaseBody["bone"];
  readonly mount: CaseBody["mount"];
  readonly nail: Part;
  readonly guide: Part;
  readonly ring: Part;
  readonly hexapod: Part;
  readonly head_extension_mm: number | "";
  readonly drill_diameter_mm: number;
}

const PARTS: readonly Kind[] = ["nail", "guide", "ring", "hexapod"];
const USUAL_DRILL_MM = 4;

/** Change the set-up of the open case. */
export default function SetUpForm({ read }: { readonly read: ReadCase }) {
  const { t } = useTranslation();
  const { view } = read;
  const doing = useAct((body: CaseBody) => act.changeSetUp(read, { ...body, why: "" }));
  const known: SetUp = {
    side: view.side as SetUp["side"],
    bone: view.bone as SetUp["bone"],
    mount: view.mount as SetUp["mount"],
    nail: view.nail.name,
    guide: view.guide.name,
    ring: view.ring.name,
    hexapod: view.hexapod.name,
    head_extension_mm: view.head_extension_mm,
    drill_diameter_mm: view.drill_diameter_mm,
  };
  return (
    <>
      <SetUpFields
        key={view.revision}
        known={known}
        button={t("case.change")}
        isBusy={doing.isPending}
        onSend={doing.mutate}
      />
      <ProblemNote error={doing.error} />
    </>
  );
}

/** Open a case. In a simulation the virtual room says what a surgeon would enter. */
export function OpenCaseForm({ proposed }: { readonly proposed: CaseBody | null }) {
  const { t } = useTranslation();
  const doing = useAct((body: CaseBody) => act.openCase({ ...proposed, ...body }));
  const known: SetUp = {
    side: proposed?.side ?? "",
    bone: proposed?.bone ?? "femur",
    mount: proposed?.mount ?? "bone",
    nail: proposed?.nail ?? "",
    guide: proposed?.guide ?? "",
    ring: proposed?.ring ?? "",
    hexapod: proposed?.hexapod ?? "",
    head_extension_mm: proposed?.head_extension_mm ?? "",
    drill_diameter_mm: proposed?.drill_diameter_mm ?? USUAL_DRILL_MM,
  };
  return (
    <section className="open-case">
      <h2>{t("case.open")}</h2>
      {proposed && <p className="hint">{t("case.proposed")}</p>}
      <SetUpFields
        key={proposed === null ? "empty" : "proposed"}
        known={known}
        button={t("case.open")}
        isBusy={doing.isPending}
        onSend={doing.mutate}
      />
      <ProblemNote error={doing.error} />
    </section>
  );
}

interface FieldsProps {
  readonly known: SetUp;
  readonly button: string;
  readonly isBusy: boolean;
  readonly onSend: (body: CaseBody) => void;
}

function SetUpFields({ known, button, isBusy, onSend }: FieldsProps) {
  const [value, setValue] = useState(known);
  const set = (change: Partial<SetUp>) => setValue({ ...value, ...change });
  function send(event: FormEvent) {
    event.preventDefault();
    if (value.side === "" || value.head_extension_mm === "") return;
    onSend({ ...value, side: value.side, head_extension_mm: value.head_extension_mm });
  }
  return (
    <form className="set-up" onSubmit={send}>
      <Choice
        name="side"
        options={["left", "right"]}
        value={value.side}
        onChange={(side) => set({ side: side as "left" })}
      />
      <Choice
        name="bone"
        options={["femur", "tibia"]}
        value={value.bone}
        onChange={(bone) => set({ bone: bone as "femur", nail: withoutCatalogued(value.nail) })}
      />
      <Choice
        name="mount"
        options={["bone", "nail_head"]}
        value={value.mount}
        onChange={(mount) => set({ mount: mount as "bone" })}
      />
      {PARTS.map((kind) => (
        <PartChoice
          key={kind}
          kind={kind}
          bone={value.bone}
          value={value[kind as "nail"]}
          onChange={(part) => set({ [kind]: part })}
        />
      ))}
      <Measure
        name="head_extension_mm"
        value={value.head_extension_mm}
        onChange={(head_extension_mm) => set({ head_extension_mm })}
      />
      <Measure
        name="drill_diameter_mm"
        value={value.drill_diameter_mm}
        onChange={(mm) => set({ drill_diameter_mm: mm === "" ? USUAL_DRILL_MM : mm })}
      />
      <button type="submit" className="primary wide" disabled={isBusy}>
        {button}
      </button>
    </form>
  );
}

/** With another bone, another nail: what was chosen from the catalogue is chosen anew. */
function withoutCatalogued(nail: Part): Part {
  return typeof nail === "string" ? "" : nail;
}

interface ChoiceProps {
  readonly name: "side" | "bone" | "mount";
  readonly options: readonly string[];
  readonly value: string;
  readonly onChange: (value: string) => void;
}

function Choice({ name, options, value, onChange }: ChoiceProps) {
  const { t } = useTranslation();
  const id = useId();
  return (
    <fieldset className="choices">
      <legend>{t(`case.${name}.title`)}</legend>
      {options.map((option) => (
        <label key={option} className="choice">
          <input
            type="radio"
            name={`${id}-${name}`}
            value={option}
            checked={value === option}
            required
            onChange={() => onChange(option)}
          />
          {t(`case.${name}.${option}`)}
        </label>
      ))}
    </fieldset>
  );
}

interface PartProps {
  readonly kind: Kind;
  readonly bone: SetUp["bone"];
  readonly value: Part;
  readonly onChange: (value: string) => void;
}

function PartChoice({ kind, bone, value, onChange }: PartProps) {
  const { t } = useTranslation();
  const ofKind = (useParts().data ?? []).filter((part) => part.kind === kind);
  const parts = ofKind.filter((part) => part.bone === null || part.bone === bone);
  // A part of the scenario's own is sent as it is.
  const isOwn = typeof value !== "string";
  return (
    <label>
      {t(`case.${kind}`)}
      <select value={isOwn ? "own" : value} required onChange={(event) => onChange(event.target.value)}>
        <option value="" disabled>
          {t("case.choose")}
        </option>
        {isOwn && <option value="own">{t("case.own_part")}</option>}
        {parts.map((part) => (
          <option key={part.name} value={part.name}>
            {part.name}
          </option>
        ))}
      </select>
    </label>
  );
}

interface MeasureProps {
  readonly name: "head_extension_mm" | "drill_diameter_mm";
  readonly value: number | "";
  readonly onChange: (value: number | "") => void;
}

function Measure({ name, value, onChange }: MeasureProps) {
  const { t } = useTranslation();
  return (
    <label>
      {t(`case.${name}`)}
      <input
        type="number"
        inputMode="decimal"
        step="any"
        required
        value={value}
        onChange={(event) => onChange(event.target.value === "" ? "" : Number(event.target.value))}
      />
    </label>
  );
}
