// An object of a data script, as `panel.js` asks it.
import { dot, length, minus, times, unit } from "./algebra.js";
import { outward, pushOf } from "./contact.js";
import { Drawing } from "./drawing.js";
import { storedArrays } from "./stored_data.js";
import { StoredModes } from "./stored_modes.js";
import { StoredSurface } from "./stored_surface.js";

// The nearest of stored places on the side of the surface that faces as this one does.
function nearest(places, { point, normal }) {
  let [best, least] = [0, Infinity];
  places.forEach((place, index) => {
    const away = minus(place.point, point);
    const apart = dot(away, away) * (dot(place.normal, normal) > 0 ? 1 : 16);
    if (apart < least) [best, least] = [index, apart];
  });
  return best;
}

export class StoredObject {
  static async open(id, stored) {
    const arrays = await storedArrays(stored);
    const sheet = Object.assign(new Image(), { src: stored.header.touch.sheet });
    if (arrays.reached_places.length) await sheet.decode();
    return new StoredObject(id, stored.header, arrays, sheet);
  }

  constructor(id, header, arrays, sheet) {
    this.header = header;
    this.arrays = arrays;
    this.surface = new StoredSurface(header, arrays);
    const places = Array.from(arrays.place_faces, (face, place) => {
      const [first, second] = [0, 1].map((at) => arrays.place_barycentric[2 * place + at] / 255);
      const { point } = this.surface.placeOn(face, [first, second, 1 - first - second]);
      return { point, normal: unit([...arrays.place_normals.subarray(3 * place, 3 * place + 3)]) };
    });
    this.modes = new StoredModes(header.sound, arrays, places);
    this.sheet = sheet;
    this.reached = Array.from(arrays.reached_places, (place) => places[place]);
    if (!this.reached.length) this.press = null;
    this.facts = {
      id,
      file: `data/object_files/${id}.safetensors`,
      name: header.name,
      frame: header.frame,
      reach: this.surface.reach(header.frame),
      listeningGain: header.listening_gain,
      frequencies: this.modes.frequencies,
      dampings: this.modes.dampings,
      pressDepth: header.touch.depth_m,
      note:
        "Drawn in your browser from what is stored for this page: colours without shadows, and what the " +
        "Object File says of a blow or a press at the nearest of some hundred places. The command objectfolder view " +
        "asks it anywhere, at any depth.",
    };
  }

  attach(canvas) {
    this.drawing = new Drawing(canvas, this.surface, this.arrays, this.header);
  }

  draw(orbit, moving, shown) {
    shown({ resolution: this.drawing.draw(orbit, moving) });
  }

  async strike(orbit, x, y, { impulse, along, duration }) {
    const { origin, direction } = orbit.ray(x, y);
    const hit = this.surface.firstHit(origin, direction);
    if (!hit) return null;
    const sampleRate = this.modes.rate;
    const silence = { impulse: [0, 0, 0], sound: new Float32Array(), sampleRate, partials: async () => [] };
    if (!this.modes.frequencies.length) return { ...hit, ...silence };
    const place = nearest(this.modes.places, { point: hit.point, normal: outward(hit.normal, direction) });
    const { point, normal } = this.modes.places[place];
    const push = pushOf(along, outward(normal, direction), direction);
    const force = times(push, impulse / length(push));
    const amplitudes = this.modes.amplitudes(place, force);
    const sound = this.modes.sound(amplitudes, duration);
    return { point, normal, impulse: force, sound, sampleRate, partials: async () => amplitudes };
  }

  async press(orbit, x, y) {
    const { origin, direction } = orbit.ray(x, y);
    const hit = this.surface.firstHit(origin, direction);
    if (!hit) return null;
    const { sensor, depth_m, width, height, columns } = this.header.touch;
    const place = nearest(this.reached, { point: hit.point, normal: outward(hit.normal, direction) });
    const context = Object.assign(document.createElement("canvas"), { width, height }).getContext("2d");
    context.drawImage(this.sheet, -width * (place % columns), -height * Math.floor(place / columns));
    return {
      ...this.reached[place],
      pictures: [[{ width, height, rgba: context.getImageData(0, 0, width, height).data }, `What the ${sensor} sees`]],
      said: `Pressed ${(1000 * depth_m).toFixed(1)} mm deep at the nearest of ${this.reached.length} places.`,
    };
  }
}
