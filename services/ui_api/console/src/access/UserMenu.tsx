import { useMutation, useQueryClient } from "@tanstack/react-query";
import { useTranslation } from "react-i18next";
import { act } from "../api/actions";
import { ME } from "../api/queries";
import type { Me } from "../api/types";
import LanguageChoice from "../languages/LanguageChoice";

/** Who is signed in, and the way out. */
export default function UserMenu({ me }: { readonly me: Me }) {
  const { t } = useTranslation();
  const client = useQueryClient();
  const leaving = useMutation({
    mutationFn: act.signOut,
    onSettled: async () => {
      // Nothing of the case stays in the page's memory.
      client.clear();
      await client.invalidateQueries({ queryKey: [ME] });
      globalThis.location.reload();
    },
  });
  return (
    <div className="user-menu">
      <span>
        {me.name} <small>({me.roles.map((role) => t(`role.${role}`)).join(", ")})</small>
      </span>
      <LanguageChoice />
      <button type="button" onClick={() => leaving.mutate()}>
        {t("access.sign_out")}
      </button>
    </div>
  );
}
