// Small pieces of the scene.
import { useLayoutEffect, useMemo, useRef } from "react";
import {
  type BufferGeometry,
  type InstancedMesh,
  type Material,
  type Matrix4 as Matrix,
  Matrix4,
  Quaternion,
  Vector3,
} from "three";
import { LOOK, ring, SHAPE } from "./looks";
import type { Ball } from "./parts";
import { vector } from "./transform";

const UP = new Vector3(0, 1, 0);

interface RodProps {
  readonly from_mm: Vector3;
  readonly to_mm: Vector3;
  readonly radius_mm: number;
  readonly look: Material;
  readonly shape?: BufferGeometry;
  readonly renderOrder?: number;
}

/** A cylinder between two points. */
export function Rod({ from_mm, to_mm, radius_mm, look, shape = SHAPE.rod, renderOrder = 0 }: RodProps) {
  const way = to_mm.clone().sub(from_mm);
  const length_mm = way.length();
  const turn = new Quaternion().setFromUnitVectors(UP, way.divideScalar(length_mm || 1));
  return (
    <mesh
      geometry={shape}
      material={look}
      position={from_mm.clone().add(to_mm).multiplyScalar(0.5)}
      quaternion={turn}
      scale={[radius_mm, length_mm, radius_mm]}
      renderOrder={renderOrder}
    />
  );
}

interface CircleProps {
  readonly at_mm: Vector3;
  readonly across: Vector3;
  readonly radius_mm: number;
  readonly thickness_mm: number;
  readonly look: Material;
}

/** A circle in the plane across a direction. */
export function Circle({ at_mm, across, radius_mm, thickness_mm, look }: CircleProps) {
  const shape = useMemo(() => ring(radius_mm, thickness_mm), [radius_mm, thickness_mm]);
  const turn = new Quaternion().setFromUnitVectors(UP, across);
  return <mesh geometry={shape} material={look} position={at_mm} quaternion={turn} />;
}

/** Steel balls as one object. */
export function Balls({ balls, shape }: { readonly balls: readonly Ball[]; readonly shape: BufferGeometry }) {
  const mesh = useRef<InstancedMesh>(null);
  useLayoutEffect(() => {
    balls.forEach((ball, index) => {
      const radius_mm = ball.diameter_mm / 2;
      const place = new Matrix4()
        .makeScale(radius_mm, radius_mm, radius_mm)
        .setPosition(vector(ball.position_mm));
      mesh.current?.setMatrixAt(index, place);
    });
    if (mesh.current) mesh.current.instanceMatrix.needsUpdate = true;
    mesh.current?.computeBoundingSphere();
  }, [balls]);
  return <instancedMesh ref={mesh} args={[shape, LOOK.ball, balls.length]} key={balls.length} />;
}

/** Children in a frame of their own. */
export function Placed({ at, children }: { readonly at: Matrix; readonly children: React.ReactNode }) {
  return (
    <group matrixAutoUpdate={false} matrix={at}>
      {children}
    </group>
  );
}
