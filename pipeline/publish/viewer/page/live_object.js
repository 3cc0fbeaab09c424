// An object behind `objectfolder view`, as `panel.js` asks it: the Object File answers every question itself.
import { ask, paint } from "./asking.js";
import { depthColours, pressWords } from "./charts.js";
import { pushOf } from "./contact.js";

const COARSE = { resolution: 128, sub_rays: 4 };
const COARSEST = { resolution: 64, sub_rays: 4 };
const SLOW_MS = 80;
// Shown one after the other while nothing moves; the first within a tenth of a second.
const RESTING = [
  { resolution: 128, sub_rays: 4 }, { resolution: 256, sub_rays: 4 }, { resolution: 512, sub_rays: 4, parts: 8 },
  { resolution: 512, sub_rays: null, parts: 16 },
];

// Parts of an image that are asked for at the same time: browsers keep two more connections for sounds.
const AT_ONCE = 4;

export class LiveObject {
  static async open() {
    return new LiveObject((await ask("object", {})).header);
  }

  constructor(facts) {
    this.facts = facts;
    this.coarse = COARSE;
  }

  attach(canvas) {
    this.canvas = canvas;
    this.context = canvas.getContext("2d");
  }

  // Asks only for the newest view; at rest for finer and finer images until the view changes.
  draw(orbit, moving, shown) {
    this.wanted = {
      view: { camera_to_world: orbit.cameraToWorld(), light_position: orbit.lightPosition(), studio: orbit.studio }, moving, shown,
    };
    this.canvas.dataset.state = "drawing";
    this.unneeded?.abort();
    if (!this.busy) this._drawWanted();
  }

  async _drawWanted() {
    this.busy = true;
    try {
      while (this.wanted) {
        const { view, moving, shown } = this.wanted;
        this.wanted = null;
        const stages = moving ? [this.coarse] : RESTING;
        for (const stage of stages) {
          await this._image(view, stage, shown, !moving && stage !== stages.at(-1));
          if (this.wanted) break;
        }
        if (!this.wanted) this.canvas.dataset.state = moving ? "coarse" : "rest";
      }
    } catch (error) {
      this.wanted = null;
      this.canvas.dataset.state = "failed";
      this.failed?.(error);
    } finally {
      this.busy = false;
    }
  }

  // Asks for the image in parts of equal height. Of a fine one the program drops those that wait when another view
  // is wanted; a coarse one is shown first, or a view that turns would never be seen.
  async _image(view, { resolution, sub_rays, parts = 1 }, shown, unfinished = false) {
    const start = performance.now();
    const rgb = new Uint8Array(3 * resolution ** 2);
    const high = resolution / parts;
    let next = 0;
    this.unneeded = parts > 1 ? new AbortController() : null;
    const signal = this.unneeded?.signal;
    const fill = async () => {
      while (next < resolution && !(next && this.wanted)) {
        const row = next;
        next += high;
        const { payload } = await ask("render", { ...view, resolution, sub_rays, rows: [row, high] }, signal);
        rgb.set(new Uint8Array(payload), 3 * resolution * row);
      }
    };
    await Promise.all(Array.from({ length: AT_ONCE }, fill)).catch((error) => {
      if (!signal?.aborted) throw error;
    });
    if (next < resolution || signal?.aborted) return;
    paint(this.context, resolution, resolution, rgb);
    const took = performance.now() - start;
    if (resolution <= COARSE.resolution) this.coarse = took > SLOW_MS ? COARSEST : COARSE;
    this.canvas.dispatchEvent(new CustomEvent("player:drawn", { bubbles: true, detail: { resolution, sub_rays, took } }));
    const size = `${resolution} × ${resolution}`;
    shown({ resolution, note: unfinished ? `${size}, rendering …` : `${size}, ${Math.round(took)} ms` });
  }

  async strike(orbit, x, y, { impulse, along, duration, sampleRate }) {
    const ray = orbit.ray(x, y);
    const push = along === "normal" ? null : pushOf(along, null, ray.direction);
    const { header, payload } = await ask("strike", { ...ray, impulse, along: push, duration, sample_rate: sampleRate });
    if (header.missed) return null;
    const partials = () => ask("partials", { point: header.point, impulse: header.impulse });
    return { ...header, sampleRate, sound: new Float32Array(payload), partials: async () => (await partials()).header.amplitudes };
  }

  async press(orbit, x, y, asked) {
    const { header, payload } = await ask("press", { ...orbit.ray(x, y), ...asked });
    if (header.missed) return null;
    const { width, height } = header;
    const count = width * height;
    const rgb = new Uint8Array(payload, 0, 3 * count);
    const rgba = new Uint8ClampedArray(4 * count).fill(255);
    for (let pixel = 0; pixel < count; pixel += 1) rgba.set(rgb.subarray(3 * pixel, 3 * pixel + 3), 4 * pixel);
    const depth = new Float32Array(payload.slice(3 * count));
    return {
      ...header,
      depth,
      pictures: [
        [{ width, height, rgba }, `What the ${this.facts.sensor} sees`],
        [{ width, height, rgba: depthColours(depth) }, "How deep it is pressed in"],
      ],
      said: pressWords(header),
    };
  }
}
