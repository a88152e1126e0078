// What panels read. Events of the log say when something is out of date (`follow.ts`); only ages are asked for again.
import { keepPreviousData, QueryCache, QueryClient, queryOptions, useQuery } from "@tanstack/react-query";
import { ApiError, answered, content, gateway } from "./client";
import type { CheckView, LocalisationView, ReadCase, RobotSnapshot, TimelineEntry } from "./types";

/** Everything that an event of a case can change stands below this key. */
export const CASE = "case";
/** Who is signed in. */
export const ME = "me";
// Chosen: four states of the robot a second look live, and cost the gateway less than one percent of a core.
export const ROBOT_EVERY_MS = 250;
const ROBOT_WITHIN_MS = 1_000;
const HEALTH_EVERY_MS = 5_000;

export function newQueryClient(): QueryClient {
  const client: QueryClient = new QueryClient({
    queryCache: new QueryCache({ onError: (error, query) => askWhoIsHere(client, error, query.queryKey) }),
    defaultOptions: {
      queries: {
        retry: isWorthRepeating,
        retryDelay: 500,
        staleTime: 5_000,
        refetchOnWindowFocus: true,
        networkMode: "always",
      },
      mutations: { retry: false, networkMode: "always" },
    },
  });
  return client;
}

/** Whatever is first refused for want of a session shows the sign-in, not only what somebody presses. */
function askWhoIsHere(client: QueryClient, error: Error, key: readonly unknown[]): void {
  const isRefused = error instanceof ApiError && error.status === 401 && key[0] !== ME;
  if (isRefused && client.getQueryState([ME])?.status === "success")
    void client.invalidateQueries({ queryKey: [ME] });
}

function isWorthRepeating(failures: number, error: Error): boolean {
  const status = error instanceof ApiError ? error.status : 0;
  return (status === 0 || status >= 500) && failures < 100;
}

export function useMe() {
  return useQuery({
    queryKey: [ME],
    queryFn: () => content(gateway.GET("/api/v1/users/me")),
    staleTime: 60_000,
  });
}

/** The open case; null when none is open. */
export function useOpenCase(enabled: boolean) {
  return useQuery({
    queryKey: [CASE, "open"],
    queryFn: async () => {
      const page = await content(
        gateway.GET("/api/v1/cases", { params: { query: { status: "open", limit: 1 } } }),
      );
      return page.items[0]?.id ?? null;
    },
    enabled,
  });
}

export function useCases(status: "open" | "closed" | null, enabled = true) {
  return useQuery({
    queryKey: [CASE, "list", status],
    queryFn: () =>
      content(
        gateway.GET("/api/v1/cases", {
          params: { query: { sort: "newest", limit: 100, ...(status && { status }) } },
        }),
      ),
    placeholderData: keepPreviousData,
    enabled,
  });
}

export async function readCase(id: string): Promise<ReadCase> {
  const got = await answered(gateway.GET("/api/v1/cases/{case_id}", { params: { path: { case_id: id } } }));
  return { view: got.data, etag: got.response.headers.get("ETag") ?? "" };
}

export function useCase(id: string | null) {
  return useQuery({
    queryKey: [CASE, id, "case"],
    queryFn: () => readCase(id ?? ""),
    enabled: id !== null,
    // The robot's own refusals and ages are in it, and they change without an event.
    refetchInterval: 2_000,
  });
}

const newest = { sort: "newest", limit: 1 } as const;

export function useNewestImage(id: string | null) {
  return useQuery({
    queryKey: [CASE, id, "newest image"],
    queryFn: async () => {
      const page = await content(
        gateway.GET("/api/v1/cases/{case_id}/images", {
          params: { path: { case_id: id ?? "" }, query: newest },
        }),
      );
      return page.items[0] ?? null;
    },
    enabled: id !== null,
  });
}

export function useNewestLocalisation(id: string | null) {
  return useQuery({
    queryKey: [CASE, id, "newest localisation"],
    queryFn: async () => {
      const page = await content(
        gateway.GET("/api/v1/cases/{case_id}/localisations", {
          params: { path: { case_id: id ?? "" }, query: newest },
        }),
      );
      return page.items[0] ?? null;
    },
    enabled: id !== null,
  });
}

/** What a localisation found, as vectors. It never changes. */
export function drawingQuery(caseId: string, number: number) {
  return queryOptions({
    queryKey: ["drawing", caseId, number],
    queryFn: () =>
      content(
        gateway.GET("/api/v1/cases/{case_id}/localisations/{number}/drawing", {
          params: { path: { case_id: caseId, number } },
        }),
      ),
    staleTime: Number.POSITIVE_INFINITY,
  });
}

/**
 * Read a localisation that has just come, and its drawing with it: the surgeon waits for both. It is the newest until
 * all of the case is read anew.
 */
export async function readDrawn(client: QueryClient, caseId: string, number: number): Promise<void> {
  void client.prefetchQuery({ ...drawingQuery(caseId, number), retry: false });
  const read = await content(
    gateway.GET("/api/v1/cases/{case_id}/localisations/{number}", {
      params: { path: { case_id: caseId, number } },
    }),
  );
  client.setQueryData<LocalisationView | null>([CASE, caseId, "newest localisation"], (known) =>
    known && known.number > number ? known : read,
  );
}

export function useNewestPlan(id: string | null) {
  return useQuery({
    queryKey: [CASE, id, "newest plan"],
    queryFn: async () => {
      const page = await content(
        gateway.GET("/api/v1/cases/{case_id}/plans", {
          params: { path: { case_id: id ?? "" }, query: newest },
        }),
      );
      return page.items[0] ?? null;
    },
    enabled: id !== null,
  });
}

export function useNewestVerification(id: string | null) {
  return useQuery({
    queryKey: [CASE, id, "newest verification"],
    queryFn: async () => {
      const page = await content(
        gateway.GET("/api/v1/cases/{case_id}/verifications", {
          params: { path: { case_id: id ?? "" }, query: newest },
        }),
      );
      return page.items[0] ?? null;
    },
    enabled: id !== null,
  });
}

/** The robot's state, asked for again and again: its ages and its pose make no events. */
export function useRobot(enabled: boolean) {
  return useQuery({
    queryKey: ["robot"],
    queryFn: async ({ signal }): Promise<RobotSnapshot> => {
      const within = AbortSignal.any([signal, AbortSignal.timeout(ROBOT_WITHIN_MS)]);
      const view = await content(gateway.GET("/api/v1/robot", { signal: within }));
      return { view, gotAtMs: performance.now() };
    },
    enabled,
    retry: false,
    refetchInterval: ROBOT_EVERY_MS,
    refetchIntervalInBackground: true,
  });
}

export function useReadiness() {
  return useQuery({
    queryKey: ["readiness"],
    queryFn: async () => {
      try {
        return (await content(gateway.GET("/readyz"))).checks;
      } catch (error) {
        // 503 lists the same parts, and says what is wrong with them.
        const checks = error instanceof ApiError ? error.problem?.checks : undefined;
        if (checks) return checks as unknown as readonly CheckView[];
        throw error;
      }
    },
    retry: false,
    refetchInterval: HEALTH_EVERY_MS,
  });
}

/** The newest images of a case, the newest first. */
export function useImages(id: string, limit: number) {
  return useQuery({
    queryKey: [CASE, id, "images", limit],
    queryFn: async () => {
      const page = await content(
        gateway.GET("/api/v1/cases/{case_id}/images", {
          params: { path: { case_id: id }, query: { sort: "newest", limit } },
        }),
      );
      return page.items;
    },
    placeholderData: keepPreviousData,
  });
}

const ALL = 200;

export function useSteps(id: string) {
  return useQuery({
    queryKey: [CASE, id, "steps"],
    queryFn: async () => {
      const path = { case_id: id };
      return (
        await content(
          gateway.GET("/api/v1/cases/{case_id}/steps", { params: { path, query: { limit: ALL } } }),
        )
      ).items;
    },
  });
}

export function useVerifications(id: string) {
  return useQuery({
    queryKey: [CASE, id, "verifications"],
    queryFn: async () => {
      const path = { case_id: id };
      return (
        await content(
          gateway.GET("/api/v1/cases/{case_id}/verifications", { params: { path, query: { limit: ALL } } }),
        )
      ).items;
    },
  });
}

export function usePlans(id: string) {
  return useQuery({
    queryKey: [CASE, id, "plans"],
    queryFn: async () => {
      const path = { case_id: id };
      return (
        await content(
          gateway.GET("/api/v1/cases/{case_id}/plans", { params: { path, query: { limit: ALL } } }),
        )
      ).items;
    },
  });
}

export function useQaReports(id: string) {
  return useQuery({
    queryKey: [CASE, id, "quality"],
    queryFn: async () => {
      const path = { case_id: id };
      return (
        await content(
          gateway.GET("/api/v1/cases/{case_id}/qa-reports", { params: { path, query: { limit: ALL } } }),
        )
      ).items;
    },
  });
}

/** What happened in a case: all of it, page by page. */
export function useTimeline(id: string) {
  return useQuery({
    queryKey: [CASE, id, "timeline"],
    queryFn: async () => {
      const entries: TimelineEntry[] = [];
      let cursor: string | null = null;
      do {
        const page: { items: TimelineEntry[]; next_cursor: string | null } = await content(
          gateway.GET("/api/v1/cases/{case_id}/timeline", {
            params: { path: { case_id: id }, query: { limit: ALL, ...(cursor && { cursor }) } },
          }),
        );
        entries.push(...page.items);
        cursor = page.next_cursor;
      } while (cursor !== null);
      return entries;
    },
  });
}

export function useParts() {
  return useQuery({
    queryKey: ["parts"],
    queryFn: () => content(gateway.GET("/api/v1/parts")),
    staleTime: 60_000,
  });
}

export function useUsers(enabled: boolean) {
  return useQuery({
    queryKey: ["users"],
    queryFn: async () =>
      (await content(gateway.GET("/api/v1/users", { params: { query: { limit: ALL } } }))).items,
    enabled,
  });
}

/** The own passkeys, the oldest first. */
export function usePasskeys(enabled: boolean) {
  return useQuery({
    queryKey: ["passkeys"],
    queryFn: async () => (await content(gateway.GET("/api/v1/users/me/passkeys"))).items,
    enabled,
    staleTime: 60_000,
  });
}

/** The hospital's identity provider by its name; null where there is none. */
export function useProvider() {
  return useQuery({
    queryKey: ["ways"],
    queryFn: async () => (await content(gateway.GET("/api/v1/sessions/ways"))).provider,
    staleTime: Number.POSITIVE_INFINITY,
  });
}

export function useVersion() {
  return useQuery({
    queryKey: ["version"],
    queryFn: async () => (await content(gateway.GET("/healthz"))).version,
    staleTime: 60_000,
  });
}

/** How to turn the C-arm, from the newest localisation; null while there is none. */
export function useAlignment(id: string, enabled: boolean) {
  return useQuery({
    queryKey: [CASE, id, "alignment"],
    queryFn: () =>
      content(gateway.GET("/api/v1/cases/{case_id}/alignment", { params: { path: { case_id: id } } })).catch(
        (error: unknown) => {
          if (error instanceof ApiError && error.status === 404) return null;
          throw error;
        },
      ),
    enabled,
  });
}
