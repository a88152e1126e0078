// Part files as the gateway sends them: what the scene needs of docs/parts.md.
import type { Point, Rows } from "./transform";

export interface Pose {
  readonly x_mm: number;
  readonly y_mm: number;
  readonly z_mm: number;
  readonly u_deg: number;
  readonly v_deg: number;
  readonly w_deg: number;
}

export interface Ball {
  readonly id: string;
  readonly position_mm: Point;
  readonly diameter_mm: number;
}

export interface HexapodPart {
  readonly name: string;
  readonly legs: readonly {
    readonly id: string;
    readonly base_joint_mm: Point;
    readonly top_joint_mm: Point;
  }[];
  readonly leg_diameter_mm?: number;
  readonly leg_length_mm: { readonly minimum: number; readonly maximum: number };
  readonly base_joint_cone_deg: number;
  readonly top_joint_cone_deg: number;
  readonly speed_limits: { readonly translation_mm_per_s: number; readonly rotation_deg_per_s: number };
  readonly zero_height_mm: number;
  readonly home_pose: Pose;
  readonly pivot_mm: Point;
  readonly head: {
    readonly extension_mm: { readonly minimum: number; readonly maximum: number };
    readonly top_from_guide_rotation: Rows;
    readonly top_from_guide_translation_at_zero_mm: Point;
  };
  readonly bone_screws?: { readonly spacing_mm: number; readonly diameter_mm: number };
}

export interface GuidePart {
  readonly balls: readonly Ball[];
  readonly holes: readonly {
    readonly id: string;
    readonly point_mm: Point;
    readonly direction: Point;
    readonly diameter_mm: number;
  }[];
  readonly body?: readonly { readonly centre_mm: Point; readonly size_mm: Point }[];
}

export interface NailPart {
  readonly diameter_mm: number;
  readonly cannulation_diameter_mm: number;
  readonly tip_x_mm: number;
  readonly holes: readonly {
    readonly id: string;
    readonly position_mm: Point;
    readonly direction: Point;
    readonly diameter_mm: number;
    readonly slot_length_mm?: number;
  }[];
}

export interface RingPart {
  readonly balls: readonly Ball[];
  readonly plates: readonly {
    readonly z_mm: number;
    readonly radius_mm: number;
    readonly thickness_mm: number;
  }[];
}

export interface Parts {
  readonly hexapod: HexapodPart;
  readonly guide: GuidePart;
  readonly nail: NailPart;
  readonly ring: RingPart;
}
