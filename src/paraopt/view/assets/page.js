// The page: clock, controls, legend. Where WebGL is missing, playback and charts go on without the view.
import { createMotion } from "paraopt/motion";
import { createCharts, createPhases } from "paraopt/charts";
import { createStage } from "paraopt/stage";

const END_PAUSE = 0.7; // s of rest at the goal before the motion starts again
const byId = (id) => document.getElementById(id);
const data = JSON.parse(byId("data").textContent);
const motion = createMotion(data);
const duration = motion.end - motion.start;

let stage = null;
let failure = "";
try {
  stage = createStage(byId("view"), byId("axes"), data, motion);
} catch (error) {
  const probe = document.createElement("canvas");
  failure = probe.getContext("webgl2") ? String(error.message || error) :
    "This browser offers no WebGL 2. Switch on hardware acceleration or open the page in another browser.";
  showFailure(failure);
}

// --- Clock
let time = motion.start;
let playing = false;
let looping = true;
let speed = 1;
let rest = 0;
const decimals = duration < 1 ? 3 : 2;
const strip = createPhases(byId("phases"), byId("phase"), data.phases, motion, (instant) => { setPlaying(false); seek(instant); });
const charts = createCharts(byId("readouts"), data, motion, (instant) => { setPlaying(false); seek(instant); });

function seek(instant) {
  time = Math.min(motion.end, Math.max(motion.start, Number(instant)));
  rest = 0;
  stage?.setPhase(strip(time));
  stage?.setTime(time);
  charts(time);
  byId("scrubber").value = duration ? (1000 * (time - motion.start)) / duration : 0;
  byId("clock").replaceChildren(time.toFixed(decimals), Object.assign(document.createElement("span"), { textContent: ` / ${motion.end.toFixed(decimals)} s` }));
}
function setPlaying(value) {
  playing = value && duration > 0;
  if (playing && time >= motion.end) seek(motion.start);
  document.body.classList.toggle("playing", playing);
  byId("play").setAttribute("aria-label", playing ? "Pause" : "Play");
}
function setLooping(value) {
  looping = value;
  byId("loop").setAttribute("aria-pressed", String(looping));
}
function advance(seconds) {
  if (!playing) return;
  if (time < motion.end) {
    seek(time + seconds * speed);
    return;
  }
  rest += seconds;
  if (!looping) setPlaying(false);
  else if (rest >= END_PAUSE) seek(motion.start);
}

// --- Legend
const legend = byId("legend");
function addLegend(label, mark, color, group) {
  const item = document.createElement("li");
  const sign = document.createElement("span");
  sign.className = mark;
  sign.style[mark.startsWith("stroke") ? "borderTopColor" : "background"] = color;
  item.append(sign, label);
  item.dataset.group = group;
  legend.append(item);
}
for (const [kind, { label, color }] of Object.entries(data.kinds)) {
  if (data.bodies.some((body) => body.kind === kind)) addLegend(label, "swatch", color, kind === "obstacle" ? "obstacles" : "");
}
for (const [label, color] of new Map(data.cables.map((cable) => [cable.label, cable.color]))) addLegend(label, "stroke", color, "");
const labels = new Map(data.phases.flatMap((phase) => phase.marks.map(({ label, color }) => [label, color])));
for (const [label, color] of labels) addLegend(label, "ball", color, "");
for (const path of data.paths) addLegend(path.name, path.dashed ? "stroke dashed" : "stroke", path.color, "paths");

// --- Controls
const toggles = [...document.querySelectorAll("[data-toggle]")];
function toggle(group) {
  const button = toggles.find((candidate) => candidate.dataset.toggle === group);
  if (!button?.isConnected) return;
  const visible = button.getAttribute("aria-pressed") !== "true";
  button.setAttribute("aria-pressed", String(visible));
  stage?.show(group, visible);
  for (const item of legend.children) if (item.dataset.group === group) item.classList.toggle("off", !visible);
}
for (const button of toggles) {
  if (!stage?.has(button.dataset.toggle)) button.remove();
  button.addEventListener("click", () => toggle(button.dataset.toggle));
}
const views = [...document.querySelectorAll("[data-view]")];
for (const button of views) button.addEventListener("click", () => stage?.setView(button.dataset.view));
stage?.onView((name) => {
  for (const button of views) button.setAttribute("aria-pressed", String(button.dataset.view === name));
});
if (stage) byId("scale").textContent = stage.gridLabel;
else byId("tools").hidden = legend.hidden = true;

byId("play").addEventListener("click", () => setPlaying(!playing));
byId("loop").addEventListener("click", () => setLooping(!looping));
byId("speed").addEventListener("change", (event) => { speed = Number(event.target.value); });
byId("scrubber").addEventListener("input", (event) => {
  setPlaying(false);
  seek(motion.start + (duration * event.target.value) / 1000);
});
byId("transport").hidden = duration === 0;

// After a click the keyboard belongs to the page again; who walks by Tab keeps the focus.
document.addEventListener("pointerup", () => {
  if (document.activeElement?.matches("button, input")) document.activeElement.blur();
});
document.addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.metaKey || event.altKey) return;
  if (event.target.closest?.("select") || (event.key === " " && event.target.closest?.("button"))) return;
  const stepSize = duration / 100;
  const actions = {
    " ": () => setPlaying(!playing),
    ArrowLeft: () => { setPlaying(false); seek(time - stepSize); },
    ArrowRight: () => { setPlaying(false); seek(time + stepSize); },
    Home: () => seek(motion.start),
    End: () => seek(motion.end),
    l: () => setLooping(!looping),
    o: () => toggle("obstacles"),
    p: () => toggle("paths"),
    g: () => toggle("grid"),
    1: () => stage?.setView("iso"),
    2: () => stage?.setView("top"),
    3: () => stage?.setView("front"),
    4: () => stage?.setView("side"),
  };
  const action = actions[event.key.length === 1 ? event.key.toLowerCase() : event.key];
  if (!action || (event.repeat && event.key === " ")) return;
  event.preventDefault();
  action();
});

const hover = byId("hover");
byId("view").addEventListener("pointermove", (event) => {
  const name = event.buttons || event.pointerType === "touch" ? "" : stage?.pick(event.offsetX, event.offsetY);
  hover.hidden = !name;
  hover.textContent = name ?? "";
  hover.style.left = `${event.offsetX}px`;
  hover.style.top = `${event.offsetY}px`;
});
byId("view").addEventListener("pointerleave", () => { hover.hidden = true; });

// --- Run
let last = performance.now();
function tick(now) {
  advance(Math.min(0.25, Math.max(0, (now - last) / 1000)));
  last = now;
  stage?.draw(now);
  requestAnimationFrame(tick);
}
seek(motion.start);
stage?.draw(last);
setPlaying(!window.matchMedia("(prefers-reduced-motion: reduce)").matches);
requestAnimationFrame(tick);

/** What a test holds on to. */
window.paraopt = {
  ready: stage !== null,
  failure,
  start: motion.start,
  end: motion.end,
  get time() { return time; },
  get playing() { return playing; },
  /** Pictures drawn so far. */
  get frame() { return stage ? stage.rendered() : 0; },
  /** Pause, and show the motion at an instant [s]. */
  seek(instant) { setPlaying(false); seek(instant); stage?.draw(performance.now()); },
  play() { setPlaying(true); },
  pause() { setPlaying(false); },
  /** "iso", "top", "front" or "side", at once. */
  setView(name) { stage?.setView(name, false); stage?.draw(performance.now()); },
  toggle,
  /** World pose of a body as drawn: 16 numbers, row by row. */
  poseOf(name) { return stage ? stage.poseOf(name) : null; },
  /** World position of both ends of a cable as drawn: two times x, y, z. */
  endsOf(name) { return stage ? stage.endsOf(name) : null; },
  /** Name of the phase that is shown, "" for none. */
  get phase() { return data.phases[strip(time)]?.name ?? ""; },
  /** What stands out now: label, color, point in the world or null, names of coloured bodies. */
  marks() { return stage ? stage.marks() : []; },
};
