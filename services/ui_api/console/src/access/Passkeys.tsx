import { useMutation, useQueryClient } from "@tanstack/react-query";
import type { FormEvent } from "react";
import { useTranslation } from "react-i18next";
import { act } from "../api/actions";
import { usePasskeys } from "../api/queries";
import { useWhen } from "../languages/useWhen";
import ProblemNote from "../state/ProblemNote";
import { hasPasskeys, madePasskey } from "./webauthn";

/** The own passkeys: phones and keys with which an approval needs no password. */
export default function Passkeys() {
  const { t } = useTranslation();
  const when = useWhen();
  const passkeys = usePasskeys(true).data ?? [];
  const client = useQueryClient();
  const removing = useMutation<unknown, Error, string>({
    mutationFn: act.removePasskey,
    onSettled: () => void client.invalidateQueries({ queryKey: ["passkeys"] }),
  });
  return (
    <section className="passkeys" aria-label={t("passkey.title")}>
      <h2>{t("passkey.title")}</h2>
      <p className="hint">{t("passkey.what")}</p>
      <ul>
        {passkeys.map((one) => (
          <li key={one.id} className="row">
            <strong>{one.label}</strong> <span className="quiet">{when(one.created_at_ns)}</span>
            <button type="button" disabled={removing.isPending} onClick={() => removing.mutate(one.id)}>
              {t("passkey.remove", { label: one.label })}
            </button>
          </li>
        ))}
      </ul>
      <ProblemNote error={removing.error} />
      {hasPasskeys() ? <NewPasskey /> : <p className="refusal">{t("passkey.not_here")}</p>}
    </section>
  );
}

function NewPasskey() {
  const { t } = useTranslation();
  const client = useQueryClient();
  const making = useMutation<unknown, Error, { label: string; password: string }>({
    mutationFn: async ({ label, password }) => {
      const options = await act.passkeyOptions();
      const credential = await madePasskey(options.public_key);
      return await act.addPasskey({ label, credential, ...(password !== "" && { password }) });
    },
    onSettled: () => void client.invalidateQueries({ queryKey: ["passkeys"] }),
  });
  function make(event: FormEvent<HTMLFormElement>) {
    event.preventDefault();
    const form = event.currentTarget;
    const fields = new FormData(form);
    making.mutate(
      { label: String(fields.get("label")), password: String(fields.get("passkey-password")) },
      { onSuccess: () => form.reset() },
    );
  }
  return (
    <form className="new-passkey" onSubmit={make}>
      <label>
        {t("passkey.label")}
        <input name="label" autoComplete="off" maxLength={64} required />
      </label>
      <label>
        {t("passkey.password")}
        <input name="passkey-password" type="password" autoComplete="off" />
      </label>
      <button type="submit" disabled={making.isPending}>
        {t("passkey.make")}
      </button>
      {making.error instanceof DOMException ? (
        <p className="problem" role="alert">
          {t("passkey.not_made")}
        </p>
      ) : (
        <ProblemNote error={making.error} />
      )}
    </form>
  );
}
