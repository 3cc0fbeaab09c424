// An object of a data script, as `panel.js` asks it.
"use strict";
(function (viewer) {
  const { times, length } = viewer.algebra;

  class StoredObject {
    static async open(id, stored) {
      const arrays = await viewer.storedArrays(stored);
      return new StoredObject(id, stored.header, arrays);
    }

    constructor(id, header, arrays) {
      this.header = header;
      this.arrays = arrays;
      this.surface = new viewer.StoredSurface(header, arrays);
      this.modes = new viewer.StoredModes(header, arrays, this.surface);
      this.touch = new viewer.StoredTouch(header.sensor, this.surface);
      this.facts = {
        id,
        file: `data/object_files/${id}.safetensors`,
        name: header.name,
        frame: header.frame,
        reach: this.surface.reach(header.frame),
        listeningGain: header.listening_gain,
        frequencies: this.modes.frequencies,
        dampings: this.modes.dampings,
        note:
          "Drawn in your browser from what is stored for this page: colours without shadows, gains " +
          "at stored places, a press only by the depth of the gel. The Python asks the Object File itself.",
      };
    }

    attach(canvas) {
      this.drawing = new viewer.Drawing(canvas, this.surface, this.arrays.colours, this.header);
    }

    draw(orbit, _moving, shown) {
      shown({ resolution: this.drawing.draw(orbit) });
    }

    async strike(orbit, x, y, { impulse, along, duration, sampleRate }) {
      const { origin, direction } = orbit.ray(x, y);
      const hit = this.surface.firstHit(origin, direction);
      if (!hit) return null;
      const push = viewer.pushOf(along, viewer.outward(hit.normal, direction), direction);
      const force = times(push, impulse / length(push));
      const amplitudes = this.modes.amplitudes(hit.face, hit.barycentric, force, hit.normal);
      const sound = this.modes.sound(amplitudes, duration, sampleRate);
      return { point: hit.point, normal: hit.normal, impulse: force, sound, partials: async () => amplitudes };
    }

    async press(orbit, x, y, { depth, tilt, azimuth }) {
      const { origin, direction } = orbit.ray(x, y);
      const hit = this.surface.firstHit(origin, direction);
      if (!hit) return null;
      const touch = this.touch.press(hit.point, hit.normal, depth, tilt, azimuth);
      const { width, height } = touch;
      const image = { width, height, rgba: viewer.depthColours(touch.depth) };
      return {
        point: hit.point,
        normal: viewer.outward(hit.normal, direction),
        ...touch,
        pictures: [[image, "How deep it is pressed in, approximately"]],
        said: viewer.pressWords(touch),
      };
    }
  }

  viewer.StoredObject = StoredObject;
})((window.objectfolderViewer ??= {}));
