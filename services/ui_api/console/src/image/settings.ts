// How the viewer is set: one reducer, pure.
import { AS_IT_CAME, dragged, type Grey } from "./grey";
import { boundedZoom, mirrored, type Size, turned, type View, wholePicture } from "./view";

export type DragMode = "move" | "grey" | "ruler";
export type Compare = "off" | "wiper" | "beside";

export interface Settings {
  readonly view: View;
  readonly grey: Grey;
  readonly drag: DragMode;
  readonly isCorrected: boolean;
  readonly showsOverlay: boolean;
  readonly showsHoles: boolean;
  readonly compare: Compare;
  /** Where the wiper stands, as a share of the width. */
  readonly wiper: number;
  /** Image chosen as the one before; null for the one that is proposed. */
  readonly before: string | null;
}

export type SettingsEvent =
  | { readonly kind: "view"; readonly view: View }
  | { readonly kind: "whole"; readonly image: Size }
  | { readonly kind: "zoom"; readonly factor: number }
  | {
      readonly kind:
        | "turn"
        | "mirror"
        | "corrected"
        | "overlay"
        | "holes"
        | "invert"
        | "grey_reset"
        | "compare";
    }
  | { readonly kind: "drag"; readonly mode: DragMode }
  | { readonly kind: "grey"; readonly byShare: readonly [number, number] }
  | { readonly kind: "wiper"; readonly share: number }
  | { readonly kind: "before"; readonly image: string };

export const FIRST_SETTINGS: Settings = {
  view: wholePicture({ width: 0, height: 0 }),
  grey: AS_IT_CAME,
  drag: "move",
  isCorrected: false,
  showsOverlay: true,
  showsHoles: true,
  compare: "off",
  wiper: 0.5,
  before: null,
};

const NEXT_COMPARE: Readonly<Record<Compare, Compare>> = { off: "wiper", wiper: "beside", beside: "off" };

export function settingsReducer(state: Settings, event: SettingsEvent): Settings {
  switch (event.kind) {
    case "view":
      return { ...state, view: event.view };
    case "whole":
      return { ...state, view: wholePicture(event.image, state.view) };
    case "zoom":
      return { ...state, view: { ...state.view, zoom: boundedZoom(state.view.zoom * event.factor) } };
    case "turn":
      return { ...state, view: turned(state.view) };
    case "mirror":
      return { ...state, view: mirrored(state.view) };
    case "corrected":
      return { ...state, isCorrected: !state.isCorrected };
    case "overlay":
      return { ...state, showsOverlay: !state.showsOverlay };
    case "holes":
      return { ...state, showsHoles: !state.showsHoles };
    case "invert":
      return { ...state, grey: { ...state.grey, isInverted: !state.grey.isInverted } };
    case "grey_reset":
      return { ...state, grey: AS_IT_CAME };
    case "compare":
      return { ...state, compare: NEXT_COMPARE[state.compare] };
    case "drag":
      return { ...state, drag: event.mode };
    case "grey":
      return { ...state, grey: dragged(state.grey, event.byShare) };
    case "wiper":
      return { ...state, wiper: Math.min(Math.max(event.share, 0), 1) };
    case "before":
      return { ...state, before: event.image };
  }
}
