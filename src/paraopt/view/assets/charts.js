// Live numbers and small charts of quantities along time.
import { decode, interpolate } from "paraopt/motion";

const WIDTH = 1000; // units of a chart's own coordinates; it stretches to its card
const HEIGHT = 100;
const COLUMNS = 400; // buckets of a long series, each drawn by its extremes

function element(tag, className, parent, text = "") {
  const node = document.createElement(tag);
  node.className = className;
  node.textContent = text;
  parent.append(node);
  return node;
}

function path(className, parent, d) {
  const node = document.createElementNS("http://www.w3.org/2000/svg", "path");
  node.setAttribute("class", className);
  node.setAttribute("d", d);
  parent.append(node);
}

/** Decimals that show three figures of the largest value. */
function decimalsFor(values) {
  const largest = values.reduce((most, value) => Math.max(most, Math.abs(value)), 0);
  if (largest === 0) return 1;
  return Math.min(6, Math.max(largest < 1000 ? 1 : 0, 2 - Math.floor(Math.log10(largest))));
}

/** Indices to draw: all of a short series; of a long one the least and the greatest of every bucket. */
function pickSamples(values) {
  const n = values.length;
  if (n <= 2 * COLUMNS) return Array.from({ length: n }, (_, i) => i);
  const picked = new Set([0, n - 1]);
  for (let column = 0; column < COLUMNS; column += 1) {
    let low = Math.floor((column * n) / COLUMNS);
    let high = low;
    for (let i = low; i < Math.floor(((column + 1) * n) / COLUMNS); i += 1) {
      if (values[i] < values[low]) low = i;
      if (values[i] > values[high]) high = i;
    }
    picked.add(low).add(high);
  }
  return [...picked].sort((a, b) => a - b);
}

/**
 * Build the strip of the phases and the line that names the present one. Returns the function that moves both to an
 * instant and gives the index of the phase there, -1 for none. `seek(time)` is called when a phase is chosen.
 */
export function createPhases(container, title, phases, motion, seek) {
  const span = motion.end - motion.start || 1;
  const parts = phases.map((phase) => {
    const part = element("button", "phase", container, phase.name);
    part.type = "button";
    part.title = `${phase.name}: ${phase.begin.toFixed(2)} to ${phase.end.toFixed(2)} s`;
    const [from, to] = [phase.begin, phase.end].map((time) => Math.min(1, Math.max(0, (time - motion.start) / span)));
    part.style.left = `${100 * from}%`;
    part.style.width = `${100 * (to - from)}%`;
    part.addEventListener("click", () => seek(phase.begin));
    return part;
  });
  container.hidden = title.hidden = !phases.length;
  let shown = -2;
  return (time) => {
    // The later of two that meet; the last one holds its end, too.
    let index = phases.findLastIndex((phase) => phase.begin <= time + 1e-9);
    if (index >= 0 && time > phases[index].end + 1e-9) index = -1;
    if (index !== shown) {
      parts[shown]?.removeAttribute("aria-current");
      parts[index]?.setAttribute("aria-current", "step");
      title.textContent = phases[index]?.name ?? "";
      shown = index;
    }
    return index;
  };
}

/** Build the cards; returns the function that moves their cursors. `seek(time)` is called while one is dragged. */
export function createCharts(container, data, motion, seek) {
  const span = motion.end - motion.start || 1;
  const cards = data.readouts.map((readout) => {
    const values = decode(readout.values);
    const decimals = decimalsFor(values);
    const print = (value) => {
      const text = value.toFixed(decimals);
      return (Number(text) === 0 ? (0).toFixed(decimals) : text).replace("-", "\u2212");
    };
    const upper = readout.side === "upper";
    const bounded = readout.bound !== null;

    // The scale holds the curve and its bound.
    let [low, high] = [Infinity, -Infinity];
    let extreme = 0; // the sample nearest to its bound
    values.forEach((value, i) => {
      low = Math.min(low, value);
      high = Math.max(high, value);
      if (upper ? value > values[extreme] : value < values[extreme]) extreme = i;
    });
    if (bounded) [low, high] = [Math.min(low, readout.bound), Math.max(high, readout.bound)];
    const pad = 0.08 * (high - low) || 0.1 * Math.abs(high) || 1;
    [low, high] = [low - pad, high + pad];
    const x = (time) => (time - motion.start) / span;
    const y = (value) => (high - value) / (high - low);

    const card = element("article", "readout", container);
    const head = element("div", "head", card);
    const name = element("h2", "", head, readout.name);
    name.title = readout.name;
    const value = element("div", "value", head);
    const number = element("span", "", value);
    if (readout.unit) element("small", "", value, readout.unit);

    const chart = element("div", "chart", card);
    const svg = document.createElementNS("http://www.w3.org/2000/svg", "svg");
    svg.setAttribute("viewBox", `0 0 ${WIDTH} ${HEIGHT}`);
    svg.setAttribute("preserveAspectRatio", "none");
    svg.setAttribute("aria-hidden", "true");
    chart.append(svg);
    const line = pickSamples(values).map((i) => `${(WIDTH * x(motion.times[i])).toFixed(1)} ${(HEIGHT * y(values[i])).toFixed(2)}`);
    if (line.length === 1) line.push(line[0].replace(/^\S+/, String(WIDTH)));
    path("axis", svg, `M0 ${HEIGHT}H${WIDTH}`);
    path("area", svg, `M0 ${HEIGHT}L${line.join("L")}L${WIDTH} ${HEIGHT}Z`);
    path("curve", svg, `M${line.join("L")}`);
    if (bounded) path("bound", svg, `M0 ${(HEIGHT * y(readout.bound)).toFixed(2)}H${WIDTH}`);

    const put = (node, time, level) => {
      node.style.left = `${100 * x(time)}%`;
      if (level !== undefined) node.style.top = `${100 * y(level)}%`;
    };
    put(element("div", "extreme", chart), motion.times[extreme], values[extreme]);
    const cursor = element("div", "cursor", chart);
    const dot = element("div", "dot", chart);
    const foot = element("div", "foot", card);
    element("span", "", foot, `${upper ? "max" : "min"} ${print(values[extreme])} at ${motion.times[extreme].toFixed(2)} s`);
    const amount = bounded ? String(Number(readout.bound.toPrecision(4))).replace("-", "\u2212") : "";
    const limit = bounded ? element("span", "limit", foot) : null;
    let violated = null;

    const drag = (event) => {
      const { left, width } = chart.getBoundingClientRect();
      seek(motion.start + span * Math.min(1, Math.max(0, (event.clientX - left) / width)));
    };
    chart.addEventListener("pointerdown", (event) => { chart.setPointerCapture(event.pointerId); drag(event); });
    chart.addEventListener("pointermove", (event) => { if (event.buttons & 1) drag(event); });

    return (time, at) => {
      const now = interpolate(values, at);
      number.textContent = print(now);
      put(cursor, time);
      put(dot, time, now);
      // Values travel as 32-bit floats: a value on its bound is not outside.
      const slack = 1e-6 * Math.max(Math.abs(now), Math.abs(readout.bound ?? 0));
      const outside = bounded && (upper ? now - readout.bound : readout.bound - now) > slack;
      if (bounded && outside !== violated) {
        violated = outside;
        card.classList.toggle("violated", outside);
        limit.textContent = `${outside ? (upper ? "above" : "below") : upper ? "\u2264" : "\u2265"} ${amount}`;
      }
    };
  });
  // As many columns as fit, then no more than the rows need: seven cards stand as four and three.
  const arrange = () => {
    const most = Math.max(1, Math.floor(container.clientWidth / 205));
    const columns = Math.ceil(cards.length / Math.ceil(cards.length / most));
    container.style.gridTemplateColumns = `repeat(${columns}, minmax(0, 1fr))`;
  };
  if (cards.length) {
    new ResizeObserver(arrange).observe(container);
    arrange();
  }
  return (time) => {
    const at = motion.at(time);
    for (const update of cards) update(time, at);
  };
}
