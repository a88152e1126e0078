import { useQueryClient } from "@tanstack/react-query";
import { type FormEvent, useState } from "react";
import { useTranslation } from "react-i18next";
import { act } from "../api/actions";
import { ApiError } from "../api/client";
import { useProvider } from "../api/queries";
import LanguageChoice from "../languages/LanguageChoice";

/** Name and password; the session is kept in cookies that no script reads. */
export default function Login({ isAgain = false }: { readonly isAgain?: boolean }) {
  const { t } = useTranslation();
  const client = useQueryClient();
  const provider = useProvider().data ?? null;
  const [error, setError] = useState<ApiError | null>(null);
  const [isBusy, setBusy] = useState(false);
  async function submit(event: FormEvent<HTMLFormElement>) {
    event.preventDefault();
    const form = new FormData(event.currentTarget);
    setBusy(true);
    try {
      await act.signIn(String(form.get("name")), String(form.get("password")));
      setError(null);
      await client.invalidateQueries();
    } catch (problem) {
      setError(problem instanceof ApiError ? problem : new ApiError(0, "no_answer", String(problem)));
    } finally {
      setBusy(false);
    }
  }
  return (
    <main>
      <form className="login" onSubmit={(event) => void submit(event)}>
        <h1>{t("access.sign_in")}</h1>
        {isAgain && <p className="hint">{t("access.session_ended")}</p>}
        <label>
          {t("access.name")}
          <input name="name" autoComplete="off" autoCapitalize="none" spellCheck={false} required />
        </label>
        <label>
          {t("access.password")}
          <input name="password" type="password" autoComplete="off" required />
        </label>
        {error && (
          <p className="problem" role="alert">
            {error.status === 0 ? t("state.no_answer") : error.detail}
          </p>
        )}
        {provider && (
          <a className="button" href="/api/v1/sessions/provider">
            {t("access.with_provider", { provider })}
          </a>
        )}
        <LanguageChoice />
        <button type="submit" className="primary" disabled={isBusy}>
          {t("access.sign_in")}
        </button>
      </form>
    </main>
  );
}
