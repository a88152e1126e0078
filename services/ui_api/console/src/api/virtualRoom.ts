// The virtual operating room, in a simulation only. The gateway passes its control API on.
import { useQuery } from "@tanstack/react-query";
import { ApiError, problemOf, type Schemas } from "./client";
import { onConnection } from "./connections";
import { withRenewal } from "./renewal";

export interface RoomScenario {
  readonly seed: number;
  readonly case: Schemas["CaseBody"];
  readonly hole_ids: readonly string[];
}

export interface Passage {
  readonly hole_id: string;
  readonly passed: boolean;
  readonly entry_offset_mm: number;
  readonly exit_offset_mm: number;
  readonly angle_deg: number;
  readonly struck: string | null;
}

export interface RoomState {
  readonly cArm: { readonly orbital_deg: number; readonly angular_deg: number };
  readonly wires: readonly Passage[];
  readonly drills: readonly Passage[];
  readonly faults: RoomFaults;
}

export interface RoomFaults {
  readonly dose_factor: number;
  readonly motion_blur_px: number;
  readonly overexposure: number;
  readonly nail_present: boolean;
  readonly guide_present: boolean;
  readonly ring_shift_mm: number;
  readonly mount_shift_mm: readonly [number, number, number];
  readonly controller: readonly string[];
}

export interface AxisTruth {
  readonly hole_id: string;
  readonly entry_offset_mm: number;
  readonly exit_offset_mm: number;
  readonly angle_deg: number;
}

async function asked<T>(method: string, path: string, body?: unknown): Promise<T> {
  const request = new Request(new URL(`/virtual-room/${path}`, globalThis.location.href), {
    method,
    credentials: "same-origin",
    ...(body !== undefined && {
      body: JSON.stringify(body),
      headers: { "Content-Type": "application/json" },
    }),
  });
  let answer: Response;
  try {
    answer = await withRenewal(request, (again) =>
      onConnection("usual", (signal) => fetch(again, { signal })),
    );
  } catch (error) {
    throw new ApiError(0, "no_answer", String(error));
  }
  const content: unknown = answer.status === 204 ? null : await answer.json();
  if (!answer.ok) throw problemOf(content, answer.status);
  return content as T;
}

export const room = {
  shoot: () => asked("POST", "shots"),
  fluoroscopy: (images: number) => asked("POST", "fluoroscopy", { images, images_per_s: 10 }),
  turnTo: (orbital_deg: number, angular_deg: number) => asked("PUT", "c-arm", { orbital_deg, angular_deg }),
  turnBy: (about_image_x_deg: number, about_image_y_deg: number) =>
    asked("POST", "c-arm/turn", { about_image_x_deg, about_image_y_deg }),
  insertWires: () => asked("POST", "wires"),
  removeWires: () => asked("DELETE", "wires"),
  drill: (hole_id: string) => asked<Passage>("POST", "drills", { hole_id }),
  newBone: () => asked("DELETE", "drills"),
  inject: (fault: Record<string, unknown>) => asked("POST", "faults", fault),
  clearController: (name: string) => asked("DELETE", `faults/controller/${name}`),
  clearFaults: () => asked("DELETE", "faults"),
};

/** What the scenario says that the surgeon would enter; null where there is no virtual room. */
export function useScenario(enabled: boolean) {
  return useQuery({
    queryKey: ["virtual room", "scenario"],
    queryFn: () => asked<RoomScenario>("GET", "scenario").catch(absent),
    enabled,
    staleTime: Number.POSITIVE_INFINITY,
  });
}

function absent(error: unknown): null {
  if (error instanceof ApiError && error.status === 404) return null;
  throw error;
}

const EVERY_MS = 2_000;

export function useRoomState(enabled: boolean) {
  return useQuery({
    queryKey: ["virtual room", "state"],
    queryFn: async (): Promise<RoomState> => {
      const [cArm, wires, drills, faults] = await Promise.all([
        asked<RoomState["cArm"]>("GET", "c-arm"),
        asked<{ items: Passage[] }>("GET", "wires"),
        asked<{ items: Passage[] }>("GET", "drills"),
        asked<RoomFaults>("GET", "faults"),
      ]);
      return { cArm, wires: wires.items, drills: drills.items, faults };
    },
    enabled,
    refetchInterval: EVERY_MS,
  });
}

export function useTruth(enabled: boolean) {
  return useQuery({
    queryKey: ["virtual room", "truth"],
    queryFn: async () => (await asked<{ guide_errors: AxisTruth[] }>("GET", "truth")).guide_errors,
    enabled,
    refetchInterval: EVERY_MS,
  });
}
