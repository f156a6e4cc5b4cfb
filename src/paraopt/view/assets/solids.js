// Solids and lines as three.js objects. World lengths are metres.
import * as THREE from "three";
import { decode } from "paraopt/motion";

/** Geometry of a shape in its own frame; cylinders and capsules run along z. */
function buildGeometry(shape) {
  switch (shape.type) {
    case "box":
      return new THREE.BoxGeometry(...shape.size);
    case "sphere":
      return new THREE.SphereGeometry(shape.radius, 48, 32);
    case "cylinder":
      return new THREE.CylinderGeometry(shape.radius, shape.radius, shape.length, 48).rotateX(Math.PI / 2);
    case "cone":
      return new THREE.ConeGeometry(shape.radius, shape.length, 48).rotateX(Math.PI / 2);
    case "mesh":
      return buildTriangles(decode(shape.vertices), shape.triangles);
    case "capsule":
      return new THREE.CapsuleGeometry(shape.radius, shape.length, 12, 32).rotateX(Math.PI / 2);
    default:
      throw new Error(`The page does not know the shape "${shape.type}".`);
  }
}

/** Triangles with flat faces: each has its own corners, so that edges stay sharp. */
function buildTriangles(vertices, triangles) {
  const positions = new Float32Array(3 * triangles.length);
  triangles.forEach((corner, i) => positions.set(vertices.slice(3 * corner, 3 * corner + 3), 3 * i));
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute("position", new THREE.BufferAttribute(positions, 3));
  geometry.computeVertexNormals();
  return geometry;
}

/** Shapes whose sharp edges are drawn. */
const EDGED = new Set(["box", "cylinder", "cone", "mesh"]);

/** Mesh of a body, placed in its frame, with its sharp edges drawn. Obstacles let what is behind them shine through. */
export function buildBody(body, color) {
  const geometry = buildGeometry(body.shape);
  const translucent = body.kind === "obstacle";
  const material = new THREE.MeshStandardMaterial({
    color,
    roughness: 0.58,
    metalness: body.kind === "base" || body.kind === "robot" ? 0.12 : 0,
    transparent: translucent,
    opacity: translucent ? 0.62 : 1,
  });
  const mesh = new THREE.Mesh(geometry, material);
  mesh.name = body.name;
  mesh.matrix.set(...body.pose);
  mesh.matrixAutoUpdate = false;
  mesh.castShadow = true;
  mesh.receiveShadow = !translucent;
  mesh.renderOrder = translucent ? 1 : 0;
  if (EDGED.has(body.shape.type)) {
    const edges = new THREE.LineSegments(
      new THREE.EdgesGeometry(geometry, 40),
      new THREE.LineBasicMaterial({ color: new THREE.Color(color).multiplyScalar(0.35), transparent: true, opacity: 0.45 }),
    );
    edges.renderOrder = mesh.renderOrder;
    edges.raycast = () => {};
    mesh.add(edges);
  }
  return mesh;
}

/** Cut a polyline into the straight pieces to draw: all of it, or its dashes. */
function cutPieces(points, dashed, size) {
  const pieces = [];
  const [dash, gap] = [0.03 * size, 0.022 * size];
  let from = points[0];
  let drawing = true;
  let left = dash;
  for (const to of points.slice(1)) {
    let here = from;
    let length = here.distanceTo(to);
    if (length < 1e-4 * size && to !== points[points.length - 1]) continue;
    while (dashed && length > left) {
      const there = here.clone().lerp(to, left / length);
      if (drawing) pieces.push([here, there]);
      length -= left;
      here = there;
      drawing = !drawing;
      left = drawing ? dash : gap;
    }
    left -= length;
    if ((!dashed || drawing) && length > 0) pieces.push([here, to]);
    from = to;
  }
  return pieces;
}

function placePieces(pieces, geometry, material, radius) {
  const mesh = new THREE.InstancedMesh(geometry, material, Math.max(1, pieces.length));
  mesh.count = pieces.length;
  const [middle, direction, turn, matrix] = [new THREE.Vector3(), new THREE.Vector3(), new THREE.Quaternion(), new THREE.Matrix4()];
  const along = new THREE.Vector3(0, 1, 0);
  pieces.forEach(([a, b], i) => {
    direction.subVectors(b, a);
    const length = direction.length();
    turn.setFromUnitVectors(along, direction.divideScalar(length));
    middle.addVectors(a, b).multiplyScalar(0.5);
    mesh.setMatrixAt(i, matrix.compose(middle, turn, new THREE.Vector3(radius, length + 0.6 * radius, radius)));
  });
  mesh.frustumCulled = false;
  mesh.raycast = () => {};
  return mesh;
}

/** A polyline as a thin tube with a ball at each end; where it runs behind a solid it shows faintly. */
export function buildPath(path, size) {
  const numbers = decode(path.points);
  const points = Array.from({ length: numbers.length / 3 }, (_, i) => new THREE.Vector3().fromArray(numbers, 3 * i));
  const group = new THREE.Group();
  group.name = path.name;
  const material = new THREE.MeshBasicMaterial({ color: path.color });
  const hidden = new THREE.MeshBasicMaterial({ color: path.color, transparent: true, opacity: 0.28, depthTest: false, depthWrite: false });
  const radius = 0.0042 * size;
  const pieces = cutPieces(points, path.dashed, size);
  const rod = new THREE.CylinderGeometry(1, 1, 1, 10);
  const behind = placePieces(pieces, rod, hidden, radius);
  behind.renderOrder = 3;
  const front = placePieces(pieces, rod, material, radius);
  front.renderOrder = 0;
  group.add(front, behind);
  for (const end of new Set([points[0], points[points.length - 1]])) {
    const ball = new THREE.Mesh(new THREE.SphereGeometry((path.dashed ? 1.9 : 2.6) * radius, 20, 14), material);
    ball.position.copy(end);
    ball.raycast = () => {};
    group.add(ball);
  }
  return { group, points };
}

/** Ground in its own x-y plane: a grid that fades with distance from (cx, cy), and a catcher of shadows. */
export function buildGround(step, radius, cx, cy, color) {
  const positions = [];
  const colors = [];
  const { r, g, b } = new THREE.Color(color);
  const weight = (x, y) => Math.max(0, 1 - Math.hypot(x - cx, y - cy) / radius) ** 0.8;
  const range = (center) => [Math.ceil((center - radius) / step), Math.floor((center + radius) / step)];
  const add = (x0, y0, x1, y1, strength) => {
    const ends = [weight(x0, y0), weight(x1, y1)];
    if (ends[0] + ends[1] === 0) return;
    positions.push(x0, y0, 0, x1, y1, 0);
    for (const end of ends) colors.push(r, g, b, strength * end);
  };
  const [i0, i1] = range(cx);
  const [j0, j1] = range(cy);
  for (let i = i0; i <= i1; i += 1) {
    for (let j = j0; j < j1; j += 1) add(i * step, j * step, i * step, (j + 1) * step, i % 5 === 0 ? 0.7 : 0.36);
  }
  for (let j = j0; j <= j1; j += 1) {
    for (let i = i0; i < i1; i += 1) add(i * step, j * step, (i + 1) * step, j * step, j % 5 === 0 ? 0.7 : 0.36);
  }
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute("position", new THREE.Float32BufferAttribute(positions, 3));
  geometry.setAttribute("color", new THREE.Float32BufferAttribute(colors, 4));
  const grid = new THREE.LineSegments(
    geometry,
    new THREE.LineBasicMaterial({ vertexColors: true, transparent: true, depthWrite: false }),
  );
  grid.renderOrder = -1;
  const shade = new THREE.Mesh(new THREE.CircleGeometry(radius, 64), new THREE.ShadowMaterial({ opacity: 0.15, depthWrite: false }));
  shade.position.set(cx, cy, 0);
  shade.receiveShadow = true;
  shade.renderOrder = -2;
  return { grid, shade };
}
