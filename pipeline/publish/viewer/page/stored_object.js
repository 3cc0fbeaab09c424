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
          "Drawn in your browser from what is stored for this page: colours without shadows, and what the " +
          "Object File says of a blow at the nearest of some hundred places. `objectfolder view` asks it anywhere, " +
          "and presses it, too.",
      };
    }

    attach(canvas) {
      this.drawing = new viewer.Drawing(canvas, this.surface, this.arrays, this.header);
    }

    draw(orbit, _moving, shown) {
      shown({ resolution: this.drawing.draw(orbit) });
    }

    async strike(orbit, x, y, { impulse, along, duration, sampleRate }) {
      const { origin, direction } = orbit.ray(x, y);
      const hit = this.surface.firstHit(origin, direction);
      if (!hit) return null;
      if (!this.modes.frequencies.length) return { ...hit, impulse: [0, 0, 0], sound: new Float32Array(), partials: async () => [] };
      const place = this.modes.nearest({ point: hit.point, normal: viewer.outward(hit.normal, direction) });
      const { point, normal } = this.modes.places[place];
      const push = viewer.pushOf(along, viewer.outward(normal, direction), direction);
      const force = times(push, impulse / length(push));
      const amplitudes = this.modes.amplitudes(place, force);
      const sound = this.modes.sound(amplitudes, duration, sampleRate);
      return { point, normal, impulse: force, sound, partials: async () => amplitudes };
    }
  }

  viewer.StoredObject = StoredObject;
})((window.objectfolderViewer ??= {}));
