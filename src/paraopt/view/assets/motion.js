// Decode what page.py packs, and give poses and quantities between samples.

/** Turn base64 of little-endian 32-bit floats into a Float32Array. */
export function decode(text) {
  const bytes = Uint8Array.from(atob(text), (character) => character.charCodeAt(0));
  const view = new DataView(bytes.buffer);
  return Float32Array.from({ length: bytes.length / 4 }, (_, i) => view.getFloat32(4 * i, true));
}

/** Build the motion: `at(time)` finds the samples around an instant [s], `pose(frame, at, out)` the pose there. */
export function createMotion(data) {
  const times = decode(data.times);
  const poses = decode(data.poses);
  const { count, frames } = data;

  function at(time) {
    if (count === 1 || time <= times[0]) return { index: 0, next: 0, ratio: 0 };
    if (time >= times[count - 1]) return { index: count - 1, next: count - 1, ratio: 0 };
    let low = 0;
    let high = count - 1;
    while (high - low > 1) {
      const middle = (low + high) >> 1;
      if (times[middle] <= time) low = middle;
      else high = middle;
    }
    return { index: low, next: high, ratio: (time - times[low]) / (times[high] - times[low]) };
  }

  /** Write x y z and the quaternion x y z w of a frame into `out` (7 numbers). */
  function pose(frame, { index, next, ratio }, out) {
    const a = 7 * (index * frames + frame);
    const b = 7 * (next * frames + frame);
    for (let i = 0; i < 3; i += 1) out[i] = poses[a + i] + ratio * (poses[b + i] - poses[a + i]);
    let cosine = 0;
    for (let i = 3; i < 7; i += 1) cosine += poses[a + i] * poses[b + i];
    const sign = cosine < 0 ? -1 : 1;
    const angle = Math.acos(Math.min(1, Math.abs(cosine)));
    // Below a thousandth of a radian the chord is the arc to single precision.
    const wa = angle < 1e-3 ? 1 - ratio : Math.sin((1 - ratio) * angle) / Math.sin(angle);
    const wb = sign * (angle < 1e-3 ? ratio : Math.sin(ratio * angle) / Math.sin(angle));
    let norm = 0;
    for (let i = 3; i < 7; i += 1) {
      out[i] = wa * poses[a + i] + wb * poses[b + i];
      norm += out[i] * out[i];
    }
    norm = Math.sqrt(norm);
    for (let i = 3; i < 7; i += 1) out[i] /= norm;
    return out;
  }

  return { times, count, frames, start: times[0], end: times[count - 1], at, pose };
}

/** Interpolate one value per sample. */
export function interpolate(values, { index, next, ratio }) {
  return values[index] + ratio * (values[next] - values[index]);
}

/** The largest of 1, 2 or 5 times a power of ten that is not above the value. */
export function niceStep(value) {
  const power = 10 ** Math.floor(Math.log10(value));
  const lead = value / power;
  return (lead >= 5 ? 5 : lead >= 2 ? 2 : 1) * power;
}

/** Print a length in the unit a person would choose. */
export function printLength(metres) {
  if (metres >= 1) return `${Number(metres.toPrecision(3))} m`;
  return `${Number((1000 * metres).toPrecision(3))} mm`;
}
