import type { Material } from "three";
import { Vector3 } from "three";
import { nearness, usedShare } from "./hexapod";
import { LEG, LOOK, SHAPE } from "./looks";
import type { HexapodPart, Parts } from "./parts";
import { Balls, Placed, Rod } from "./pieces";
import type { Stance } from "./sceneModel";
import { vector } from "./transform";

interface Props {
  readonly parts: Parts;
  readonly stance: Stance;
  readonly mount: string;
  readonly head_extension_mm: number;
  /** Everything in one look: a ghost, or what is not live. */
  readonly look?: Material;
  readonly seesThroughGuide?: boolean;
}

const USUAL_LEG_MM = 6;
const USUAL_SCREWS = { spacing_mm: 25, diameter_mm: 5 };
const PLATE_MM = { radius: 26, top_radius: 22, thickness: 5 };
// Schematic: how far the mount's screws reach towards the bone.
const SCREW_LENGTH_MM = 42;

/** Hexapod, head and guide in one pose. */
export default function Robot({ parts, stance, mount, head_extension_mm, look, seesThroughGuide }: Props) {
  const { hexapod } = parts;
  return (
    <>
      {look !== LOOK.ghost && <Base hexapod={hexapod} mount={mount} look={look} />}
      <Legs hexapod={hexapod} stance={stance} look={look} />
      <Placed at={stance.base_from_top.matrix}>
        <Plate z_mm={PLATE_MM.thickness / 2} radius_mm={PLATE_MM.top_radius} look={look ?? LOOK.metal} />
        <Head hexapod={hexapod} head_extension_mm={head_extension_mm} look={look ?? LOOK.metal} />
      </Placed>
      <Placed at={stance.base_from_guide.matrix}>
        <Guide parts={parts} look={look} seesThrough={seesThroughGuide ?? false} />
      </Placed>
    </>
  );
}

function Base({ hexapod, mount, look }: { hexapod: HexapodPart; mount: string; look: Material | undefined }) {
  const screws = hexapod.bone_screws ?? USUAL_SCREWS;
  return (
    <>
      <Plate z_mm={-PLATE_MM.thickness / 2} radius_mm={PLATE_MM.radius} look={look ?? LOOK.metal} />
      {mount === "bone" &&
        [-1, 1].map((side) => (
          <Rod
            key={side}
            from_mm={new Vector3((side * screws.spacing_mm) / 2, 0, 0)}
            to_mm={new Vector3((side * screws.spacing_mm) / 2, 0, -SCREW_LENGTH_MM)}
            radius_mm={screws.diameter_mm / 2}
            look={look ?? LOOK.screw}
          />
        ))}
    </>
  );
}

function Plate({ z_mm, radius_mm, look }: { z_mm: number; radius_mm: number; look: Material }) {
  const half = PLATE_MM.thickness / 2;
  return (
    <Rod
      from_mm={new Vector3(0, 0, z_mm - half)}
      to_mm={new Vector3(0, 0, z_mm + half)}
      radius_mm={radius_mm}
      look={look}
    />
  );
}

/** Each leg is a barrel and a rod; its colour says how near it is to a limit of its own or of its joints. */
function Legs({
  hexapod,
  stance,
  look,
}: {
  hexapod: HexapodPart;
  stance: Stance;
  look: Material | undefined;
}) {
  const radius_mm = (hexapod.leg_diameter_mm ?? USUAL_LEG_MM) / 2;
  return stance.legs.map((leg) => {
    const near = nearness(usedShare(hexapod, leg));
    // A ghost's legs warn too; only where nothing is known to be live they say nothing.
    const shown = look === undefined || (look === LOOK.ghost && near !== "free") ? LEG[near] : look;
    const barrel_mm = leg.base_mm.clone().lerp(leg.top_mm, 0.55);
    return (
      <group key={leg.id}>
        <Rod from_mm={leg.base_mm} to_mm={barrel_mm} radius_mm={radius_mm} look={shown} />
        <Rod from_mm={barrel_mm} to_mm={leg.top_mm} radius_mm={radius_mm * 0.55} look={shown} />
        {[leg.base_mm, leg.top_mm].map((at_mm, index) => (
          <mesh
            key={index === 0 ? "base" : "top"}
            geometry={SHAPE.ball}
            material={shown}
            position={at_mm}
            scale={radius_mm * 1.25}
          />
        ))}
      </group>
    );
  });
}

/** The bar that carries the guide. */
function Head({
  hexapod,
  head_extension_mm,
  look,
}: {
  hexapod: HexapodPart;
  head_extension_mm: number;
  look: Material;
}) {
  const [x, y, z] = hexapod.head.top_from_guide_translation_at_zero_mm;
  const [from_mm, to_mm] = [-14, x + head_extension_mm - 27];
  return (
    <mesh
      geometry={SHAPE.box}
      material={look}
      position={[(from_mm + to_mm) / 2, y, (PLATE_MM.thickness + z) / 2 + 3]}
      scale={[to_mm - from_mm, 18, z - PLATE_MM.thickness + 6]}
    />
  );
}

interface GuideProps {
  readonly parts: Parts;
  readonly look: Material | undefined;
  readonly seesThrough: boolean;
}

function Guide({ parts, look, seesThrough }: GuideProps) {
  const { guide } = parts;
  return (
    <>
      {!seesThrough &&
        (guide.body ?? []).map((block) => (
          <mesh
            key={block.centre_mm.join()}
            geometry={SHAPE.box}
            material={look ?? LOOK.delrin}
            position={vector(block.centre_mm)}
            scale={vector(block.size_mm)}
            renderOrder={2}
          />
        ))}
      {look !== LOOK.ghost && !seesThrough && <Balls balls={guide.balls} shape={SHAPE.ball} />}
    </>
  );
}
