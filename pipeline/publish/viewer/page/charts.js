// What was heard and felt, drawn.
import { drawn, element } from "./elements.js";

const [WIDTH, HEIGHT, LEFT, BOTTOM] = [320, 120, 4, 18];
const [LOWEST_HZ, HIGHEST_HZ, RANGE_DB] = [50, 20000, 60];
const ROWS = 6;
// ln(1000): the amplitude has fallen by 60 dB.
const T60 = Math.log(1000);

const hertz = (value) => (value < 1000 ? `${value.toFixed(1)} Hz` : `${(value / 1000).toFixed(3)} kHz`);
const seconds = (value) => (value < 1 ? `${Math.round(value * 1000)} ms` : `${value.toFixed(2)} s`);

// In dB, but for a constant: the square of the level over twice the decay.
const energy = ({ level, decay }) => level - 10 * Math.log10(Math.max(decay, 1e-3));

// Partials {hz, decay (1/s), level (dB below the highest, at the start)}, those of most energy first.
export function partials(frequencies, dampings, amplitudes, sampleRate) {
  const strongest = Math.max(...amplitudes.map(Math.abs), 0);
  if (!strongest) return [];
  return amplitudes
    .map((amplitude, mode) => ({
      hz: frequencies[mode], decay: dampings[mode], level: 20 * Math.log10(Math.abs(amplitude) / strongest),
    }))
    .filter(({ hz, level }) => hz > 0 && hz <= 0.454 * sampleRate && level > -120)
    .sort((a, b) => energy(b) - energy(a));
}

// A line a partial over the logarithm of its frequency; the fainter, the sooner it dies away.
export function spectrum(found) {
  const across = (hz) =>
    LEFT + ((WIDTH - 2 * LEFT) * Math.log(hz / LOWEST_HZ)) / Math.log(HIGHEST_HZ / LOWEST_HZ);
  const picture = drawn("svg", {
    viewBox: `0 0 ${WIDTH} ${HEIGHT}`, role: "img", class: "player-spectrum",
    "aria-label": `${found.length} partials, the strongest at ${found.slice(0, 3).map(({ hz }) => hertz(hz)).join(", ")}`,
  });
  for (const hz of [100, 1000, 10000]) {
    picture.append(
      drawn("line", { x1: across(hz), x2: across(hz), y1: 0, y2: HEIGHT - BOTTOM, class: "player-grid" }),
      drawn("text", { x: across(hz), y: HEIGHT - 4, "text-anchor": "middle" }, hz < 1000 ? `${hz} Hz` : `${hz / 1000} kHz`),
    );
  }
  for (const { hz, decay, level } of found) {
    if (level < -RANGE_DB || hz < LOWEST_HZ) continue;
    const top = (-level / RANGE_DB) * (HEIGHT - BOTTOM);
    const faint = Math.min(1, Math.max(0.35, 0.35 + 0.35 * Math.log10(1 + (T60 / decay) * 10)));
    picture.append(
      drawn("line", { x1: across(hz), x2: across(hz), y1: top, y2: HEIGHT - BOTTOM, class: "player-line", opacity: faint }),
    );
  }
  picture.append(drawn("line", { x1: 0, x2: WIDTH, y1: HEIGHT - BOTTOM, y2: HEIGHT - BOTTOM, class: "player-axis" }));
  return picture;
}

export function partialsTable(found) {
  const cell = (text) => element("td", {}, text);
  const rows = found.slice(0, ROWS).map(({ hz, decay, level }) =>
    element("tr", {}, cell(hertz(hz)), cell(decay > 0 ? seconds(T60 / decay) : "endless"), cell(`${level.toFixed(1)} dB`)),
  );
  const heads = ["frequency", "T60", "level at first"].map((name) => element("th", { scope: "col" }, name));
  return element(
    "table", {}, element("caption", {}, "Partials of most energy"),
    element("thead", {}, element("tr", {}, ...heads)), element("tbody", {}, ...rows),
  );
}

// A canvas of RGBA bytes.
export function picture({ width, height, rgba }, label) {
  const canvas = element("canvas", { width, height, role: "img", "aria-label": label });
  canvas.getContext("2d").putImageData(new ImageData(rgba, width, height), 0, 0);
  return canvas;
}

// Depths (m) as RGBA: paper where the gel is free, deeper blue the deeper.
export function depthColours(depth) {
  const deepest = Math.max(...depth, 1e-9);
  const rgba = new Uint8ClampedArray(4 * depth.length);
  depth.forEach((value, pixel) => {
    const share = Math.max(0, value) / deepest;
    const shade = value > 0 ? 0.15 + 0.85 * share : 0;
    rgba.set([250 - 225 * shade, 250 - 180 * shade, 248 - 110 * shade, 255], 4 * pixel);
  });
  return rgba;
}

export function pressWords({ reachable, penetration_m, contact_area_m2 }) {
  if (!reachable) return "The sensor cannot reach that place: another part of the object is in its way.";
  return `Pressed in by ${(penetration_m * 1000).toFixed(2)} mm; contact ${(contact_area_m2 * 1e6).toFixed(1)} mm².`;
}
