// Sounds of struck points, truth and Object File, from their modes, and pictures of both and of their difference.
import { sounding } from "./stored_modes.js";

export const RATE = 44100;
const LONGEST_S = 1;
const FADE_S = 0.01;
const PEAK = 0.9;
const WINDOW = 1024;
const PICTURED_S = 0.5;
const SIZE = 96;
const [LOWEST_HZ, HIGHEST_HZ, RANGE_DB] = [80, 20000, 80];

const KINDS = {
  recursions: Float64Array,
  palette: Uint8Array,
  truth: Int16Array,
  difference: Int8Array,
  steps: Float32Array,
  differences_db: Float32Array,
  points_mm: Float32Array,
  axes: Uint8Array,
};

const decoded = (text, Kind) => new Kind(Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0)).buffer);

// Arrays of the held-out strikes, worst first, by name; the file beside the page has them.
export const load = (address) =>
  new Promise((resolve, reject) => {
    const script = Object.assign(document.createElement("script"), { src: address });
    script.addEventListener("load", () => {
      const texts = Object.entries(window.objectfolderStrikes);
      resolve(Object.fromEntries(texts.map(([name, text]) => [name, decoded(text, KINDS[name])])));
    });
    script.addEventListener("error", () => reject(new Error(`${address} beside this page could not be read.`)));
    document.head.append(script);
  });

const amplitudes = ({ truth, difference, steps, axes }, rank) => {
  const [count, strikes] = [truth.length / axes.length, axes.length];
  const [wanted, apart] = [truth, difference].map((all, which) =>
    Float64Array.from(all.subarray(rank * count, (rank + 1) * count), (n) => n * steps[which * strikes + rank]),
  );
  return [wanted, wanted.map((value, mode) => value + apart[mode])];
};

export const factsOf = ({ differences_db, points_mm, axes }, rank) => {
  const number = (value) => (Number.isFinite(value) ? value.toFixed(1).replace("-", "−") : "–");
  const place = [...points_mm.subarray(3 * rank, 3 * rank + 3)].map((x, axis) => ["xyz"[axis], number(x), "mm"]);
  return [
    ["difference", number(differences_db[rank]), "dB of the truth's energy"],
    [`impulse along ${"xyz"[axes[rank]]}`, "1", "N s"],
    ...place,
  ];
};

// A second of modes, whose recursions lie one after the other, with an end that does not click.
const synthesised = (recursions, amplitudes) => {
  const rows = Array.from(amplitudes, (_, mode) => recursions.subarray(4 * mode, 4 * mode + 4));
  const sound = sounding(rows, amplitudes, LONGEST_S * RATE);
  const fade = FADE_S * RATE;
  for (let n = 0; n < fade; n += 1) sound[sound.length - 1 - n] *= n / fade;
  return sound;
};

// In-place transform of two real signals as one complex one; radix 2.
const transform = (real, imaginary) => {
  const n = real.length;
  for (let i = 1, j = 0; i < n; i += 1) {
    let bit = n >> 1;
    for (; j & bit; bit >>= 1) j ^= bit;
    j ^= bit;
    if (i < j) for (const part of [real, imaginary]) [part[i], part[j]] = [part[j], part[i]];
  }
  for (let half = 1; half < n; half *= 2) {
    for (let k = 0; k < half; k += 1) {
      const [cos, sin] = [Math.cos((Math.PI * k) / half), -Math.sin((Math.PI * k) / half)];
      for (let i = k; i < n; i += 2 * half) {
        const j = i + half;
        const [x, y] = [cos * real[j] - sin * imaginary[j], sin * real[j] + cos * imaginary[j]];
        [real[j], imaginary[j]] = [real[i] - x, imaginary[i] - y];
        [real[i], imaginary[i]] = [real[i] + x, imaginary[i] + y];
      }
    }
  }
};

// Magnitudes of both sounds and of their difference, (3, SIZE rows from low to high, SIZE columns).
const magnitudes = (truth, answer) => {
  const found = new Float64Array(3 * SIZE * SIZE);
  const edges = Array.from({ length: SIZE + 1 }, (_, row) => {
    return (LOWEST_HZ * (HIGHEST_HZ / LOWEST_HZ) ** (row / SIZE) * WINDOW) / RATE;
  });
  for (let column = 0; column < SIZE; column += 1) {
    const start = Math.round((column * PICTURED_S * RATE) / (SIZE - 1));
    const [real, imaginary] = [truth, answer].map((sound) =>
      Float64Array.from({ length: WINDOW }, (_, n) => {
        return (sound[start + n] ?? 0) * (0.5 - 0.5 * Math.cos((2 * Math.PI * n) / (WINDOW - 1)));
      }),
    );
    transform(real, imaginary);
    for (let row = 0; row < SIZE; row += 1) {
      // A row takes the strongest bin it spans, so that a narrow partial stays visible between rows.
      const low = Math.floor(edges[row]);
      const high = Math.max(Math.ceil(edges[row + 1]), low + 1);
      for (let k = low; k < high; k += 1) {
        const [x, y, u, v] = [real[k], imaginary[k], real[WINDOW - k], imaginary[WINDOW - k]];
        const [first, second] = [
          [x + u, y - v],
          [y + v, u - x],
        ];
        const parts = [first, second, [second[0] - first[0], second[1] - first[1]]];
        parts.forEach(([re, im], which) => {
          const at = (which * SIZE + row) * SIZE + column;
          found[at] = Math.max(found[at], Math.hypot(re, im) / 2);
        });
      }
    }
  }
  return found;
};

// Three pictures as data URIs, one scale for all.
const pictures = (truth, answer, palette) => {
  const found = magnitudes(truth, answer);
  const loudest = found.reduce((most, value) => Math.max(most, value), 0) || 1;
  const shades = palette.length / 3;
  return [0, 1, 2].map((which) => {
    const canvas = Object.assign(document.createElement("canvas"), { width: SIZE, height: SIZE });
    const context = canvas.getContext("2d");
    const drawn = context.createImageData(SIZE, SIZE);
    for (let row = 0; row < SIZE; row += 1) {
      for (let column = 0; column < SIZE; column += 1) {
        const share = found[(which * SIZE + row) * SIZE + column] / loudest;
        const level = Math.max(0, 1 + (20 * Math.log10(share)) / RANGE_DB);
        const shade = 3 * Math.round(level * (shades - 1));
        const at = 4 * ((SIZE - 1 - row) * SIZE + column);
        drawn.data.set([...palette.subarray(shade, shade + 3), 255], at);
      }
    }
    context.putImageData(drawn, 0, 0);
    return canvas.toDataURL();
  });
};

// Sounds of a strike, scaled by one factor, and their pictures.
export const soundsOf = (strikes, rank) => {
  const { recursions, palette } = strikes;
  const own = recursions.length / 2;
  const sounds = amplitudes(strikes, rank).map((of, which) =>
    synthesised(recursions.subarray(which * own, (which + 1) * own), of),
  );
  const peak = Math.max(...sounds.map((one) => one.reduce((most, value) => Math.max(most, Math.abs(value)), 0)));
  const gain = peak > 0 ? PEAK / peak : 1;
  const scaled = sounds.map((one) => one.map((value) => gain * value));
  return { gain, sounds: scaled, pictures: pictures(...scaled, palette) };
};
