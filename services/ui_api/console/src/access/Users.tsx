import { useMutation, useQueryClient } from "@tanstack/react-query";
import { type FormEvent, useState } from "react";
import { useTranslation } from "react-i18next";
import { act } from "../api/actions";
import { useUsers } from "../api/queries";
import type { Me, UserView } from "../api/types";
import ProblemNote from "../state/ProblemNote";
import Passkeys from "./Passkeys";

const ROLES = ["viewer", "technician", "surgeon", "administrator"] as const;
type Role = (typeof ROLES)[number];

/** Accounts for administrators; everybody's own password. */
export default function Users({ me }: { readonly me: Me }) {
  const { t } = useTranslation();
  const isAdministrator = me.actions.includes("administer_users");
  const users = useUsers(isAdministrator);
  return (
    <main className="page-view users">
      <h1>{t("access.users")}</h1>
      <OwnPassword />
      <Passkeys />
      {isAdministrator && (
        <>
          <h2>{t("access.accounts")}</h2>
          <table>
            <thead>
              <tr>
                <th scope="col">{t("access.name")}</th>
                <th scope="col">{t("access.roles")}</th>
                <th scope="col">{t("access.state")}</th>
                <th scope="col">{t("access.change")}</th>
              </tr>
            </thead>
            <tbody>
              {users.data?.map((user) => (
                <UserRow key={user.name} user={user} />
              ))}
            </tbody>
          </table>
          <ProblemNote error={users.error} />
          <NewUser />
        </>
      )}
    </main>
  );
}

function useChange<Input>(run: (input: Input) => Promise<unknown>) {
  const client = useQueryClient();
  return useMutation<unknown, Error, Input>({
    mutationFn: run,
    onSettled: () => void client.invalidateQueries({ queryKey: ["users"] }),
  });
}

function UserRow({ user }: { readonly user: UserView }) {
  const { t } = useTranslation();
  const change = useChange((body: { roles?: Role[]; disabled?: boolean }) => act.changeUser(user.name, body));
  const end = useChange(() => act.endSessions(user.name));
  const roles = user.roles as Role[];
  const toggled = (role: Role) =>
    roles.includes(role) ? roles.filter((one) => one !== role) : [...roles, role];
  return (
    <tr>
      <th scope="row">{user.name}</th>
      <td>
        {ROLES.map((role) => (
          <label key={role} className="choice">
            <input
              type="checkbox"
              checked={roles.includes(role)}
              disabled={change.isPending}
              onChange={() => change.mutate({ roles: toggled(role) })}
            />
            {t(`role.${role}`)}
          </label>
        ))}
      </td>
      <td>{t(user.disabled ? "access.disabled" : "access.enabled")}</td>
      <td>
        <div className="row">
          <button type="button" onClick={() => change.mutate({ disabled: !user.disabled })}>
            {t(user.disabled ? "access.enable" : "access.disable")}
          </button>
          <button type="button" onClick={() => end.mutate(undefined)}>
            {t("access.end_sessions")}
          </button>
        </div>
        <ProblemNote error={change.error ?? end.error} />
      </td>
    </tr>
  );
}

function NewUser() {
  const { t } = useTranslation();
  const [roles, setRoles] = useState<Role[]>(["technician"]);
  const adding = useChange((body: { name: string; password: string; roles: Role[] }) => act.addUser(body));
  function add(event: FormEvent<HTMLFormElement>) {
    event.preventDefault();
    const form = event.currentTarget;
    const fields = new FormData(form);
    adding.mutate(
      { name: String(fields.get("name")), password: String(fields.get("password")), roles },
      { onSuccess: () => form.reset() },
    );
  }
  return (
    <form className="new-user" onSubmit={add}>
      <h2>{t("access.new_account")}</h2>
      <label>
        {t("access.name")}
        <input name="name" autoComplete="off" required />
      </label>
      <label>
        {t("access.password")}
        <input name="password" type="password" autoComplete="new-password" required />
      </label>
      <fieldset className="choices">
        <legend>{t("access.roles")}</legend>
        {ROLES.map((role) => (
          <label key={role} className="choice">
            <input
              type="checkbox"
              checked={roles.includes(role)}
              onChange={() =>
                setRoles(roles.includes(role) ? roles.filter((one) => one !== role) : [...roles, role])
              }
            />
            {t(`role.${role}`)}
          </label>
        ))}
      </fieldset>
      <button type="submit" className="primary" disabled={adding.isPending || roles.length === 0}>
        {t("access.add")}
      </button>
      <ProblemNote error={adding.error} />
    </form>
  );
}

function OwnPassword() {
  const { t } = useTranslation();
  const changing = useMutation<unknown, Error, { old: string; fresh: string }>({
    mutationFn: ({ old, fresh }) => act.changePassword(old, fresh),
  });
  function change(event: FormEvent<HTMLFormElement>) {
    event.preventDefault();
    const form = event.currentTarget;
    const fields = new FormData(form);
    changing.mutate(
      { old: String(fields.get("old")), fresh: String(fields.get("new")) },
      { onSuccess: () => form.reset() },
    );
  }
  return (
    <form className="own-password" onSubmit={change}>
      <h2>{t("access.own_password")}</h2>
      <label>
        {t("access.old_password")}
        <input name="old" type="password" autoComplete="off" required />
      </label>
      <label>
        {t("access.new_password")}
        <input name="new" type="password" autoComplete="new-password" required />
      </label>
      <button type="submit" disabled={changing.isPending}>
        {t("access.change_password")}
      </button>
      {changing.isSuccess && <p role="status">{t("access.password_changed")}</p>}
      <ProblemNote error={changing.error} />
    </form>
  );
}
