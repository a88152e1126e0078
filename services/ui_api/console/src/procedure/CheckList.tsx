import { useState } from "react";
import { useTranslation } from "react-i18next";

/** A list that the team reads aloud; the page keeps what was ticked only as long as it shows this case. */
export default function CheckList({ name }: { readonly name: "set_up" | "before_drilling" }) {
  const { t } = useTranslation();
  const items = t(`check.${name}.items`, { returnObjects: true }) as unknown as readonly string[];
  const [ticked, setTicked] = useState<ReadonlySet<number>>(new Set());
  const left = items.length - ticked.size;
  function toggle(index: number) {
    const next = new Set(ticked);
    if (!next.delete(index)) next.add(index);
    setTicked(next);
  }
  return (
    <details className="check-list" open={left > 0 && ticked.size > 0}>
      <summary>
        {t(`check.${name}.title`)} {left === 0 ? "✓" : `(${t("check.left", { count: left })})`}
      </summary>
      {items.map((item, index) => (
        <label key={item} className="choice">
          <input type="checkbox" checked={ticked.has(index)} onChange={() => toggle(index)} />
          {item}
        </label>
      ))}
    </details>
  );
}
