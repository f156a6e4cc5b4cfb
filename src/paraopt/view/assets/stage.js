// The three-dimensional view: scene, light, camera. It draws only when something changed.
import * as THREE from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";
import { niceStep, printLength } from "paraopt/motion";
import { buildBody, buildGround, buildPath } from "paraopt/solids";
import { createCables, createMarks } from "paraopt/moving";

const AXES = { x: new THREE.Vector3(1, 0, 0), y: new THREE.Vector3(0, 1, 0), z: new THREE.Vector3(0, 0, 1) };
const SAMPLES = 48; // instants at which the reach of the motion is looked at

/** Up, rightwards and towards the viewer of the front view, so that right x up points at the viewer. */
function orient(up) {
  const u = AXES[up].clone();
  const right = (up === "x" ? AXES.y : AXES.x).clone();
  return { up: u, right, near: new THREE.Vector3().crossVectors(right, u) };
}

export function createStage(canvas, axesCanvas, data, motion) {
  const renderer = new THREE.WebGLRenderer({ canvas, antialias: true, alpha: true });
  renderer.shadowMap.enabled = true;
  renderer.shadowMap.type = THREE.PCFShadowMap;
  const scene = new THREE.Scene();
  const basis = orient(data.up);

  // --- Bodies and their frames
  const carriers = Array.from({ length: motion.frames }, () => new THREE.Group());
  const world = new THREE.Group();
  scene.add(world, ...carriers);
  const bodies = data.bodies.map((body) => {
    const mesh = buildBody(body, data.kinds[body.kind].color);
    (body.frame < 0 ? world : carriers[body.frame]).add(mesh);
    return { ...body, mesh };
  });
  const cables = createCables(data.cables, world, carriers);
  scene.add(cables.group);
  let thinnest = 0; // radius below which no cable is drawn [m]
  const buffer = new Float64Array(7);
  function place(time) {
    const at = motion.at(time);
    carriers.forEach((carrier, frame) => {
      const [x, y, z, a, b, c, d] = motion.pose(frame, at, buffer);
      carrier.position.set(x, y, z);
      carrier.quaternion.set(a, b, c, d);
    });
    scene.updateMatrixWorld();
    if (!cables.rods.length) return;
    cables.place(thinnest);
    cables.group.updateMatrixWorld();
  }

  // --- Reach of the whole motion: corners of every body at many instants
  const reach = bodies.map(() => []);
  const ends = [];
  for (let s = 0; s < SAMPLES; s += 1) {
    place(motion.start + ((motion.end - motion.start) * s) / (SAMPLES - 1));
    bodies.forEach((body, index) => {
      if (body.frame < 0 && s > 0) return;
      if (!body.mesh.geometry.boundingBox) body.mesh.geometry.computeBoundingBox();
      const { min, max } = body.mesh.geometry.boundingBox;
      for (let corner = 0; corner < 8; corner += 1) {
        const point = new THREE.Vector3(corner & 1 ? max.x : min.x, corner & 2 ? max.y : min.y, corner & 4 ? max.z : min.z);
        reach[index].push(point.applyMatrix4(body.mesh.matrixWorld));
      }
    });
    for (const cable of cables.rods) ends.push(...cable.ends.map((end) => end.at.clone()));
  }
  place(motion.start);
  const own = [...reach.filter((_, index) => !["obstacle", "base"].includes(bodies[index].kind)).flat(), ...ends];
  const robotSphere = new THREE.Box3().setFromPoints(own.length ? own : reach.flat()).getBoundingSphere(new THREE.Sphere());
  // What dwarfs the robot (a floor to walk on, a wall) is drawn but does not decide the framing.
  const farthest = { obstacle: 2.5, base: 2 };
  const framed = reach.filter((points, index) => {
    const { kind, mesh } = bodies[index];
    const sphere = new THREE.Box3().setFromPoints(points).getBoundingSphere(new THREE.Sphere());
    const distance = sphere.center.distanceTo(robotSphere.center) + sphere.radius;
    const counts = !(kind in farthest) || distance <= farthest[kind] * robotSphere.radius;
    if (!counts && kind === "obstacle") mesh.material.opacity = 0.2;
    return counts;
  }).flat();
  const lowest = Math.min(...reach.filter((_, index) => bodies[index].kind === "base").flat().map((point) => point.dot(basis.up)));
  const size = robotSphere.radius;
  framed.push(...ends);
  thinnest = 0.0035 * size;
  const marks = createMarks(data.phases, world, carriers, bodies, size);

  const paths = new THREE.Group();
  scene.add(paths);
  for (const path of data.paths) {
    const { group, points } = buildPath(path, size);
    paths.add(group);
    framed.push(...points);
  }
  const box = new THREE.Box3().setFromPoints(framed);
  const sphere = box.getBoundingSphere(new THREE.Sphere());

  // --- Ground
  const level = Math.min(lowest, ...framed.map((point) => point.dot(basis.up))) - 0.002 * size;
  const ground = new THREE.Group();
  ground.quaternion.setFromUnitVectors(AXES.z, basis.up);
  ground.position.copy(basis.up).multiplyScalar(level);
  const local = sphere.center.clone().applyQuaternion(ground.quaternion.clone().invert());
  const step = niceStep(sphere.radius / 2.5);
  const { grid, shade } = buildGround(step, 3.2 * sphere.radius, local.x, local.y, "#6b7787");
  ground.add(grid, shade);
  scene.add(ground);

  // --- Light
  const sky = new THREE.HemisphereLight("#ffffff", "#c9ced6", 1.9);
  sky.position.copy(basis.up);
  const key = new THREE.DirectionalLight("#ffffff", 1.8);
  key.position.copy(sphere.center)
    .addScaledVector(basis.up, 3.6 * sphere.radius)
    .addScaledVector(basis.near, 1.3 * sphere.radius)
    .addScaledVector(basis.right, -1.1 * sphere.radius);
  key.target.position.copy(sphere.center);
  key.castShadow = true;
  key.shadow.mapSize.set(2048, 2048);
  key.shadow.radius = 3;
  key.shadow.bias = -0.0004;
  key.shadow.normalBias = 0.003 * size;
  const extent = 1.5 * sphere.radius;
  Object.assign(key.shadow.camera, {
    left: -extent, right: extent, top: extent, bottom: -extent, near: 0.5 * sphere.radius, far: 7 * sphere.radius,
  });
  const fill = new THREE.DirectionalLight("#ffffff", 0.55);
  fill.position.copy(sphere.center)
    .addScaledVector(basis.near, 2 * sphere.radius)
    .addScaledVector(basis.right, 3 * sphere.radius)
    .addScaledVector(basis.up, 0.6 * sphere.radius);
  fill.target.position.copy(sphere.center);
  scene.add(sky, key, key.target, fill, fill.target);

  // --- Camera
  const camera = new THREE.PerspectiveCamera(32, 1, sphere.radius / 100, 60 * sphere.radius);
  camera.up.copy(basis.up);
  camera.position.copy(sphere.center).addScaledVector(basis.near, 4 * sphere.radius);
  const controls = new OrbitControls(camera, canvas);
  controls.target.copy(sphere.center);
  controls.minDistance = 0.15 * sphere.radius;
  controls.maxDistance = 14 * sphere.radius;
  controls.zoomToCursor = true;

  const directions = {
    iso: () => basis.near.clone().multiplyScalar(1.2).addScaledVector(basis.right, 0.85).addScaledVector(basis.up, 0.72),
    top: () => basis.up.clone().addScaledVector(basis.near, 1e-4),
    front: () => basis.near.clone(),
    side: () => basis.right.clone(),
  };

  let dirty = true;
  let rendered = 0;
  let view = "iso"; // "" once the user has moved the camera
  let tween = null;
  let onView = () => {};

  /** Camera target and position from which everything framed fits the canvas. */
  function frame(name) {
    const out = directions[name]().normalize();
    const across = new THREE.Vector3().crossVectors(basis.up, out).normalize();
    const upward = new THREE.Vector3().crossVectors(out, across);
    // What the overlays cover is left free: more at the sides of a wide view, above and below on a narrow one.
    const tall = Math.tan(THREE.MathUtils.degToRad(camera.fov / 2));
    const limits = { x: 0.86 * tall * camera.aspect, y: (camera.aspect > 1 ? 0.82 : 0.66) * tall };
    const points = framed.map((p) => ({ x: p.dot(across), y: p.dot(upward), z: p.dot(out) }));
    const center = { x: sphere.center.dot(across), y: sphere.center.dot(upward) };
    let distance = 0; // of the camera from the origin, along `out`
    for (let turn = 0; turn < 12; turn += 1) {
      distance = Math.max(...points.map((p) => p.z + Math.max(Math.abs(p.x - center.x) / limits.x, Math.abs(p.y - center.y) / limits.y)));
      for (const axis of ["x", "y"]) {
        const slopes = points.map((p) => (p[axis] - center[axis]) / (distance - p.z));
        center[axis] += 0.5 * (Math.max(...slopes) + Math.min(...slopes)) * (distance - sphere.center.dot(out));
      }
    }
    const target = new THREE.Vector3().addScaledVector(across, center.x).addScaledVector(upward, center.y).addScaledVector(out, sphere.center.dot(out));
    return { target, position: target.clone().addScaledVector(out, distance - sphere.center.dot(out)) };
  }

  function setView(name, smooth = true) {
    const to = frame(name);
    view = name;
    onView(view);
    const from = { target: controls.target.clone(), position: camera.position.clone() };
    const still = window.matchMedia("(prefers-reduced-motion: reduce)").matches;
    if (smooth && !still) tween = { from, to, begin: performance.now(), span: 420 };
    else moveCamera(to);
  }
  function moveCamera({ target, position }) {
    tween = null;
    controls.target.copy(target);
    camera.position.copy(position);
    controls.update();
    dirty = true;
  }
  function advanceTween(now) {
    if (!tween) return;
    const ratio = Math.min(1, (now - tween.begin) / tween.span);
    const ease = ratio * ratio * (3 - 2 * ratio);
    const { from, to } = tween;
    if (ratio === 1) return void moveCamera(to);
    const target = from.target.clone().lerp(to.target, ease);
    const [a, b] = [from.position.clone().sub(from.target), to.position.clone().sub(to.target)];
    const [la, lb] = [a.length(), b.length()];
    const offset = a.divideScalar(la).lerp(b.divideScalar(lb), ease).normalize().multiplyScalar(la + (lb - la) * ease);
    const running = tween;
    moveCamera({ target, position: target.clone().add(offset) });
    tween = running;
  }
  controls.addEventListener("start", () => { tween = null; });
  controls.addEventListener("change", () => { dirty = true; });
  for (const gesture of ["pointermove", "wheel"]) {
    canvas.addEventListener(gesture, (event) => {
      if (gesture === "wheel" || event.buttons) { view = ""; onView(view); }
    }, { passive: true });
  }

  function resize() {
    const { clientWidth: width, clientHeight: height } = canvas;
    if (!width || !height) return;
    renderer.setPixelRatio(Math.min(2, window.devicePixelRatio || 1));
    renderer.setSize(width, height, false);
    camera.aspect = width / height;
    camera.updateProjectionMatrix();
    if (view) setView(view, false);
    dirty = true;
  }
  new ResizeObserver(resize).observe(canvas);
  resize();

  const drawAxes = createAxes(axesCanvas, camera, data.colors.axes);
  const pointer = new THREE.Vector2();
  const raycaster = new THREE.Raycaster();
  const groups = { obstacles: bodies.filter((body) => body.kind === "obstacle").map((body) => body.mesh), paths: [paths], grid: [grid] };

  place(motion.start);

  return {
    gridLabel: `Grid ${printLength(step)}`,
    setTime(time) { place(time); dirty = true; },
    /** Show what stands out in the phase with this index; -1 for none. */
    setPhase(index) { marks.show(index); dirty = true; },
    marks: () => marks.list(),
    /** World position of both ends of a cable as drawn; null for an unknown name. */
    endsOf(name) {
      const cable = cables.rods.find((candidate) => candidate.name === name);
      return cable ? [-0.5, 0.5].map((y) => new THREE.Vector3(0, y, 0).applyMatrix4(cable.mesh.matrixWorld).toArray()) : null;
    },
    setView,
    show(group, visible) { for (const object of groups[group]) object.visible = visible; dirty = true; },
    has: (group) => group === "grid" || (group === "paths" ? data.paths.length > 0 : groups[group].length > 0),
    onView(callback) { onView = callback; callback(view); },
    /** Name of the body or cable under a point of the canvas, in pixels; "" for none. */
    pick(x, y) {
      pointer.set((2 * x) / canvas.clientWidth - 1, 1 - (2 * y) / canvas.clientHeight);
      raycaster.setFromCamera(pointer, camera);
      const solids = [...bodies, ...cables.rods].map(({ mesh }) => mesh).filter((mesh) => mesh.visible);
      const hit = raycaster.intersectObjects(solids, false)[0];
      return hit ? hit.object.name : "";
    },
    /** World pose of a body as 16 numbers, row by row; null for an unknown name. */
    poseOf(name) {
      const body = bodies.find((candidate) => candidate.name === name);
      return body ? body.mesh.matrixWorld.clone().transpose().toArray() : null;
    },
    rendered: () => rendered,
    draw(now) {
      advanceTween(now);
      if (!dirty) return;
      dirty = false;
      renderer.render(scene, camera);
      drawAxes();
      rendered += 1;
    },
  };
}

/** The small cross that says where x, y and z point. */
function createAxes(canvas, camera, colors) {
  const ratio = Math.min(2, window.devicePixelRatio || 1);
  canvas.width = 76 * ratio;
  canvas.height = 76 * ratio;
  const pen = canvas.getContext("2d");
  return () => {
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    pen.clearRect(0, 0, 76, 76);
    const inverse = camera.quaternion.clone().invert();
    const arms = Object.entries(AXES).map(([name, axis]) => ({ name, tip: axis.clone().applyQuaternion(inverse) }));
    arms.sort((a, b) => a.tip.z - b.tip.z);
    for (const { name, tip } of arms) {
      const [x, y] = [38 + 24 * tip.x, 38 - 24 * tip.y];
      pen.strokeStyle = pen.fillStyle = colors[name];
      pen.lineWidth = 2.2;
      pen.lineCap = "round";
      pen.beginPath();
      pen.moveTo(38, 38);
      pen.lineTo(x, y);
      pen.stroke();
      if (Math.hypot(tip.x, tip.y) < 0.15) continue; // points at the viewer: a letter would hide the others
      pen.font = "600 12px system-ui, sans-serif";
      pen.textAlign = "center";
      pen.textBaseline = "middle";
      pen.fillText(name, 38 + 33 * tip.x, 38 - 33 * tip.y);
    }
  };
}
