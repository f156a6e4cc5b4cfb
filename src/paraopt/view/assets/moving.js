// What changes in time beside the poses: cables between two frames, and the marks of the phases of a motion.
import * as THREE from "three";

const ALONG = new THREE.Vector3(0, 1, 0);

/** Cables as thin rods, each stretched anew at every instant between points of two carriers (the world for -1). */
export function createCables(cables, world, carriers) {
  const group = new THREE.Group();
  const materials = new Map(cables.map(({ color }) => [color, new THREE.MeshStandardMaterial({ color, roughness: 0.45, metalness: 0.2 })]));
  const rod = new THREE.CylinderGeometry(1, 1, 1, 12);
  const rods = cables.map((cable) => {
    const mesh = new THREE.Mesh(rod, materials.get(cable.color));
    mesh.name = cable.name;
    mesh.castShadow = true;
    mesh.matrixAutoUpdate = false;
    mesh.frustumCulled = false;
    group.add(mesh);
    const ends = cable.frames.map((frame, side) => ({
      carrier: frame < 0 ? world : carriers[frame],
      point: new THREE.Vector3(...cable.points[side]),
      at: new THREE.Vector3(),
    }));
    return { name: cable.name, radius: cable.radius, mesh, ends };
  });
  const [direction, middle, scale, turn] = [new THREE.Vector3(), new THREE.Vector3(), new THREE.Vector3(), new THREE.Quaternion()];

  /** Stretch the cables between where the carriers are now; none is drawn thinner than `least` [m]. */
  function place(least) {
    for (const { mesh, ends: [a, b], radius } of rods) {
      for (const end of [a, b]) end.at.copy(end.point).applyMatrix4(end.carrier.matrixWorld);
      const length = direction.subVectors(b.at, a.at).length();
      mesh.visible = length > 0;
      if (!length) continue;
      turn.setFromUnitVectors(ALONG, direction.divideScalar(length));
      const thick = Math.max(radius, least);
      mesh.matrix.compose(middle.addVectors(a.at, b.at).multiplyScalar(0.5), turn, scale.set(thick, length, thick));
      mesh.matrixWorldNeedsUpdate = true;
    }
  }
  return { group, rods, place };
}

/** Marks of phases: balls at points of carriers, and colours that bodies take while a phase lasts. */
export function createMarks(phases, world, carriers, bodies, size) {
  const ball = new THREE.SphereGeometry(0.034 * size, 28, 20);
  const front = (color) => new THREE.MeshStandardMaterial({ color, roughness: 0.5 });
  // Where a solid hides it, a mark shows faintly: feet and hooks often lie inside of what they hold.
  const behind = (color) => new THREE.MeshBasicMaterial({ color, transparent: true, opacity: 0.4, depthTest: false, depthWrite: false });
  const groups = phases.map((phase) => phase.marks.map((mark) => {
    const carrier = mark.frame < 0 ? world : carriers[mark.frame];
    if (mark.point === null) {
      return { ...mark, carrier, tinted: bodies.filter((body) => body.frame === mark.frame).map((body) => body.mesh) };
    }
    const mesh = new THREE.Mesh(ball, front(mark.color));
    const shine = new THREE.Mesh(ball, behind(mark.color));
    mesh.position.set(...mark.point);
    mesh.visible = false;
    mesh.raycast = shine.raycast = () => {};
    shine.renderOrder = 3;
    mesh.add(shine);
    carrier.add(mesh);
    return { ...mark, carrier, mesh };
  }));
  const own = new Map(bodies.map(({ mesh }) => [mesh, mesh.material.color.clone()]));
  let shown = -1;

  /** Show the marks of the phase with this index, and hide all others; -1 for none. */
  function show(index) {
    if (index === shown) return;
    for (const mark of groups[shown] ?? []) {
      if (mark.mesh) mark.mesh.visible = false;
      for (const mesh of mark.tinted ?? []) mesh.material.color.copy(own.get(mesh));
    }
    shown = index;
    for (const mark of groups[shown] ?? []) {
      if (mark.mesh) mark.mesh.visible = true;
      for (const mesh of mark.tinted ?? []) mesh.material.color.set(mark.color);
    }
  }

  /** The marks that are shown: label, colour, and the world position of those that are points. */
  function list() {
    return (groups[shown] ?? []).map(({ label, color, mesh, tinted }) => ({
      label, color,
      point: mesh ? mesh.getWorldPosition(new THREE.Vector3()).toArray() : null,
      bodies: (tinted ?? []).map((body) => body.name),
    }));
  }
  return { show, list };
}
